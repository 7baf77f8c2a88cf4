"""Settings of the limits, the limits made of them, and their tightening by a tube."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from uvms_drake.common.constraints import Constraint, Positive
from uvms_drake.common.errors import InvalidParameter, require, vector, within
from uvms_drake.common.kinds import offer
from uvms_drake.common.schema import check_values
from uvms_drake.control.limits.inputs import Accelerations, Forces, ThrusterForces
from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.limits.pose import Joints, TipBox, TipPitch, VehicleAngle
from uvms_drake.control.limits.radii import TubeRadii, check_tube, resolved_radii
from uvms_drake.control.limits.speeds import Speed, TipVelocity
from uvms_drake.control.limits.static_force import StaticForce
from uvms_drake.model.description.thruster_file import ThrusterParameters
from uvms_drake.model.surface.law import NotOffered, Surface

offer(Limit, TipBox, TipVelocity)

Regular = Constraint("below π/2", lambda x: x < 0.5 * np.pi)
"""Angle at which Euler angles are regular [rad]."""


@dataclass
class Limits:
    """State and input limits of the real robot."""

    nu1: Annotated[float, Positive] = 0.25
    """Largest ‖ν₁‖₂ [m/s]."""
    nu2: Annotated[float, Positive] = 0.25
    """Largest ‖ν₂‖₂ [rad/s]."""
    qdot: Annotated[float, Positive] = 0.4
    """Largest ‖q̇‖₂ [rad/s]."""
    roll: Annotated[float, Positive, Regular] = 0.3
    """Largest |φ| of the vehicle [rad]."""
    pitch: Annotated[float, Positive, Regular] = 0.3
    """Largest |θ| of the vehicle [rad]."""
    tip_pitch: Annotated[float, Positive, Regular] = 1.2
    """Largest |𝔬_θ| of the end-effector [rad]; the Euler angles are singular at π/2."""
    static_force: Annotated[float, Positive] | None = None
    """Largest ‖force part of 𝔉‖₂ at the pose of the end-effector, at rest [N], of the surface in
    the controller's model; the force of its damping is not limited. A certificate needs it."""
    q_lower: np.ndarray | None = None
    """Smallest joint angles (n,) [rad], if narrower limits than the model file's are wanted."""
    q_upper: np.ndarray | None = None
    """Largest joint angles (n,) [rad], likewise."""
    u: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Largest |𝔲ᵢ|, one for each of the 6 + n accelerations [m/s² (3), rad/s² (3 + n)]."""
    tau: np.ndarray | None = None
    """Largest |τᵢ| = |(M(𝔮)𝔲)ᵢ|, if that is limited too [N (3), N m (3 + n)]."""
    thrusters: np.ndarray | None = None
    """Largest wrench on the axes that no thruster drives (k,), in the order of the wrench [N (3),
    N m (3)], [] where all are driven. If it is given, every thruster's force is limited too."""
    more: list[Limit] = field(default_factory=list)
    """Further limits; a script may put any `Limit` here."""


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
    still = ", ".join(f"q{i + 1}" for i in np.flatnonzero(q_lower >= q_upper))
    advice = f": {still} of the robot cannot move, and its joint is to be of type fixed"
    with within("limits"):
        require(bool(np.all(out[0] < out[1])), "q_lower", out[0],
                f"below q_upper = {out[1]}{advice if still else ''}")
    return out[0], out[1]


