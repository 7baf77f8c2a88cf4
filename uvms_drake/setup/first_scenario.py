"""A scenario for a robot: numbers that a first certificate may hold with, from the robot's own.

Everything is a closed form or a search over postures, and none of it is proven: that is for
`certify`. With M the inertia with the water at the posture and 𝔉 the task's wrench, at rest,

    τ_eq = b + Jᵀ𝔉,   u_eq = M⁻¹τ_eq,   uᵢ = |u_eq,i| + s (τ_max,i − |τ_eq,i|) / Mᵢᵢ,            (1)

s the share of the remaining force that one axis may use while others are in use, too.
Where τ_max is unknown, u is the need of the task. The disturbance is the force of a current
on the hull and friction on the joints, over Mᵢᵢ; the gains k = σ are the smallest of `GAINS` whose
bound of the deviation, ‖J_pos Ŵ‖d̃/(kσ) at the posture, is a fifth of the force on the wall. The
tube of a run without a certificate is that of `declared_tube`, or one that was certified.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from uvms_drake.common.errors import RunFailed, require
from uvms_drake.control.limits import HoldRadii, TubeRadii
from uvms_drake.control.limits.input_in_contact import ForceCone
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.propulsion.allocation import weaker_wrench
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.model.uvms import Uvms
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.report.robot.robot_sheet import dexterities
from uvms_drake.setup.holding import Holding, coordinate, unit_of, what_helps
from uvms_drake.tube.row_gains import input_gain, instant_gains

POSTURES = 3000
"""Random postures among which the search begins."""
ROUNDS = (0.3, 0.1, 0.03, 0.01)
"""Sizes of the steps by which it goes on from the best [rad]."""
LEVEL = 0.1
"""Pitch of the tool that costs as much as e times less dexterity [rad]."""
SIDEWAYS, ROLLED = 0.3, 1.0
"""Its yaw and roll that do, likewise [rad]."""
STEEP = 0.35
"""Pitch of the tool from which the wall is turned to face it [rad]."""
FORWARD_SHARE = 0.75
"""Share of the largest forward reach that the tip should have."""
MARGIN = 0.3
"""Distance of a posture from the joints' limits, but for narrow ones [rad]."""
HALF_RANGE = 0.25
"""Tolerance of the joints about the posture [rad]."""
SHARES = (0.6, 0.8)
"""Shares s of (1), of thrusters and of motors."""
CURRENT = 0.2
"""Speed of the water that the certificate is to cover [m/s]."""
FRICTION = 0.1
"""Friction of a joint that it is to cover [N m]; of a weak motor a fifth of its effort."""
TILTING = 1.5
"""Angular over linear disturbance of the hull [rad/m]."""
TAKEN = 2.5
"""Largest tightening of an input by the tube, over `input_gain` times the disturbance."""
MANOEUVRE = (0.05, 0.1, 1.0)
"""Accelerations that a plan wants at least: linear, angular, of a joint [m/s², rad/s²]."""
SPARE = 8.0
"""Multiple of these that it is given where the limit is unknown."""
MOST = (2.0, 6.0, 20.0)
"""Inputs that are enough, in addition to those of the task: linear, angular, of a joint."""
UNKNOWN = 3.0
"""Multiple of these for a wall that is unknown, too."""
GAINS = (10.0, 20.0, 30.0, 40.0, 60.0, 80.0)
"""Candidates for k = σ [1/s]."""
STIFFNESS = 1000.0
"""Stiffness of the wall of the base [N/m]."""
WEAKEST = 0.2
"""Least share of the disturbance that is worth a certificate."""
TILT = 0.25
"""Limit of roll and pitch of the vehicle [rad]."""
STATES, ABOVE = 200, 1.1
"""Random postures of the suprema in a declared tube, and the factor on their largest values."""
REMAINDER = 2.0
"""Factor for the remainders of velocities, attitude and inputs in it."""
TERMINAL = 0.1
"""Radius of the terminal set without a certificate."""
TEMPLATE = Path(__file__).with_name("first_scenario.template")
"""Text of a scenario's file, with a name in braces for each of its numbers."""


class Strength(NamedTuple):
    """Largest generalised force of a robot by coordinate (6+n,), and its source."""

    force: np.ndarray
    """τ_max [N, N m]; infinite where unknown."""
    names: tuple[str, ...]
    """Source of the limit."""


