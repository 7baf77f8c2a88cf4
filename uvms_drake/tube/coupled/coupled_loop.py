"""The closed loop at a point: plant, actuation, sensing, law, observer and plan as one.

Each part adds its own linear model, in the order and with the clocks of the Diagram. The plant is
the *true* robot, in water that moves steadily: in axes that move with the water it is still, so

    ζ_w = ζ − (R_WBᵀv_c, 0),    M ζ̇_w + b(𝔮, ζ_w) + Jᵀ𝔉 = τ,    ν̇₁ = ν̇_w − ν₂ × R_WBᵀv_c.        (1)

Equations: tube/coupled/theory.md#coupled-loop.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.control.feedback.linear_feedback import (
    Measured,
    PlanSignals,
    add_linear_feedback,
)
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.model.frames.euler import (
    complex_step_jacobian,
    pose_difference,
    rotation_matrix,
)
from uvms_drake.model.frames.spatial import cross, times
from uvms_drake.model.signals.command_path import IDEAL_PATH, CommandPath
from uvms_drake.model.signals.linear import (
    Block,
    ErrorChannel,
    LinearLoop,
    OperatingPoint,
    Signal,
    stacked,
)
from uvms_drake.model.signals.sensor_actuator import (
    MEASURED_FORCE,
    VEHICLE_WRENCH,
    Actuator,
    Part,
)
from uvms_drake.model.uvms_model import UvmsModel, configuration_rate
from uvms_drake.tube.coupled.periodic import PeriodicSystem, compiled

NEWTON, AT_REST = 20, 1e-9
"""Steps to the undriven axes' equilibrium, and the largest last one [rad]: the gradient is that of
the robot alone, without that of the thrusters' forces."""
ROBOT = "robot"
"""Name of the block of the robot's motion."""
PLAN = "plan"
"""Name of the entry of a plan's accelerations."""
NORMAL_FORCE, FORCE_ACROSS = "force along the normal", "force across the normal"
"""Names of the entries of further forces on the tip."""