def make_limits(settings: Limits, q_lower: np.ndarray, q_upper: np.ndarray, surface: Surface,
                *, thrusters: ThrusterParameters | None = None,
                slides: Sequence[bool] | np.ndarray = (),
                of_contact: Sequence[Limit] = ()) -> dict[str, Limit]:
    """Returns the limits of the real robot by name.

    Args:
        settings: Their bounds.
        q_lower: Joint limits of the robot (n,) [rad].
        q_upper: Joint limits of the robot (n,) [rad].
        surface: Surface that is pressed.
        thrusters: Parameters of the robot's thrusters, if they are known.
        slides: Whether a joint is prismatic (n,), for the units; none is, if left out.
        of_contact: Limits of a kind of contact.

    Raises:
        InvalidParameter: A parameter has no meaning.
    """
    check_limits(settings, len(q_lower))
    slides = [bool(each) for each in slides] or [False] * len(q_lower)
    rates = sorted(set(_units(slides, "m/s", "rad/s")), reverse=True)
    limits: list[Limit] = [
        *(Speed(name, getattr(settings, name)) for name in ("nu1", "nu2")),
        Speed("qdot", settings.qdot, ", ".join(rates)),
        *(VehicleAngle(name, getattr(settings, name)) for name in ("roll", "pitch")),
        TipPitch(settings.tip_pitch),
        Joints(*joint_limits(settings, q_lower, q_upper), _units(slides, "m", "rad"))]
    if settings.static_force is not None:
        try:
            limits.append(StaticForce(settings.static_force, surface))
        except NotOffered as error:
            raise InvalidParameter("limits.static_force", settings.static_force,
                                   f"null, or the {error.value} {error.allowed}") from None
    straight = [*[True] * 3, *[False] * 3, *slides]
    limits.append(Accelerations(np.asarray(settings.u, dtype=float),
                                _units(straight, "m/s²", "rad/s²")))
    if settings.tau is not None:
        limits.append(Forces(np.asarray(settings.tau, dtype=float), _units(straight, "N", "N m")))
    if settings.thrusters is not None:
        with within("limits"):
            limits.append(ThrusterForces.of(thrusters, settings.thrusters, 6 + len(q_lower)))
    by_name = {limit.name: limit for limit in (*limits, *of_contact)}
    # The user's own, under names of their own.
    for i, limit in enumerate(settings.more):
        with within(f"limits.more[{i}]"):
            limit.check()
            require(limit.name not in by_name, "name", limit.name,
                    f"another one than {', '.join(by_name)}")
        by_name[limit.name] = limit
    return by_name


def _units(straight: Sequence[bool], of_translation: str, of_rotation: str) -> list[str]:
    return [of_translation if each else of_rotation for each in straight]


def tighten(limits: dict[str, Limit], tube: TubeRadii) -> dict[str, Limit]:
    """Returns the Pontryagin difference of the limits and the tube (Section IV-C of the paper).

    A ball of radius ρ tightens ‖x‖ ≤ c, |x| ≤ c and either side of an interval by ρ, and a function
    with the Lipschitz constant L, such as the static force, by Lρ. See
    control/theory.md#constraint-tightening.

    Raises:
        InvalidParameter: A radius has no meaning, or a tightened limit is empty.
    """
    tube = resolved_radii(tube)
    by_force = [name for name in ("tau", "thrusters") if name in limits]
    for name in by_force:
        require(tube.tau is not None, f"limits.{name}", limits[name].upper,
                "left out, unless tube.tau has the radii of the forces (6 + n numbers)")
    check_tube(tube, len(limits["u"].upper) if "u" in limits else 0, tau=bool(by_force))
    for limit in limits.values():
        for i, (label, radius, available) in enumerate(limit.margins(tube)):
            if available <= radius < np.inf:
                key = f"{limit.name}[{i}]" if type(limit) in (Accelerations, Forces) else label
                raise InvalidParameter(
                    f"limits.{key}", available, f"larger than the tube's {radius:.4g}")
    return {name: limit.tightened(tube) for name, limit in limits.items()}


def check_limits(limits: Limits, num_joints: int) -> None:
    """Raises `InvalidParameter` for the first limit that has no meaning."""
    size = 6 + num_joints
    with within("limits"):
        check_values(limits)
        for key in ("u", "tau"):
            if key == "u" or limits.tau is not None:
                require(np.size(getattr(limits, key)) > 0, key, [], f"given: {size} "
                        "positive numbers (a file with `base: NAME` takes them over)")
                value = vector(key, getattr(limits, key), size)
                require(bool(np.all(value > 0.0)), key, value, f"{size} positive numbers")