@dataclass(frozen=True)
class FirstScenario:
    """The numbers of a scenario for a robot."""

    force: np.ndarray
    """𝔉_des, force part (3,) [N]."""
    frame: np.ndarray
    """Angles of the task's frame (3,) [rad]."""
    pose: np.ndarray
    """Angles (3,) of the end-effector on the wall, about it [rad]."""
    posture: np.ndarray
    """q_des (n,) [rad]."""
    dexterity: float
    """σ_min(J_sq) there."""
    eta: np.ndarray
    """Vehicle's pose at the start (6,) [m, rad]."""
    q_limits: np.ndarray
    """Smallest and largest joint angles (2, n) [rad]."""
    u: np.ndarray
    """Limits of the inputs (6+n,) [m/s², rad/s²]."""
    strength: Strength
    tau_eq: np.ndarray
    """Generalised force that holds the task (6+n,) [N, N m]."""
    disturbance: np.ndarray
    """Semi-axes of its ellipsoid (6+n,) [m/s², rad/s²]."""
    covered: float
    """Covered share of `CURRENT` and `FRICTION`."""
    gain: float
    """k = σ [1/s]."""
    undriven: tuple[str, ...]
    """Axes that they do not drive."""
    short: tuple[str, ...]
    """Axes whose limit of the input is above that of thrusters or motors, for a disturbance that an
    author has declared."""
    tube: TubeRadii
    """Radii for runs without a certificate."""
    terminal_radius: float = TERMINAL
    """ε of these."""
    source: str = "closed forms of the law for this robot and disturbance"
    """Source of both."""
    nu1: float = 0.2
    """Limit of the vehicle's speed [m/s]."""
    nu2: float = 0.2
    """Limit of its angular speed [rad/s]."""
    qdot: float = 0.3
    """Limit of the joints' speed [rad/s]."""
    horizon: int = 15
    """Steps of a plan."""
    time_step: float = 0.2
    """Time of each [s]."""

    def weaker(self, share: float) -> "FirstScenario":
        """Returns the same against a part of the disturbance."""
        return replace(self, disturbance=share * self.disturbance, covered=share * self.covered)


class Choices(NamedTuple):
    """Choices of an author, in place of those that `first_scenario` makes for a robot."""

    into: np.ndarray | None = None
    """Direction into the surface (3,), a unit vector in Σ_I; None: that of the tool."""
    place: np.ndarray = np.zeros(3)
    """Point of the surface to press on (3,) in Σ_I [m]."""
    posture: np.ndarray | None = None
    """Joint angles q_des (n,) [rad]; None: those of `find_posture`."""
    disturbance: np.ndarray | None = None
    """Semi-axes of the disturbance (6+n,) [m/s², rad/s²]; None: as much as the robot leaves of a
    current and friction."""


MADE = Choices()
"""No choice of an author."""


