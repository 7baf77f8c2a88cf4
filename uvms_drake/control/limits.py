"""The limits of the robot, what the tube takes of them, and what is left to the nominal MPC."""

from dataclasses import dataclass, field, replace

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require, vector, within
from uvms_drake.model.surface.law import SurfaceLaw


@dataclass
class Limits:
    """State and input limits of the real robot."""

    nu1: float = 0.25
    """‖ν₁‖₂ [m/s]."""
    nu2: float = 0.25
    """‖ν₂‖₂ [rad/s]."""
    qdot: float = 0.4
    """‖q̇‖₂ [rad/s]."""
    roll: float = 0.3
    """|φ| of the vehicle [rad]."""
    pitch: float = 0.3
    """|θ| of the vehicle [rad]."""
    tip_pitch: float = 1.2
    """|𝔬_θ| of the end-effector [rad]; the Euler angles are singular at π/2."""
    static_force: float | None = None
    """‖force part of 𝔉‖₂ at the pose of the end-effector, at rest [N]: how far it may go into the
    surface as the controller knows it. What the surface's damping adds is not limited. A
    certificate needs it, unless the motion is kinematic."""
    q_lower: np.ndarray | None = None
    """Joint limits (n,) [rad], if narrower ones than the model file's are wanted."""
    q_upper: np.ndarray | None = None
    """As `q_lower`."""
    u: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """|𝔲ᵢ|, one for each of the 6 + n accelerations [m/s² (3), rad/s² (3 + n)]."""
    tau: np.ndarray | None = None
    """|τᵢ| = |(M(𝔮)𝔲)ᵢ|, if that is limited too [N (3), N m (3 + n)]."""


@dataclass
class TubeRadii:
    """Bounds on the deviation of the real from the nominal motion.

    Where a block's own radius is left out, the total `e` or `z`, which bounds it too, is taken.
    """

    e: float = 0.0
    """‖y − ȳ‖₂ of the extended task y = (χ, q) [m, rad]."""
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
    roll: float = 0.0
    """|φ − φ̄| of the vehicle [rad]."""
    pitch: float = 0.0
    """|θ − θ̄| of the vehicle [rad]."""
    u: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """|𝔲ᵢ − ūᵢ| [m/s² (3), rad/s² (3 + n)]."""
    tau: np.ndarray | None = None
    """|τᵢ − τ̄ᵢ| [N (3), N m (3 + n)]; needed if τ is limited."""


_TOTALS = {"position": "e", "orientation": "e", "joints": "e", "nu1": "z", "nu2": "z", "qdot": "z"}


def resolved_radii(tube: TubeRadii) -> TubeRadii:
    """Returns the radii with every block's own filled in from the total."""
    return replace(tube, **{block: getattr(tube, total) for block, total in _TOTALS.items()
                            if getattr(tube, block) is None})


@dataclass(frozen=True)
class NominalLimits:
    """Ē, Z̄ and Ū: what the nominal trajectory may use."""

    nu1: float
    nu2: float
    qdot: float
    roll: float
    pitch: float
    tip_pitch: float
    q_lower: np.ndarray
    q_upper: np.ndarray
    u: np.ndarray
    tau: np.ndarray | None = None
    static_force: float | None = None


_SCALARS = (("nu1", "nu1"), ("nu2", "nu2"), ("qdot", "qdot"), ("roll", "roll"),
            ("pitch", "pitch"), ("tip_pitch", "orientation"))
"""Scalar limits, and the radius that each is tightened by."""


def joint_limits(limits: Limits, q_lower: np.ndarray, q_upper: np.ndarray
                 ) -> tuple[np.ndarray, np.ndarray]:
    """Returns the joint limits (n,): those of the robot, or narrower ones asked for.

    Args:
        limits: May have joint limits of its own.
        q_lower: The robot's (n,) [rad].
        q_upper: The robot's (n,) [rad].
    """
    out = []
    for key, own in (("q_lower", q_lower), ("q_upper", q_upper)):
        asked = getattr(limits, key)
        with within("limits"):
            value = own if asked is None else vector(key, asked, len(own))
            inside = bool(np.all((q_lower <= value) & (value <= q_upper)))
            require(inside, key, value, f"within the robot's own limits, {q_lower} to {q_upper}")
        out.append(value)
    with within("limits"):
        require(bool(np.all(out[0] < out[1])), "q_lower", out[0], f"below q_upper = {out[1]}")
    return out[0], out[1]


def force_radius(tube: TubeRadii, surface: SurfaceLaw) -> float:
    """Returns by how much the tube changes the static force, at most [N].

    Of a spring it takes for granted that no Euler angle is π away from its equilibrium's.
    """
    tube = resolved_radii(tube)
    assert tube.position is not None and tube.orientation is not None  # now they are filled in
    G = surface.force_jacobian()
    return float(np.linalg.norm(G[:, :3], 2) * tube.position
                 + np.linalg.norm(G[:, 3:], 2) * tube.orientation)


