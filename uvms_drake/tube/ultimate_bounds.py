"""Ultimate bounds of pose and force errors, once the nominal state has come to the task."""

import numpy as np

from uvms_drake.control.limits import TubeRadii, resolved_radii
from uvms_drake.model.surface.law import Surface, TipErrors
from uvms_drake.model.surface.unknown_contact import UnknownSurface
from uvms_drake.tube.contact.hold_band import hold_band

HOLD, LIKELY = "force in a hold", "force in a hold, likely"
"""Names of the bounds of the force error in a hold."""


def tip_errors(tube: TubeRadii) -> TipErrors:
    """Returns the radii of the tip."""
    tube = resolved_radii(tube)
    assert tube.position is not None and tube.orientation is not None  # now they are filled in
    assert tube.depth is not None  # likewise; a law's tube has a tip_speed
    assert tube.tip_speed is not None and tube.depth_speed is not None
    return TipErrors(
        tube.position, tube.depth, tube.orientation, tube.tip_speed, tube.depth_speed)


def ultimate_bounds(tube: TubeRadii, surface: Surface, chi_des: np.ndarray, wrench: np.ndarray
                    ) -> dict[str, float]:
    """Returns the largest errors once the nominal state has come to the task.

    `position` [m] and `orientation` [rad] of the end-effector, and `force` [N], the largest
    ‖force part of 𝔉 − 𝔉_des‖, of a sensed contact its component along the direction, see
    `Surface.force_error`. With a sensed contact `force in a hold` [N], see `hold_band`, and
    `force in a hold, likely`, which is not certified.

    Args:
        tube: The radii.
        surface: The surface, as the controller knows it.
        chi_des: Pose of the task (6,), at which the surface gives 𝔉_des.
        wrench: 𝔉_des (6,) [N, N m].
    """
    off = tip_errors(tube)
    bounds = {"position": off.position, "orientation": off.angle,
              "force": surface.force_error(chi_des, wrench, off)}
    if isinstance(surface, UnknownSurface):
        force = float(wrench[:3] @ surface.contact.direction)
        bounds |= {name: hold_band(surface.contact, force, hold) for name, hold in (
            (HOLD, tube.hold), (LIKELY, tube.likely_hold)) if hold is not None}
    return bounds
