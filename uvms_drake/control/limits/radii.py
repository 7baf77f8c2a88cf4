"""Radii of a tube: bounds on the deviation of the real from the nominal motion."""

from dataclasses import dataclass, field, replace

import numpy as np

from uvms_drake.common.errors import require, vector, within


@dataclass
class HoldRadii:
    """Bounds on the deviation of the tip in a hold of a sensed contact, once the plan has stood."""

    time: float = 0.0
    """Time since the plan stands, from which on they hold, at all readings of a target too [s]."""
    depth: float = 0.0
    """|n·(𝔭 − 𝔭̄)| [m]."""
    position: float = 0.0
    """‖𝔭 − 𝔭̄‖₂ [m]."""
    advance: float = 0.0
    """⟨±𝔭̇⟩ of the real tip [m/s], with the speed of a plan that stands."""
    standing: float = 0.0
    """|n·𝔭̄̇| + 2α‖P_t𝔭̄̇‖ of a plan that stands, at most [m/s]."""
    reading: float = 0.0
    """|n·𝔢| of the error 𝔢 of a reading [N]."""
    age: float = 0.0
    """Largest mean age of the force in a reading [s]."""
    since: float = 0.0
    """Largest mean age of the readings of a target [s]."""


@dataclass
class TubeRadii:
    """Bounds on the deviation of the real from the nominal motion.

    A block's own radius that is left out is the total `e` or `z`, which bounds it too.
    """

    e: float = 0.0
    """Total ‖y − ȳ‖₂ of the extended task y = (χ, q) [m, rad]."""
    position: float | None = None
    """‖𝔭 − 𝔭̄‖₂ of the end-effector [m]."""
    orientation: float | None = None
    """‖𝔬 − 𝔬̄‖₂ of the end-effector's Euler angles [rad]."""
    joints: float | None = None
    """‖q − q̄‖₂ [rad]."""
    z: float = 0.0
    """‖ζ − ζ̄‖₂ [m/s, rad/s]."""
    nu1: float | None = None
    """‖ν₁ − ν̄₁‖₂ [m/s]."""
    nu2: float | None = None
    """‖ν₂ − ν̄₂‖₂ [rad/s]."""
    qdot: float | None = None
    """‖q̇ − q̄̇‖₂ [rad/s]."""
    tip_speed: float | None = None
    """‖𝔭̇ − 𝔭̄̇‖₂ of the end-effector [m/s]; needed if its velocity is limited."""
    depth: float | None = None
    """|n·(𝔭 − 𝔭̄)| of the end-effector along the direction n of a sensed contact [m]."""
    depth_speed: float | None = None
    """|n·(𝔭̇ − 𝔭̄̇)| likewise [m/s]."""
    between_knots: float | None = None
    """Largest distance of a plan's n·𝔭̄ from a parabola between two of its knots [m]."""
    joints_between: float | None = None
    """Largest excess of a plan's joint over its limits between two knots that keep them [rad]."""
    attitude_between: float | None = None
    """Largest excess of roll or pitch of the vehicle, likewise [rad]."""
    tool_between: float | None = None
    """Largest turn of the end-effector, likewise [rad]."""
    roll: float = 0.0
    """|φ − φ̄| of the vehicle [rad]."""
    pitch: float = 0.0
    """|θ − θ̄| of the vehicle [rad]."""
    u: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """|𝔲ᵢ − ūᵢ| [m/s² (3), rad/s² (3 + n)]."""
    tau: np.ndarray | None = None
    """|τᵢ − τ̄ᵢ| [N (3), N m (3 + n)]; needed if τ is limited."""
    hold: HoldRadii | None = None
    """Smaller radii in a hold of a sensed contact; None: unknown."""
    likely_hold: HoldRadii | None = None
    """The same if the noise of the tare is independent, which is likely and not certified."""


_TOTALS = {"position": "e", "orientation": "e", "joints": "e", "nu1": "z", "nu2": "z", "qdot": "z"}


def resolved_radii(tube: TubeRadii) -> TubeRadii:
    """Returns the radii with every block's own filled in from the total."""
    tube = replace(tube, **{block: getattr(tube, total) for block, total in _TOTALS.items()
                            if getattr(tube, block) is None})
    return replace(
        tube, depth=tube.position if tube.depth is None else tube.depth,
        depth_speed=tube.tip_speed if tube.depth_speed is None else tube.depth_speed)


def check_tube(tube: TubeRadii, num_inputs: int, *, tau: bool) -> None:
    """Raises `InvalidParameter` for the first radius that has no meaning.

    Args:
        tube: The radii.
        num_inputs: Number of accelerations that are limited, 6 + n or none.
        tau: Whether forces are limited too, so that their radii are needed.
    """
    with within("tube"):
        for key, value in vars(tube).items():
            if value is None or (key == "tau" and not tau):
                continue
            if isinstance(value, HoldRadii):
                for part, number in vars(value).items():
                    require(0.0 <= number < np.inf, f"{key}.{part}", number, "zero or positive")
                continue
            if key in ("u", "tau"):
                value = vector(key, value, num_inputs)
                require(bool(np.all(value >= 0.0)), key, value,
                        f"{num_inputs} numbers, none negative")
            else:
                require(0.0 <= value < np.inf, key, value, "zero or positive")