def tightened_parts(limits: Limits, tube: TubeRadii, q_lower: np.ndarray, q_upper: np.ndarray,
                    surface: SurfaceLaw) -> list[tuple[str, float, float]]:
    """Returns (name, radius, room) of every limit; the set is empty where the radius is larger.

    The arguments are those of `tighten`, and are not checked.
    """
    tube = resolved_radii(tube)
    parts = [(key, getattr(tube, radius), getattr(limits, key)) for key, radius in _SCALARS]
    if limits.static_force is not None:
        parts.append(("static_force", force_radius(tube, surface), limits.static_force))
    parts += [(f"q{i + 1}", tube.joints, 0.5 * (upper - lower))
              for i, (lower, upper) in enumerate(zip(q_lower, q_upper, strict=True))]
    parts += [(f"u[{i}]", radius, limit)
              for i, (radius, limit) in enumerate(zip(tube.u, limits.u, strict=True))]
    if limits.tau is not None and tube.tau is not None:
        parts += [(f"tau[{i}]", radius, limit)
                  for i, (radius, limit) in enumerate(zip(tube.tau, limits.tau, strict=True))]
    return [(name, float(radius), float(room)) for name, radius, room in parts]


def tighten(limits: Limits, tube: TubeRadii, q_lower: np.ndarray, q_upper: np.ndarray,
            surface: SurfaceLaw, *, accelerations: bool = True) -> NominalLimits:
    """Returns the Pontryagin difference of the limits and the tube (Section IV-C of the paper).

    A ball of radius ρ takes ρ from ‖x‖ ≤ c, from |x| ≤ c and from either side of an interval, and
    Lρ from a function that changes by at most L per unit, which the static force is.

    Args:
        limits: Limits of the real robot.
        tube: Deviation bounds.
        q_lower: Joint limits of the robot (n,) [rad].
        q_upper: Joint limits of the robot (n,) [rad].
        surface: What is pressed.
        accelerations: Whether 𝔲 is limited; there is none if ζ is the input.

    Raises:
        InvalidParameter: A parameter has no meaning, or the tube leaves nothing of a limit.
    """
    check_limits(limits, len(q_lower), accelerations=accelerations)
    q_lower, q_upper = joint_limits(limits, q_lower, q_upper)
    tube = resolved_radii(tube)
    _check_tube(tube, limits, 6 + len(q_lower) if accelerations else 0)
    for name, radius, room in tightened_parts(limits, tube, q_lower, q_upper, surface):
        if radius >= room:
            raise InvalidParameter(f"limits.{name}", room, f"larger than the tube's {radius:.4g}")
    scalars = {key: getattr(limits, key) - getattr(tube, radius) for key, radius in _SCALARS}
    tau = None if limits.tau is None else np.asarray(limits.tau) - np.asarray(tube.tau)
    static_force = limits.static_force
    if static_force is not None:
        static_force -= force_radius(tube, surface)
    return NominalLimits(**scalars, q_lower=q_lower + tube.joints, q_upper=q_upper - tube.joints,
                         u=np.asarray(limits.u) - np.asarray(tube.u), tau=tau,
                         static_force=static_force)


def check_limits(limits: Limits, num_joints: int, *, accelerations: bool = True) -> None:
    """Raises `InvalidParameter` for the first limit that has no meaning."""
    size = 6 + num_joints if accelerations else 0
    with within("limits"):
        for key, _ in _SCALARS:
            require(0.0 < getattr(limits, key) < np.inf, key, getattr(limits, key), "positive")
        for key in ("roll", "pitch", "tip_pitch"):
            require(getattr(limits, key) < 0.5 * np.pi, key, getattr(limits, key), "below π/2")
        if limits.static_force is not None:
            require(0.0 < limits.static_force < np.inf, "static_force", limits.static_force,
                    "positive, or left out for no limit")
        for key in ("u", "tau"):
            if key == "u" or limits.tau is not None:
                value = vector(key, getattr(limits, key), size)
                require(bool(np.all(value > 0.0)), key, value, f"{size} positive numbers")


def _check_tube(tube: TubeRadii, limits: Limits, size: int) -> None:
    with within("tube"):
        for key, value in vars(tube).items():
            if key == "tau" and limits.tau is None:
                continue
            if key in ("u", "tau"):
                value = vector(key, value, size)
                require(bool(np.all(value >= 0.0)), key, value, f"{size} numbers, none negative")
            else:
                require(0.0 <= value < np.inf, key, value, "zero or positive")