def first_scenario(uvms: Uvms, force: float, distance: float = 0.2, chosen: Choices = MADE
                   ) -> FirstScenario:
    """Returns a scenario in which a robot swims to a wall and presses on it.

    Args:
        uvms: The robot, in a finalized plant.
        force: Along the tool [N].
        distance: From the tip to the wall at the start [m].
        chosen: Choices that are made already.

    Raises:
        RunFailed: It cannot be done with this robot; says why.
        InvalidParameter: A choice does not go with the robot.
    """
    # The task: the vehicle level, the tool along the normal, in a frame without singularity.
    world = UvmsModel(uvms)
    require(chosen.posture is None or bool(
        np.all((world.q_lower <= chosen.posture) & (chosen.posture <= world.q_upper))), "posture",
        chosen.posture, f"within the robot's joint limits, {world.q_lower} to {world.q_upper}")
    posture, dexterity = find_posture(world) if chosen.posture is None else (
        chosen.posture, dexterity_at(world, chosen.posture))
    tool = world.task_pose(_headed(posture, 0.0))
    pitch, heading = _attitude(chosen.into, tool)
    steep = abs(pitch) > STEEP
    frame = np.array([0.0, pitch, heading]) if steep else np.zeros(3)
    model = UvmsModel(uvms, frame)
    into = rotation_matrix(frame)[:, 0] if chosen.into is None else chosen.into
    pose = np.round(model.task_pose(_headed(posture, heading - tool[5]))[3:6], 4)
    config = model.configuration(np.concatenate([chosen.place, pose, posture]))
    wrench = np.concatenate([force * into, np.zeros(3)])
    # The input that holds it, and the one that motors and thrusters leave for the disturbance.
    at, rest = model.kinematics(config), np.zeros(model.size)
    M, J = model.mass_matrix(at), model.task_jacobian(config)[:6]
    bias, inertia = model.inverse_dynamics(at, rest, rest), np.diag(M)
    tau_eq = bias + J.T @ wrench
    u_eq = np.abs(np.linalg.solve(M, tau_eq))
    strength = strength_of(uvms)
    wanted = chosen.disturbance if chosen.disturbance is not None else (
        _disturbance(model, config, inertia, strength.force))
    n = model.num_joints
    share = np.repeat(SHARES, [6, n])
    margin = share * (strength.force - np.abs(tau_eq)) / inertia
    manoeuvre = np.repeat(MANOEUVRE, [3, 3, n])
    taken = TAKEN * input_gain(1.0, 1.0) * wanted
    shares = (margin - manoeuvre) / taken
    covered = 1.0 if chosen.disturbance is not None else float(min(1.0, np.min(shares)))
    if covered < WEAKEST:
        # The least forces to move with, also of stronger motors, which have more friction.
        strong = _disturbance(model, config, inertia, np.full(model.size, np.inf))
        reserve, if_strong = (
            inertia / share * (manoeuvre + WEAKEST * TAKEN * input_gain(1.0, 1.0) * each)
            for each in (wanted, strong))
        holding = Holding(bias, J[:3].T @ into, reserve, if_strong, strength.force)
        i = int(np.argmin(shares))
        raise RunFailed(
            f"not with this robot, because {strength.names[i]} gives {strength.force[i]:.3g} "
            f"{unit_of(i)} along {coordinate(i)}, of which {holding.said(i, force)} at rest, and "
            f"has to move {inertia[i]:.3g} {'kg' if i < 3 else 'kg m²'}: too little is left "
            f"against a current of {WEAKEST * CURRENT:.2g} m/s and friction of "
            f"{WEAKEST * FRICTION:.2g} N m; what would help: "
            f"{what_helps(uvms, config, holding, force)}")
    needed = covered * taken + SPARE * manoeuvre
    most = np.maximum(needed, np.repeat(MOST, [3, 3, n]))
    # A disturbance that an author declares counts, even if thrusters leave less for it.
    short = shares < covered
    u = u_eq + np.where(np.isfinite(margin) & ~short, np.minimum(margin, most), needed)
    # The start: in front of the wall, a little off the task.
    limits = np.array([world.q_lower, world.q_upper])
    across = rotation_matrix(np.array([0.0, 0.0, heading])) @ np.array([0.0, -0.02, -0.02])
    start = config[:6] + np.concatenate([across - distance * into, [0.0, 0.0, 0.02]])
    gain, q_limits = _gain(model, config, covered * wanted, force), np.clip(
        [posture - HALF_RANGE, posture + HALF_RANGE], *limits)
    return FirstScenario(
        force=force * into, frame=frame, pose=pose, posture=posture, dexterity=dexterity,
        eta=start, q_limits=q_limits,
        u=u, strength=strength, tau_eq=tau_eq, disturbance=covered * wanted, covered=covered,
        gain=gain,
        tube=declared_tube(model, q_limits, covered * wanted, gain),
        undriven=() if uvms.thrusters is None else tuple(uvms.thrusters.undriven),
        short=tuple(coordinate(i) for i, is_short in enumerate(short) if is_short))


def _attitude(into: np.ndarray | None, tool: np.ndarray) -> tuple[float, float]:
    """Returns pitch and heading of the inward normal [rad], given the level tool's χ (6,)."""
    pitch = float(tool[4])
    if into is None:
        return pitch, 0.0
    level = float(np.hypot(into[0], into[1]))
    inward = float(np.arctan2(-into[2], level))
    require(abs(inward - pitch) <= STEEP, "surface.normal", -into,
            f"within {STEEP:g} rad of opposite to the tool, which points {abs(pitch):.3g} rad "
            f"{'up' if pitch > 0.0 else 'down'} from level at this posture of a level vehicle")
    return inward, float(np.arctan2(into[1], into[0])) if level > 1e-9 else 0.0


