"""The limits of the robot, what the tube takes of them, and what is left to the nominal MPC."""

from dataclasses import dataclass, field

import numpy as np

from uvms_drake.errors import InvalidParameter, require, vector, within


@dataclass
class Limits:
    """State and input limits of the real robot; joint limits are the model file's own."""

    nu1: float = 0.25
    """‖ν₁‖₂ [m/s]."""
    nu2: float = 0.25
    """‖ν₂‖₂ [rad/s]."""
    qdot: float = 0.4
    """‖q̇‖₂ [rad/s]."""
    pitch: float = 0.3
    """|θ| of the vehicle [rad]."""
    tip_pitch: float = 1.2
    """|𝔬_θ| of the end-effector [rad]; the Euler angles are singular at π/2."""
    u: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """|𝔲ᵢ|, one for each of the 6 + n accelerations [m/s² (3), rad/s² (3 + n)]."""


@dataclass
class DeclaredTube:
    """Bounds on the deviation of the real from the nominal state; declared, not computed."""

    e: float = 0.0
    """‖y − ȳ‖₂ of the extended task y = (χ, q) [m, rad]."""
    z: float = 0.0
    """‖ζ − ζ̄‖₂ [m/s, rad/s]."""
    pitch: float = 0.0
    """|θ − θ̄| of the vehicle [rad]."""
    u: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """|𝔲ᵢ − ūᵢ| [m/s² (3), rad/s² (3 + n)]."""


@dataclass(frozen=True)
class NominalLimits:
    """Ē, Z̄ and Ū: what the nominal trajectory may use."""

    nu1: float
    nu2: float
    qdot: float
    pitch: float
    tip_pitch: float
    q_lower: np.ndarray
    q_upper: np.ndarray
    u: np.ndarray


def tighten(limits: Limits, tube: DeclaredTube, q_lower: np.ndarray,
            q_upper: np.ndarray) -> NominalLimits:
    """Returns the Pontryagin difference of the limits and the tube (Section IV-C of the paper).

    A ball of radius ρ takes ρ from ‖x‖ ≤ c, from |x| ≤ c and from either side of an interval.

    Args:
        limits: Limits of the real robot.
        tube: Deviation bounds.
        q_lower: Joint limits (n,) [rad].
        q_upper: Joint limits (n,) [rad].

    Raises:
        InvalidParameter: A parameter has no meaning, or the tube leaves nothing of a limit.
    """
    size = 6 + len(q_lower)
    with within("tube"):
        tube_u = vector("u", tube.u, size)
        for key in ("e", "z", "pitch"):
            require(0.0 <= getattr(tube, key) < np.inf, key, getattr(tube, key), "zero or positive")
        require(bool(np.all(tube_u >= 0.0)), "u", tube_u, f"{size} numbers, none negative")
    with within("limits"):
        u = vector("u", limits.u, size)
        require(bool(np.all(u > tube_u)), "u", u, f"larger than tube.u = {tube_u}, everywhere")
        require(limits.tip_pitch < 0.5 * np.pi, "tip_pitch", limits.tip_pitch, "below π/2")
        require(limits.pitch < 0.5 * np.pi, "pitch", limits.pitch, "below π/2")
        rest = {}
        for key, radius, source in (
            ("nu1", tube.z, "z"), ("nu2", tube.z, "z"), ("qdot", tube.z, "z"),
            ("pitch", tube.pitch, "pitch"), ("tip_pitch", tube.e, "e"),
        ):
            limit = getattr(limits, key)
            require(radius < limit < np.inf, key, limit,
                    f"positive and larger than tube.{source} = {radius:g}")
            rest[key] = limit - radius
    if not bool(np.all(q_upper - q_lower > 2.0 * tube.e)):
        raise InvalidParameter(
            "tube.e", tube.e, "less than half of every joint's range")
    return NominalLimits(**rest, q_lower=q_lower + tube.e, q_upper=q_upper - tube.e, u=u - tube_u)