@dataclass(frozen=True)
class Wall:
    """Linear wall at the tip: 𝔉 = F n + (κ n nᵀ) Δ𝔭 + (c n nᵀ + s (I − n nᵀ)) 𝔭̇."""

    normal: np.ndarray
    """n (3,), into the wall."""
    force: float = 0.0
    """F [N]."""
    stiffness: float = 0.0
    """κ [N/m]."""
    damping: float = 0.0
    """c [N s/m]."""
    slope: float = 0.0
    """s, of friction by the tip's speed [N s/m]."""

    @property
    def wrench(self) -> np.ndarray:
        """𝔉 at the point (6,)."""
        return np.append(self.force * self.normal, np.zeros(3))

    def reaction(self, moved: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Returns the change of 𝔉 (6,) by that of 𝔭, and by 𝔭̇ (3,)."""
        n = self.normal
        along = self.damping * (n @ velocity)
        return np.append((self.stiffness * (n @ moved) + along) * n + self.slope * (
            velocity - (n @ velocity) * n), np.zeros(3))


@dataclass(frozen=True)
class LoopParts:
    """Parts of a closed loop; `tube.coupled` knows no scenario."""

    model: UvmsModel
    """The controller's model."""
    true: UvmsModel
    """The simulated robot's."""
    law: AncillaryLaw
    sensing: Sequence[Part] = ()
    actuation: Sequence[Actuator] = ()
    filtered: Callable[[LinearLoop, Signal], Signal] | None = None
    """Adds the filter between the force's sensor and the law; None if there is none."""
    current: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """v_c (3,) in Σ_I [m/s]."""
    command_path: CommandPath = IDEAL_PATH
    """Path of the commands through `actuation`, in the controller's model."""
    time_step: float = 0.2
    """Time between two knots of a plan [s]."""


@dataclass(frozen=True)
class CoupledLoop:
    """The loop at a point."""

    at: OperatingPoint
    system: PeriodicSystem
    rows: tuple[str, ...]
    """Names of the outputs: errors of the real robot from its plan; own deviations of undriven axes
    from the point."""
    channels: tuple[ErrorChannel, ...]
    """Errors of the sensors."""
    loop: LinearLoop
    undriven: np.ndarray
    """Axes of the vehicle that the law leaves undriven."""

    @property
    def robot(self) -> Block:
        """The block of the robot's motion."""
        return next(block for block in self.system.states if block.name == ROBOT)

    @property
    def own(self) -> tuple[str, ...]:
        """Rows that are the robot's own deviations: of axes that nothing drives."""
        size = self.at.model.size
        return tuple(self.rows[i] for axis in self.undriven for i in (
            3 + axis, len(self.rows) - size + axis))

    @property
    def plans(self) -> list[str]:
        """Names of the blocks of the plan's motion."""
        return [block.name for block in self.loop.blocks
                if block.name.startswith(PLAN) and block.size == 2 * self.at.model.size]

    def start(self, config: np.ndarray) -> np.ndarray:
        """Returns the state (m,) at the start of a run, of a robot at rest where its plan begins.

        Observers begin at zero, and axes that nothing drives off their equilibrium; the other
        coordinates make no difference here.

        Args:
            config: 𝔮 at the start (6+n,).
        """
        x, size = np.zeros(len(self.system.A)), self.at.model.size
        for block, value in self.loop.starts.items():
            x[self.system.states[block]] = value
        off = np.where(np.isin(np.arange(size), self.undriven), config - self.at.state[:size], 0.0)
        for block, where in self.system.states.items():
            if block.name in (ROBOT, *self.plans):
                x[where][:size] = off
        return x

    def entry(self, name: str) -> Block:
        """Returns an entry by its name."""
        return next(block for block in self.system.entries if block.name == name)


def operating_point(parts: LoopParts, config: np.ndarray, wall: Wall) -> OperatingPoint:
    """Returns the equilibrium at rest near 𝔮 (6+n,).

    Axes that the law leaves undriven move to their own equilibrium, under the force that the
    actuators exert there along with that on the others.

    Raises:
        InvalidParameter: They have none.
    """
    config, size = np.array(config, dtype=float), parts.true.size
    undriven = _undriven(parts.law)

    def tau(config: np.ndarray) -> np.ndarray:
        still = np.zeros(size, dtype=config.dtype)
        still[:3] = -(rotation_matrix(config[3:6]).T @ parts.current)
        return parts.true.inverse_dynamics(
            parts.true.kinematics(config), still, np.zeros_like(still), wall.wrench)

    step = np.zeros(len(undriven))
    for _ in range(NEWTON if undriven.size else 0):
        gradient = complex_step_jacobian(tau, config + 0j)[np.ix_(undriven, undriven)]
        needed = tau(config)
        given = np.where(np.isin(np.arange(size), undriven), 0.0, needed)
        for part in parts.actuation:
            given = part.exerted(parts.model, given)
        step = np.linalg.solve(gradient, (needed - given)[undriven])
        config[undriven] -= step
    require(bool(np.all(np.abs(step) < AT_REST)), "ancillary.undriven", undriven.tolist(),
            "axes with an equilibrium at the task")
    exerted = known = tau(config)
    for part in reversed(parts.actuation):
        known = part.modelled(parts.model, known)
    return OperatingPoint(
        parts.model, np.append(config, np.zeros(size)), wall.wrench, exerted, known)


def coupled_loop(parts: LoopParts, at: OperatingPoint, wall: Wall, *, planned: bool = False
                 ) -> CoupledLoop:
    """Returns the loop at a point.

    Args:
        parts: Its parts.
        at: The point, see `operating_point`.
        wall: The wall.
        planned: Whether the plan's accelerations are an entry, too.

    Raises:
        InvalidParameter: A part has no linear model.
    """
    loop, size = LinearLoop(), at.model.size
    signals = _add_plant(loop, parts, at, wall)

    # Sensing, in series, and the force through its filter.
    measured = _chain(loop, at, signals, parts.sensing, signals["state"], "sensing")
    force = signals.get(MEASURED_FORCE)
    if force is not None and parts.filtered is not None:
        force = parts.filtered(loop, force)

    # Law, actuation, and back to the plant; wrench and applied force are connected afterwards.
    wrench, applied = loop.port("wrench", 6), loop.port("applied", size)
    plan = _add_plan(loop, parts, at, wall) if planned else PlanSignals(
        *(Signal(length, {}) for length in (2 * size, size, size)))
    has_wrench = parts.law.takes_wrench and parts.command_path.has_thrusters
    command = add_linear_feedback(loop, parts.law, at, Measured(
        measured, force, wrench if has_wrench else None, applied), plan)
    exerted = _chain(loop, at, signals, parts.actuation, command, "actuation")
    loop.connect(signals["tau"], exerted)
    loop.connect(wrench, signals.get(VEHICLE_WRENCH, exerted[:6]))
    known = exerted
    if has_wrench:
        known = stacked([signals[VEHICLE_WRENCH], exerted[6:]])
    loop.connect(applied, known)
    names, rows = _outputs(parts, at, wall, signals["state"], plan.state)
    return CoupledLoop(at, compiled(loop, rows), names, tuple(loop.channels), loop,
                       _undriven(parts.law))


def _undriven(law: AncillaryLaw) -> np.ndarray:
    return np.array(getattr(law, "undriven_rows", ()), dtype=int)


def _chain(loop: LinearLoop, at: OperatingPoint, signals: dict[str, Signal],
           parts: Sequence[Part], signal: Signal, key: str) -> Signal:
    for i, part in enumerate(parts):
        after = part.linear(loop, at, signal, signals)
        if after is None:
            raise InvalidParameter(f"{key}[{i}]", type(part).__name__,
                                   "a part with a linear model, see `Part.linear`")
        signal = after
    return signal


def _add_plant(loop: LinearLoop, parts: LoopParts, at: OperatingPoint, wall: Wall
               ) -> dict[str, Signal]:
    """Adds the robot, the water and the wall, and returns its signals and the port `tau`."""
    true, size = parts.true, at.model.size
    p = true.task_pose(at.state[:size])[:3]
    along, across = loop.entry(NORMAL_FORCE, 1), loop.entry(FORCE_ACROSS, 2)
    axes = frame_of(wall.normal)
    further = np.eye(6, 3) @ (axes[:, :1] @ along + axes[:, 1:] @ across)

    def motion(x: np.ndarray) -> np.ndarray:
        """Returns 𝔮̇, ζ̇, 𝔉 and χ by state, τ and a further 𝔉."""
        config, zeta, tau, further = np.split(x, np.cumsum([size, size, size]))
        kinematics = true.kinematics(config)
        moved = kinematics.chi[:3] - p
        force = wall.wrench + wall.reaction(moved, kinematics.J_chi[:3] @ zeta) + further
        water = rotation_matrix(config[3:6]).T @ parts.current
        relative = np.concatenate([zeta[:3] - water, zeta[3:]])
        b = true.inverse_dynamics(kinematics, relative, np.zeros_like(zeta), force)
        zeta_dot = np.linalg.solve(true.mass_matrix(kinematics), tau - b)
        zeta_dot[:3] -= cross(zeta[3:6], water)
        return np.concatenate([configuration_rate(config, zeta), zeta_dot, force, kinematics.chi])

    by_each = complex_step_jacobian(
        motion, np.concatenate([at.state, at.tau, np.zeros(6)]) + 0j)
    state, tau = loop.state(ROBOT, 2 * size), loop.port("tau", size)
    out = by_each @ stacked([state, tau, further])
    loop.flow(state, out[: 2 * size])
    return {"state": state, "tau": tau, "force": out[2 * size: 2 * size + 6],
            "chi": out[2 * size + 6:]}


def _add_plan(loop: LinearLoop, parts: LoopParts, at: OperatingPoint, wall: Wall) -> PlanSignals:
    """Adds a plan whose acceleration is constant from knot to knot, and its preview."""
    model, size, previews = at.model, at.model.size, parts.command_path.preview
    longest = max(previews)
    entry = loop.entry(PLAN, size)
    by_state = complex_step_jacobian(
        lambda x: configuration_rate(x[:size], x[size:]), at.state + 0j)
    p = model.task_pose(at.state[:size])[:3]

    def later(by: float) -> Signal:
        """Returns 𝔮̄, ζ̄ and ζ̄̇ of a time later by `by`; knots are ticks at the present time."""
        name = f"{PLAN} {by:g} s later"
        acceleration = loop.sampled(f"{name}, acceleration", entry, parts.time_step,
                                    longest - by, -longest)
        state = loop.state(name, 2 * size)
        loop.flow(state, stacked([by_state @ state, acceleration]))
        return stacked([state, acceleration])

    def forces(x: np.ndarray) -> np.ndarray:
        """Returns τ̄ (6+n,) by 𝔮̄, ζ̄ and ζ̄̇, with the predicted reaction of the wall."""
        config, zeta, zeta_dot = np.split(x, 3)
        kinematics = model.kinematics(config)
        tau = model.inverse_dynamics(kinematics, zeta, zeta_dot, np.zeros(6))
        if not wall.force and not wall.stiffness:
            return tau
        along = wall.force + wall.stiffness * (wall.normal @ (kinematics.chi[:3] - p))
        return tau + along * (wall.normal @ kinematics.J_chi[:3])

    # The law's plan, and the change of its forces until they act.
    now = later(0.0)
    preview = Signal(size, {})
    if parts.law.takes_wrench and longest > 0.0:
        by_plan = complex_step_jacobian(forces, np.append(at.state, np.zeros(size)) + 0j)
        rows = np.arange(size) < 6
        for by, chosen in zip(previews, (rows, ~rows), strict=True):
            if by > 0.0:
                preview += np.diag(1.0 * chosen) @ (by_plan @ (later(by) - now))
    return PlanSignals(now[: 2 * size], now[2 * size:], preview)


def frame_of(normal: np.ndarray) -> np.ndarray:
    """Returns n and two directions across it as columns (3, 3)."""
    n = np.asarray(normal, dtype=float)
    about = np.eye(3)[int(np.argmin(np.abs(n))) if abs(n[2]) > SQUARE else 2]
    second = np.cross(about, n)
    second /= np.linalg.norm(second)
    return np.column_stack([n, second, np.cross(n, second)])


SQUARE = 0.9
"""Cosine to the vertical beyond which the directions across a normal are not about it."""


def row_errors(model: UvmsModel, normal: np.ndarray, state: np.ndarray, nominal: np.ndarray
               ) -> np.ndarray:
    """Returns the rows (..., rows) of a real and a nominal motion (..., 2(6+n)) each."""
    size, axes = model.size, frame_of(normal)
    both = np.stack([state, nominal])
    kinematics = model.kinematics(both[..., :size])
    tip = kinematics.chi[..., :3] @ axes
    speed = times(kinematics.J_chi[..., :3, :], both[..., size:]) @ axes
    config = pose_difference(both[0, ..., :size], both[1, ..., :size])
    return np.concatenate([tip[0] - tip[1], config, speed[0] - speed[1],
                           both[0, ..., size:] - both[1, ..., size:]], axis=-1)


def _outputs(parts: LoopParts, at: OperatingPoint, wall: Wall, state: Signal, planned: Signal
             ) -> tuple[tuple[str, ...], list[Signal]]:
    """Returns names and signals of the rows: errors of tip, vehicle, attitude, joints, rates.

    Of an axis that nothing drives, so that it follows no plan, they are the robot's own deviation.
    """
    model, size, axes = at.model, at.model.size, frame_of(wall.normal)
    undriven = _undriven(parts.law)
    error, driven = state - planned, np.ones(2 * size)
    driven[[*undriven, *(undriven + size)]] = 0.0
    own = state - np.diag(driven) @ planned
    J = complex_step_jacobian(lambda config: model.task_pose(config)[:3], at.state[:size] + 0j)

    def velocity(x: np.ndarray) -> np.ndarray:
        return model.tip_kinematics(x[:size]).J_chi[:3] @ x[size:]

    rates = complex_step_jacobian(velocity, at.state + 0j)
    joints = range(1, model.num_joints + 1)
    rows = {
        ("depth", "tip y", "tip z"): axes.T @ (J @ error[:size]),
        ("vehicle x", "vehicle y", "vehicle z", "roll", "pitch", "yaw",
         *(f"q{j}" for j in joints)): own[:size],
        ("depth speed", "tip speed y", "tip speed z"): axes.T @ (rates @ error),
        ("surge", "sway", "heave", "roll rate", "pitch rate", "yaw rate",
         *(f"q{j} rate" for j in joints)): own[size:]}
    return tuple(name for names in rows for name in names), list(rows.values())