def find_posture(model: UvmsModel) -> tuple[np.ndarray, float]:
    """Returns joint angles (n,) [rad] that are good to press with, and σ_min(J_sq) there.

    Sought is the largest σ_min(J_sq) with the tool level and far forward: of three joints and more,
    J_sq is that of `best_rows`; of fewer, of the tip's position.
    """
    n = model.num_joints
    if n == 0:
        return np.zeros(0), 1.0
    lower, upper = model.joint_range()
    margin = np.minimum(MARGIN, 0.25 * (upper - lower))
    lower, upper = lower + margin, upper - margin

    def forward_reach(chi: np.ndarray) -> np.ndarray:
        return chi[:, 0] * np.cos(chi[:, 5]) + chi[:, 1] * np.sin(chi[:, 5])

    def score(q: np.ndarray) -> np.ndarray:
        chi = model.task_pose(np.concatenate([np.zeros((len(q), 6)), q], axis=1))
        short = np.maximum(0.0, FORWARD_SHARE * reach - forward_reach(chi)) / (0.1 * abs(reach))
        dexterity = np.log(np.maximum(dexterities(model, q), 1e-12))
        return (dexterity - (chi[:, 4] / LEVEL) ** 2 - (chi[:, 5] / SIDEWAYS) ** 2
                - (chi[:, 3] / ROLLED) ** 2 - short**2)

    # Random postures, then smaller and smaller steps about the best one.
    rng = np.random.default_rng(0)
    tried = rng.uniform(lower, upper, (POSTURES, n))
    chi = model.task_pose(np.concatenate([np.zeros((POSTURES, 6)), tried], axis=1))
    reach = float(np.max(forward_reach(chi)))
    best = tried[np.argmax(score(tried))]
    for size in ROUNDS:
        near = np.clip(best + rng.normal(0.0, size, (POSTURES // 10, n)), lower, upper)
        near[0] = best
        best = near[np.argmax(score(near))]
    best = np.clip(np.round(best, 2), lower, upper)
    return best, dexterity_at(model, best)


def dexterity_at(model: UvmsModel, posture: np.ndarray) -> float:
    """Returns σ_min(J_sq) at joint angles (n,); 1 of a robot without joints."""
    return float(dexterities(model, posture[None])[0]) if model.num_joints else 1.0


def strength_of(uvms: Uvms) -> Strength:
    """Returns the largest forces of thrusters and motors, the weaker way, by coordinate."""
    force = np.full(6 + len(uvms.joints), np.inf)
    names = ["no source"] * 6 + [f"the motor of joint {joint.name()}" for joint in uvms.joints]
    if uvms.thrusters is not None:
        thrusters = ThrusterModel.of(uvms.thrusters)
        for axis in (axis for axis in range(6) if axis not in thrusters.undriven):
            force[axis] = weaker_wrench(thrusters, axis)
            names[axis] = "thrusters.yaml"
    for i, motor in enumerate(map(uvms.motor, uvms.joints)):
        if motor is not None:
            force[6 + i] = motor.effort_limit()
    return Strength(force, tuple(names))


def _headed(posture: np.ndarray, yaw: float) -> np.ndarray:
    """Returns 𝔮 (6+n,) of a level vehicle at the origin."""
    return np.concatenate([np.zeros(5), [yaw], posture])


def _disturbance(model: UvmsModel, config: np.ndarray, inertia: np.ndarray, strength: np.ndarray
                 ) -> np.ndarray:
    """Returns semi-axes (6+n,): a current's drag on the hull, friction at the joints, over M."""
    at, rest = model.kinematics(config), np.zeros(model.size)
    still = model.inverse_dynamics(at, rest, rest)
    linear = []
    for axis in (0, 1):
        flow = rest.copy()
        flow[axis] = CURRENT
        linear.append(abs((model.inverse_dynamics(at, flow, rest) - still)[axis]) / inertia[axis])
    hull = max(max(linear), 0.02)
    friction = np.minimum(FRICTION, 0.2 * strength[6:])
    return np.concatenate([np.full(3, hull), np.full(3, TILTING * hull), friction / inertia[6:]])


def pressed_inputs(uvms: Uvms, found: FirstScenario, walls: SurfaceClass, force: float
                   ) -> np.ndarray:
    """Returns limits of the inputs (6+n,) with every force of a class of walls [m/s², rad/s²].

    With N its largest part along n and ψ its largest angle to it, and s the `SHARES`,

        |(M⁻¹b)ᵢ| + N (|(M⁻¹Jᵀn)ᵢ| + tan ψ ‖(M⁻¹J_tᵀ)ᵢ‖) + s (τ_max,i − the same of τᵢ)/Mᵢᵢ,

    or `UNKNOWN` times `MOST` in place of the last term.

    Args:
        uvms: The robot.
        found: Its first scenario.
        walls: The class.
        force: Largest normal force [N].

    Raises:
        RunFailed: A thruster or a motor is too weak for it.
    """
    model, cone = UvmsModel(uvms, found.frame), ForceCone.of_surface(walls, force)
    config = model.configuration(np.concatenate([np.zeros(3), found.pose, found.posture]))
    at, rest = model.kinematics(config), np.zeros(model.size)
    M, J_T = model.mass_matrix(at), model.task_jacobian(config)[:3].T
    bias = model.inverse_dynamics(at, rest, rest)

    # Of generalised forces, and of accelerations.
    by_force = np.stack([J_T, np.linalg.solve(M, J_T)])
    along = by_force @ cone.direction
    across = np.linalg.norm(by_force - along[..., None] * cone.direction, axis=-1)
    taken, u = np.abs([bias, np.linalg.solve(M, bias)]) + cone.largest * (
        np.abs(along) + np.tan(cone.spread) * across)
    blocks, inertia, strength = [3, 3, model.num_joints], np.diag(M), found.strength
    reserve = inertia * np.repeat(MANOEUVRE, blocks)
    missing = taken + reserve - strength.force
    i = int(np.argmax(missing))
    if missing[i] > 0.0:
        raise RunFailed(
            f"not with this robot, because {strength.names[i]} gives {strength.force[i]:.3g} "
            f"{unit_of(i)} along {coordinate(i)}: an unknown wall, of up to {cone.largest:.3g} N "
            f"with errors and friction, takes {taken[i]:.3g} and a motion {reserve[i]:.3g} of it, "
            f"{missing[i]:.3g} {unit_of(i)} more than there is; what would help: a smaller --force "
            "or a stronger one")
    margin = np.repeat(SHARES, [6, model.num_joints]) * (strength.force - taken) / inertia
    limits: np.ndarray = u + np.where(
        np.isfinite(margin), margin, UNKNOWN * np.repeat(MOST, blocks))
    return limits


def _gain(model: UvmsModel, config: np.ndarray, disturbance: np.ndarray, force: float) -> float:
    """Returns the smallest gain by which the deviation is a fifth of the force, or the largest."""
    reach = float(np.linalg.norm(model.task_jacobian(config)[:3] * disturbance, 2))
    enough = [gain for gain in GAINS if STIFFNESS * reach / gain**2 <= 0.2 * force]
    return enough[0] if enough else GAINS[-1]


def declared_tube(model: UvmsModel, q_limits: np.ndarray, disturbance: np.ndarray, gain: float
                  ) -> TubeRadii:
    """Returns radii of the law `resolved` for runs without a certificate; nothing proves them.

    Those of y are max ‖JŴ‖d̃/(kσ), as of `resolved_tube`, over random states in place of all; those
    of velocities, attitude and inputs have no remainders but by a factor.

    Args:
        model: The robot.
        q_limits: Smallest and largest joint angles (2, n) [rad].
        disturbance: Ŵd̃ (6+n,) [m/s², rad/s²].
        gain: k = σ [1/s].
    """
    n, rng, gains = model.num_joints, np.random.default_rng(0), instant_gains(gain, gain)
    tilts = rng.uniform(-TILT, TILT, (STATES, 2))
    postures = rng.uniform(q_limits[0], q_limits[1], (STATES, n))
    J = np.array([model.task_jacobian(np.concatenate([np.zeros(3), tilt, [0.0], posture]))[:6]
                  for tilt, posture in zip(tilts, postures, strict=True)])
    rows = np.concatenate([J, np.broadcast_to(np.eye(6 + n)[6:], (STATES, n, 6 + n))], axis=1)
    e, position, orientation, joints = (
        ABOVE * gains.position * float(np.max(np.linalg.norm(
            rows[:, block] * disturbance, 2, axis=(1, 2)))) if rows[:, block].size else 0.0
        for block in (slice(None), slice(3), slice(3, 6), slice(6, None)))
    nu1, nu2, qdot = (
        factor * gains.velocity * float(np.max(block, initial=0.0)) for factor, block in (
            (REMAINDER, disturbance[:3]), (REMAINDER, disturbance[3:6]), (ABOVE, disturbance[6:])))
    tilt = REMAINDER * gains.position * float(np.max(disturbance[3:6]))
    return TubeRadii(
        e=e, position=position, orientation=orientation, joints=joints,
        z=float(np.linalg.norm([nu1, nu2, qdot])), nu1=nu1, nu2=nu2, qdot=qdot,
        tip_speed=2.0 * gain * position, roll=tilt, pitch=tilt, u=REMAINDER * disturbance)


def format_first_scenario(found: FirstScenario, model: str, robot: str) -> str:
    """Returns the text of a scenario's file.

    Args:
        found: Its numbers.
        model: As `model` has it: a name or a path from the file's folder.
        robot: Name of the robot.
    """
    n, force = len(found.posture), float(np.linalg.norm(found.force))
    bound, weights = float(found.disturbance[0]), found.disturbance / found.disturbance[0]
    known = np.isfinite(found.strength.force)
    thrust = "thrusters.yaml" if np.any(known[:6]) else "unknown without thrusters.yaml"
    tau = np.where(known, found.strength.force, np.ceil(4.0 * np.abs(found.tau_eq) + 20.0))
    text = TEMPLATE.read_text(encoding="utf-8").format(
        robot=robot, model=model, undriven=", ".join(found.undriven), force=force,
        eta=row(found.eta), posture=row(found.posture), normal=exact(-found.force / force),
        covered="" if found.covered == 1.0 else f"{found.covered:.0%} of ",
        current=CURRENT, friction=FRICTION, bound=_number(bound), weights=row(weights, 2),
        wrench=exact([*found.force, 0.0, 0.0, 0.0]), pose=row([0.0, 0.0, 0.0, *found.pose]),
        frame=exact(found.frame), dexterity=found.dexterity, tolerance=_number(0.1 * force),
        tip_pitch=_number(max(0.4, 0.3 + abs(float(found.pose[1])))),
        **{key: getattr(found, key) for key in ("nu1", "nu2", "qdot", "horizon", "time_step")},
        static=_number(max(3.0 * force, force + 3.0)),
        q_lower=row(-_floored(-found.q_limits[0]), 10),
        q_upper=row(_floored(found.q_limits[1]), 10), thrust=thrust,
        u=row(found.u, 2), tau=row(tau, 3), source=found.source, tilt=_number(TILT),
        tube="\n  ".join(
            f"{key}: {row(value, 3) if np.ndim(value) else _number(value)}"
            for key, value in vars(found.tube).items()
            if value is not None and not isinstance(value, HoldRadii)),
        terminal=_number(found.terminal_radius),
        weight_y=row([20.0] * 3 + [10.0] * 3 + [2.0] * n),
        weight_zeta=row([5.0] * 6 + [10.0] * n),
        weight_u=row(np.clip(1.5 / found.u**2, 0.005, 30.0), 2), gain=_number(found.gain),
        step=min(0.02, 0.2 / found.gain))
    return aligned(text)


def aligned(text: str) -> str:
    """Returns a text whose comments at the ends of lines begin in one column."""
    def line_of(line: str) -> str:
        value, mark, comment = line.partition("  # ")
        return f"{value.rstrip():<32}{mark}{comment}" if value.strip() and mark else line

    return "".join(f"{line_of(line)}\n" for line in text.splitlines())


def _number(value: float) -> str:
    return f"{float(f'{value:.3g}'):.10g}"


def _floored(values: np.ndarray) -> np.ndarray:
    """Returns numbers with four decimals that are no larger, but for rounding."""
    return np.floor(1e4 * values + 1e-6) / 1e4


def row(values: Iterable[float], digits: int = 4) -> str:
    """Returns a list of numbers, rounded to digits."""
    rounded = (0.0 if abs(value) < 1e-9 else float(f"{value:.{digits}g}") for value in values)
    return "[" + ", ".join(f"{value:.10g}" for value in rounded) + "]"


def exact(values: Iterable[float]) -> str:
    """Returns a list of numbers that are read as they are."""
    return "[" + ", ".join(f"{value + 0.0:.17g}" for value in values) + "]"
