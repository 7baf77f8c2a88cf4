"""Ultimate bounds of pose and force errors, once the nominal state has come to the task."""

import numpy as np

from uvms_drake.control.limits import TubeRadii, resolved_radii
from uvms_drake.control.limits.radii import HoldRadii
from uvms_drake.model.surface.law import Surface, TipErrors
from uvms_drake.model.surface.unknown_contact import UnknownContact, UnknownSurface

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


def error_along(bound: np.ndarray, angle: float) -> float:
    """Returns the largest |n·𝔢| of |𝔢ᵢ| ≤ bᵢ and unit vectors n within an angle of the x-axis.

    (b_x, ‖(b_y, b_z)‖) at the angle of the largest sum, or at the end of the range.

    Args:
        bound: b (3,).
        angle: The angle, below π/2 [rad].
    """
    along, across = float(bound[0]), float(np.hypot(*bound[1:3]))
    beta = min(angle, float(np.arctan2(across, along)))
    return along * float(np.cos(beta)) + across * float(np.sin(beta))


def hold_band(contact: UnknownContact, force: float, off: HoldRadii, short: float = 0.0) -> float:
    """Returns the largest |n·𝐅 − F| in a hold, with the plan at its target [N]; inf if none is.

    With E = E_n + αE_t, the advance s of the tip, d = c₊s < 1, the least and the largest share a±,
    the error ν of a reading along n, its mean age A and that H of a target's readings,
    r = a₊(1 + d)/(a₋(1 − d)),

        b = r(F + ν + κ₊(E + ℓ + v̄H)) + (1 + d)a₊κ₊m − F,
        m = max(min(2αE_t, sH), min(2E, sH) − E) + sA,

    or less, by `_of_slow_friction`. tube/contact/theory.md#force-band-of-a-hold.

    Args:
        contact: Specification of the contact.
        force: F [N].
        off: Radii in the hold.
        short: ℓ, distance of the plan from its target, as of `UnknownContact.band` [m].
    """
    d, walls = contact.dissipation * off.advance, contact.walls
    least, most = walls.share, walls.largest_share
    if not d < 1.0 or least <= 0.0:
        return float(np.inf)
    # Displacements of the target by the tube, and since the reading; that of E at most once.
    tilt, since = contact.walls.tilt, off.advance * off.since
    E, across = off.depth + tilt * off.position, min(2.0 * tilt * off.position, since)
    steered = E + short + off.standing * off.since
    moved = max(across, min(2.0 * E, since) - E) + off.advance * off.age
    reading = force + off.reading + contact.stiffness * steered
    largest = (1.0 + d) * most * (reading / (least * (1.0 - d)) + contact.stiffness * moved)
    return min(largest, _of_slow_friction(contact, reading, moved, d, off)) - force


def _of_slow_friction(contact: UnknownContact, reading: float, moved: float, d: float,
                      off: HoldRadii) -> float:
    """Returns the largest n·𝐅 by the force across n, which changes slowly [N]; inf if unknown.

    With G = 2α(μ − sin θ), R = max(1 + G/a₋, a₊/(a₊ − G)), η = (1 − d)/(1 + d), a reading and tube
    of F_r, a displacement m since, and the change D = ρ′(A + H) + 2a′ of the force across n,

        n·𝐅 ≤ R(F_r + κ₊m/cos θ + αD)/(η − Rα(1 − η)(μ cos θ + sin θ)/a₋).

    Args:
        contact: Specification of the contact.
        reading: F_r [N].
        moved: m [m].
        d: Damping at the advance of the tip.
        off: Radii in the hold.
    """
    sine, cosine, tilt = np.sin(contact.angle), np.cos(contact.angle), contact.walls.tilt
    mu, slow = contact.friction, contact.hold_forces
    least, most, gap = cosine - mu * sine, cosine + mu * sine, 2.0 * tilt * (mu - sine)
    if mu < sine + tilt:
        return float(np.inf)
    ratio, eta = max(1.0 + gap / least, most / (most - gap)), (1.0 - d) / (1.0 + d)
    turned = slow.force_rate * (off.age + off.since) + 2.0 * slow.force_ripple
    share = eta - ratio * tilt * (1.0 - eta) * (mu * cosine + sine) / least
    if share <= 0.0:
        return float(np.inf)
    return float(ratio * (
        reading + contact.stiffness * moved / cosine + tilt * turned) / share)
