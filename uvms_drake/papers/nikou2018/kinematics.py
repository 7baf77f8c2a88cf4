"""The simulation of (sec:simulation_results): χ̇ = J(𝔮)ζ + w, the velocity ζ is the input.

    plan    min Σ_{k<N} h(‖ȳ_k − y_des‖²_Q + ‖ζ̄_k‖²_R) + ‖ȳ_N − y_des‖²_P + ρ s
            s.t. ȳ_{k+1} = Φ(ȳ_k, ζ̄_k), speeds and angles in limits, ‖ȳ_N − y_des‖_P ≤ ε + s
    law     ζ = ζ̄ − σJ(𝔮̄)ᵀ𝔢 of the paper, or ζ = J_x(𝔮)⁻¹[J_x(𝔮̄)ζ̄ − σ𝔢_y] of `resolved`
    robot   𝔮̇ = Γ(𝔮)[ζ + J_x(𝔮)⁻¹(w, 0)], that is ẏ = J_x(𝔮)ζ + (w, 0)

y = (χ, q) is the extended task: w moves the vehicle and with it the end-effector, but not the
joints. A joint of weight zero is free, as in the paper, which weighs only χ − χ_des. A scenario
is run by `kinematic_run.py`, and `kinematic_certificate.py` has the theorem.
"""

import time
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from pydrake.common.value import Value
from pydrake.common.yaml import yaml_load_data
from pydrake.math import RollPitchYaw, RotationMatrix
from pydrake.solvers import ClarabelSolver, MathematicalProgram
from pydrake.systems import framework
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.controllers import DiscreteTimeLinearQuadraticRegulator
from pydrake.systems.primitives import LogVectorOutput

from uvms_drake.common.errors import InvalidParameter, RunFailed, require, vector, within
from uvms_drake.common.progress import Progress, silent
from uvms_drake.common.schema import check_values
from uvms_drake.common.wiring import WiredSystem, output_of, release
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.laws.resolved import Resolved
from uvms_drake.control.limits import Limits, TubeRadii, joint_limits, resolved_radii
from uvms_drake.control.ocp import ocp
from uvms_drake.control.plan.plan import advance_derivatives, advance_one, roll_out
from uvms_drake.control.plan.terminal import Terminal, declared_terminal
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.uvms_model import configuration_rate, configuration_rate_matrix
from uvms_drake.papers.nikou2018.transpose import Transpose
from uvms_drake.plant.disturbance import OpenLoopDisturbance
from uvms_drake.plant.model_error import simulated_uvms
from uvms_drake.plant.surface import pose_and_jacobian
from uvms_drake.report.compare import differing_keys
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import Scenario

FIRST_ITERATIONS = 50
"""Largest number of convex programs of the first plan; a later one has `mpc.iterations`."""
SHORTEST_STEP, TOLERANCE = 1.0 / 64.0, 1e-6
"""Shortest step along the solution of a convex program, and relative gain below which it ends."""
PITCH_MARGIN = 0.01
"""Smallest distance of either pitch from ±π/2 [rad]; there ‖J‖ is about 100."""
BLOCKS = (slice(0, 3), slice(3, 6), slice(6, None))
"""Components of ν₁, ν₂ and q̇."""
WITHOUT = ("sensing", "actuation", "faults", "waves", "current", "model_error", "surface_error",
           "mission", "contact", "supervisor", "draws", "limits.u", "limits.tau",
           "limits.static_force", "limits.thrusters", "limits.more", "mpc.hover", "mpc.deadline",
           "mpc.in_advance", "mpc.solver", "mpc.weight_u", "mpc.terms")
"""Keys of a scenario that have no meaning here."""


# Limits and plans ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Bounds:
    """Limits of the real robot, or of the plan."""

    speeds: np.ndarray
    """Largest ‖ν₁‖, ‖ν₂‖ and ‖q̇‖ (3,) [m/s, rad/s]."""
    lower: np.ndarray
    """Smallest roll and pitch of the vehicle, pitch of the end-effector, joints (3+n,) [rad]."""
    upper: np.ndarray
    """Largest of them."""

    @staticmethod
    def of(limits: Limits, model: ContactModel) -> "Bounds":
        """Returns the limits of the real robot."""
        q_lower, q_upper = joint_limits(limits, model.q_lower, model.q_upper)
        angles = np.array([limits.roll, limits.pitch, limits.tip_pitch])
        bounds = Bounds(np.array([limits.nu1, limits.nu2, limits.qdot]),
                        np.concatenate([-angles, q_lower]), np.concatenate([angles, q_upper]))
        for i, (name, size) in enumerate(
                zip(bounds.names(), [*bounds.speeds, *angles], strict=False)):
            require(0.0 < size < (np.inf if i < len(BLOCKS) else np.pi / 2), f"limits.{name}", size,
                    "positive, of an angle below π/2")
        return bounds

    def tightened(self, tube: TubeRadii) -> "Bounds":
        """Returns those of the plan, whose real motion stays within a tube of these."""
        takes = self.taken(tube)
        speeds, angles = self.speeds - takes[:3], takes[3:]
        out = Bounds(speeds, self.lower + angles, self.upper - angles)
        for name, left in zip(self.names(), [*speeds, *(out.upper - out.lower)], strict=True):
            require(left > 0.0, "tube", name, "such that it leaves something of each limit")
        return out

    def taken(self, tube: TubeRadii) -> np.ndarray:
        """Returns the part of each limit that a tube takes (6+n,), in the order of `names`."""
        tube = resolved_radii(tube)
        joints = np.full(len(self.lower) - 3, tube.joints)
        return np.array([tube.nu1, tube.nu2, tube.qdot, tube.roll, tube.pitch, tube.orientation,
                         *joints], dtype=float)

    def names(self) -> list[str]:
        """Returns the names of all limits, first those of speeds."""
        return ["nu1", "nu2", "qdot", "roll", "pitch", "tip_pitch",
                *(f"q{j + 1}" for j in range(len(self.lower) - 3))]


def limited_angles(config: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Returns the angles (..., 3+n) of `Bounds` at 𝔮 and y (..., 6+n)."""
    return np.concatenate([config[..., 3:5], y[..., 4:5], y[..., 6:]], axis=-1)


class Plan(NamedTuple):
    """Nominal motion over N intervals of length h, on each of which ζ̄ is constant."""

    config: np.ndarray
    """𝔮̄ at the knots (N+1, 6+n) [m, rad]."""
    zeta: np.ndarray
    """ζ̄ on the intervals (N, 6+n) [m/s, rad/s]."""


@dataclass(frozen=True)
class PlanValue:
    """Objective and violations of a plan."""

    cost: float
    slack: float
    violation: float
    total: float

    @property
    def merit(self) -> float:
        """Objective with an exact penalty of the violations."""
        return self.cost + ocp.VIOLATION_PENALTY * self.total


class KinematicMpc:
    """Nominal MPC of the paper: sequential convex programs, each solved by Clarabel.

    Args:
        model: Kinematics of the robot.
        mpc: Horizon, time step, weights and terminal set.
        y_des: Desired extended task (χ_des, q_des) (6+n,).
        bounds: Limits of the plan.
    """

    def __init__(self, model: ContactModel, mpc: ocp.MpcConfig, y_des: np.ndarray, bounds: Bounds):
        size = model.size
        self.model, self.mpc, self.y_des, self.bounds = model, mpc, y_des, bounds
        self.Q = np.diag(ocp.weight(mpc, "weight_y", size, zeros=True))
        self.R = np.diag(ocp.weight(mpc, "weight_zeta", size))
        weighted = np.diag(self.Q) > 0.0
        require(all(weighted[:6]) and len(set(weighted[6:])) <= 1, "weight_y", mpc.weight_y,
                "6 positive numbers, and for the joints positive ones or zeros only")
        radius = mpc.terminal_radius if mpc.terminal_set else np.inf
        if mpc.terminal_weight is None:
            self.terminal = terminal_ingredients(
                model.task_jacobian(model.configuration(y_des)), self.Q, self.R, mpc.time_step,
                radius)
        else:
            P = ocp.weight(mpc, "terminal_weight", size, zeros=True)
            self.terminal = declared_terminal(P, size, radius)

    def plan(self, config: np.ndarray, zeta: np.ndarray) -> Plan:
        """Returns the plan from 𝔮 (6+n,) with velocities (N, 6+n)."""
        return Plan(roll_out(config, zeta, np.zeros_like(zeta), self.mpc.time_step), zeta)

    def resting(self, config: np.ndarray) -> Plan:
        """Returns the plan that stays at 𝔮 (6+n,)."""
        return self.plan(config, np.zeros((self.mpc.horizon, len(config))))

    def errors(self, config: np.ndarray) -> np.ndarray:
        """Returns ξ = y − y_des (..., 6+n) at 𝔮, angles within π; also complex."""
        xi = self.model.task_pose(config) - self.y_des
        xi[..., 3:6] -= 2.0 * np.pi * np.round(xi[..., 3:6].real / (2.0 * np.pi))
        return xi

    def continued(self, plan: Plan) -> Plan:
        """Returns the plan one interval later, its end continued by the terminal controller.

        Outside of the terminal set that gets ξ_N scaled to the set's boundary.
        """
        xi, terminal = self.errors(plan.config[-1]), self.terminal
        size = float(np.linalg.norm(terminal.root @ xi))
        if size > terminal.radius + ocp.FEASIBLE:
            xi = terminal.radius / size * xi
        last = terminal.gain @ xi
        return self.plan(plan.config[1], np.concatenate([plan.zeta[1:], last[None]]))

    def value(self, plan: Plan) -> PlanValue:
        """Returns the objective and the violations of a plan, nothing linearised."""
        xi, h, terminal, bounds = (self.errors(plan.config), self.mpc.time_step, self.terminal,
                                   self.bounds)
        stages = np.sum(xi[:-1] @ self.Q * xi[:-1]) + np.sum(plan.zeta @ self.R * plan.zeta)
        end = float(xi[-1] @ terminal.P @ xi[-1])
        slack = max(0.0, float(np.sqrt(end)) - terminal.radius)
        angles = limited_angles(plan.config, self.y_des + xi)[1:]
        excess = np.concatenate([
            *(np.linalg.norm(plan.zeta[:, block], axis=1) - most
              for block, most in zip(BLOCKS, bounds.speeds, strict=True)),
            (angles - bounds.upper).ravel(), (bounds.lower - angles).ravel()])
        excess = np.maximum(excess, 0.0)
        return PlanValue(float(h * stages) + end + ocp.TERMINAL_PENALTY * slack, slack,
                      float(np.max(excess)), float(np.sum(excess)))

    def solve(self, plan: Plan, iterations: int) -> Plan:
        """Returns the best plan found from one with the same start.

        A step takes the longest of 1, ½, ¼, ... of the way along which the merit falls.
        """
        merit = self.value(plan).merit
        for _ in range(iterations):
            change, step = self.program(plan), 1.0
            while change is not None and step >= SHORTEST_STEP:
                found = self.plan(plan.config[0], plan.zeta + step * change)
                if (lower := self.value(found).merit) < merit:
                    break
                step *= 0.5
            else:
                return plan
            gain, plan, merit = merit - lower, found, lower
            if gain <= TOLERANCE * abs(merit):
                break
        return plan

    def program(self, plan: Plan) -> np.ndarray | None:
        """Returns the change of ζ̄ (N, 6+n) by the convex program about a plan; None: no solution.

        Motion and the vehicle's angles are linearised, and these are softened by v ≥ 0.
        """
        (N, size), h, bounds = plan.zeta.shape, self.mpc.time_step, self.bounds
        now = self.errors(plan.config)
        config_y = configuration_rate_matrix(plan.config) @ np.linalg.inv(
            self.model.task_jacobian(plan.config))
        by_config, by_zeta, _ = advance_derivatives(
            plan.config[:-1], plan.zeta, np.zeros_like(plan.zeta), h)
        y_config = np.linalg.inv(config_y[1:])
        A, B, eye = y_config @ by_config @ config_y[:-1], y_config @ by_zeta, np.eye(size)
        # Rows of the limited angles by ξ, the first two of which are soft.
        rows = np.concatenate([config_y[:, 3:5], np.broadcast_to(
            eye[[4, *range(6, size)]], (N + 1, size - 5, size))], axis=1)
        soft = np.repeat([1.0, 0.0], [2, size - 5])[:, None]
        off = limited_angles(plan.config, self.y_des + now) - (rows @ now[..., None])[..., 0]
        program = MathematicalProgram()
        xi = program.NewContinuousVariables(N + 1, size, "xi")
        zeta = program.NewContinuousVariables(N, size, "zeta")
        s, v = (program.NewContinuousVariables(1, name) for name in "sv")
        program.AddBoundingBoxConstraint(0.0, np.inf, np.concatenate([s, v]))
        program.AddLinearCost(
            [ocp.TERMINAL_PENALTY, ocp.EXCESS_PENALTY], 0.0, np.concatenate([s, v]))
        program.AddBoundingBoxConstraint(now[0], now[0], xi[0])
        for k in range(N):
            program.AddLinearEqualityConstraint(
                np.hstack([A[k], B[k], -eye]), A[k] @ now[k] + B[k] @ plan.zeta[k] - now[k + 1],
                np.concatenate([xi[k], zeta[k], xi[k + 1]]))
            for weights, x in ((self.Q, xi[k]), (self.R, zeta[k])):
                program.AddQuadraticCost(2.0 * h * weights, np.zeros(size), x, is_convex=True)
            for block, most in zip(BLOCKS, bounds.speeds, strict=True):
                _add_norm(program, most, np.eye(len(zeta[k, block])), zeta[k, block])
            for sign, bound in ((1.0, bounds.upper), (-1.0, -bounds.lower)):
                program.AddLinearConstraint(
                    np.hstack([sign * rows[k + 1], -soft]), np.full(len(bound), -np.inf),
                    bound - sign * off[k + 1], np.concatenate([xi[k + 1], v]))
        P, radius = self.terminal.P, self.terminal.radius
        program.AddQuadraticCost(2.0 * P, np.zeros(size), xi[N], is_convex=True)
        if np.isfinite(radius):
            _add_norm(program, radius, self.terminal.root, xi[N], s)
        result = ClarabelSolver().Solve(program)
        return result.GetSolution(zeta) - plan.zeta if result.is_success() else None


def _add_norm(program: MathematicalProgram, size: float, root: np.ndarray, x: np.ndarray,
              *slack: np.ndarray) -> None:
    """Adds ‖root x‖₂ ≤ size, or size + slack."""
    A = np.zeros((1 + len(root), len(x) + len(slack)))
    A[1:, : len(x)], A[0, len(x):] = root, 1.0
    program.AddLorentzConeConstraint(A, np.append(size, np.zeros(len(root))),
                                     np.concatenate([x, *slack]))


def terminal_ingredients(J_x: np.ndarray, Q: np.ndarray, R: np.ndarray, h: float, radius: float
                         ) -> Terminal:
    """Returns P, 𝔎 and ε for ξ⁺ = ξ + hJ_x ζ: the Riccati solution twice, and its controller.

    Where the weight Q of joints is zero, they are left out of the design, and of P.
    """
    size, weighted = len(J_x), np.diag(Q) > 0.0
    kept = np.ix_(weighted, weighted)
    K, riccati = DiscreteTimeLinearQuadraticRegulator(
        A=np.eye(size)[kept], B=h * J_x[weighted], Q=h * Q[kept], R=h * R)
    P, gain = np.zeros((size, size)), np.zeros((size, size))
    P[kept], gain[:, weighted] = riccati + riccati.T, -K
    return Terminal(P=P, gain=gain, radius=radius)


# Law and loop -------------------------------------------------------------------------------------


def velocity(law: AncillaryLaw, model: ContactModel, config: np.ndarray, nominal: np.ndarray,
             nominal_zeta: np.ndarray) -> np.ndarray:
    """Returns ζ (6+n,) of a law at 𝔮, 𝔮̄ and ζ̄ (6+n,); k is not read."""
    error = pose_difference(model.task_pose(config), model.task_pose(nominal))
    J_nominal = model.task_jacobian(nominal)
    if isinstance(law, Transpose):
        return nominal_zeta - law.sigma * J_nominal[law.fed_back].T @ error[law.fed_back]
    return np.linalg.solve(model.task_jacobian(config), J_nominal @ nominal_zeta
                           - law.sigma * error)


class KinematicController(WiredSystem):
    """Nominal MPC and ancillary law: input `config` 𝔮 (6+n), outputs `zeta` ζ and `nominal` (𝔮̄, ζ̄).

    The state is the plan. It is made at t = 0, h, 2h, ..., from the state that the last one
    predicted, or from the measured one if `mpc.initial_state` says so.
    """

    def __init__(self, mpc: KinematicMpc, law: AncillaryLaw):
        super().__init__()
        self._mpc, self._law, size = mpc, law, mpc.model.size
        self._config = self.DeclareVectorInputPort("config", size)
        self._plan = self.DeclareAbstractState(Value(object()))
        self.DeclareInitializationUnrestrictedUpdateEvent(self._plan_first)
        h = mpc.mpc.time_step
        self.DeclarePeriodicUnrestrictedUpdateEvent(h, h, self._plan_again)
        planned = {self.time_ticket(), self.abstract_state_ticket(self._plan)}
        output_of(self, "nominal", 2 * size, lambda c: np.concatenate(self._nominal(c)), planned)
        output_of(self, "zeta", size, lambda c: velocity(
            law, mpc.model, self._config.Eval(c), *self._nominal(c)),
            planned | {self._config.ticket()})

    def _nominal(self, context: framework.Context) -> tuple[np.ndarray, np.ndarray]:
        """Returns 𝔮̄ and ζ̄ now, in the first interval of the plan."""
        start, plan = context.get_abstract_state(int(self._plan)).get_value()
        zeta = plan.zeta[0]
        return (advance_one(plan.config[0], zeta, np.zeros_like(zeta), context.get_time() - start),
                zeta)

    def _plan_first(
        self, context: framework.Context, state: framework.State) -> framework.EventStatus:
        plan = self._mpc.solve(self._mpc.resting(self._config.Eval(context)), FIRST_ITERATIONS)
        if (violation := self._mpc.value(plan).violation) > ocp.FEASIBLE:
            raise RunFailed(f"the nominal MPC has no solution at the start: its plan exceeds a "
                            f"limit by {violation:.3g}")
        return self._remember(context, state, plan)

    def _plan_again(
        self, context: framework.Context, state: framework.State) -> framework.EventStatus:
        mpc = self._mpc
        guess = mpc.continued(context.get_abstract_state(int(self._plan)).get_value()[1])
        if mpc.mpc.initial_state == "measured":
            guess = mpc.plan(self._config.Eval(context), guess.zeta)
        return self._remember(context, state, mpc.solve(guess, mpc.mpc.iterations))

    def _remember(self, context: framework.Context, state: framework.State, plan: Plan
                  ) -> framework.EventStatus:
        state.get_mutable_abstract_state(int(self._plan)).set_value((context.get_time(), plan))
        return framework.EventStatus.Succeeded()


class DisturbedKinematics(WiredSystem):
    """Robot: inputs `zeta` ζ (6+n) and `disturbance` w (6), output `config`, its state 𝔮 (6+n).

    J is computed from Drake's MultibodyPlant, not from the controller's model.
    """

    def __init__(self, robot: str, start: np.ndarray, task_frame: np.ndarray):
        super().__init__()
        self._uvms = simulated_uvms(robot, None)
        self._plant = self._uvms.plant
        self._context, self._coordinates = self._plant.CreateDefaultContext(), Coordinates(
            self._uvms)
        self._R_TW = RotationMatrix(RollPitchYaw(task_frame)).inverse()
        size = self._coordinates.size
        config = self.DeclareContinuousState(framework.BasicVector(vector("start", start, size)))
        self._zeta, self._w = (self.DeclareVectorInputPort(*port) for port in (
            ("zeta", size), ("disturbance", 6)))
        self.DeclareStateOutputPort("config", config)

    def tip_motion(self, config: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns χ (6,) and J (6, 6+n) at 𝔮 (6+n,)."""
        x = self._coordinates.to_drake(np.concatenate([config, np.zeros_like(config)]))
        self._plant.SetPositionsAndVelocities(self._context, x)
        chi, J_v = pose_and_jacobian(self._plant, self._context, self._uvms.tip, self._R_TW)
        return chi, J_v @ np.column_stack([
            self._coordinates.vector_to_drake(x, unit) for unit in np.eye(len(config))])

    def DoCalcTimeDerivatives(  # noqa: D102  Drake's name and meaning
        self, context: framework.Context, derivatives: framework.ContinuousState
    ) -> None:
        config = context.get_continuous_state_vector().CopyToVector()
        zeta, w = self._zeta.Eval(context).copy(), self._w.Eval(context)
        chi, J = self.tip_motion(config)
        for owner, pitch in (("vehicle", config[4]), ("end-effector", chi[4])):
            if not abs(pitch) < 0.5 * np.pi - PITCH_MARGIN:
                raise RunFailed(f"at t = {context.get_time():g} s the pitch of the {owner} is "
                                f"{pitch:.4g} rad: Euler angles are singular at ±π/2")
        zeta[:6] += np.linalg.solve(J[:, :6], w)  # J_x⁻¹(w, 0) = (J_v⁻¹w, 0)
        derivatives.SetFromVector(configuration_rate(config, zeta))


# Runs ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Run:
    """Signals (T, size) of a run, its scenario and its limits."""

    scenario: Scenario
    bounds: Bounds
    time: np.ndarray
    config: np.ndarray
    zeta: np.ndarray
    nominal_config: np.ndarray
    nominal_zeta: np.ndarray
    disturbance: np.ndarray
    chi: np.ndarray
    chi_nominal: np.ndarray
    chi_des: np.ndarray
    wall_time: float

    def arrays(self) -> dict[str, np.ndarray]:
        """Returns the signals by name."""
        return {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}


def posed(scenario: Scenario) -> tuple[ContactModel, np.ndarray, Bounds]:
    """Returns the model, y_des and the limits of a scenario.

    Raises:
        InvalidParameter: It has no meaning for this simulation.
    """
    model = load_model(replace(scenario, simulation=""))
    for key, values in differing_keys([Scenario(), scenario]).items():
        words = key.split(".")
        name = next((name for name in (words[0], ".".join(words[:2])) if name in WITHOUT), None)
        if name is not None:
            is_part = "-" in values  # Of a kind that is not there by default.
            raise InvalidParameter(name if is_part else key, attrgetter(name)(scenario) if is_part
                                   else yaml_load_data(f"value: {values[1]}")["value"],
                                   "left out, where the velocity is the input")
    require(isinstance(scenario.ancillary, Transpose | Resolved), "ancillary",
            type(scenario.ancillary).__name__, "!Transpose or !Resolved")
    check_values(scenario.ancillary)
    require(isinstance(scenario.disturbance, OpenLoopDisturbance), "disturbance",
            type(scenario.disturbance).__name__, "a function of time alone")
    with within("task"):
        posture = vector("posture", scenario.task.posture, model.num_joints)
        y_des = np.concatenate(
            [model.surface.pose_for(np.asarray(scenario.task.force), scenario.task.pose), posture])
    return model, y_des, Bounds.of(scenario.limits, model)


def simulate(scenario: Scenario, progress: Progress = silent) -> Run:
    """Returns a run of the scenario, with its tube.

    Raises:
        InvalidParameter: A value of the scenario cannot be used.
        RunFailed: There is no first plan, or the robot comes near a singularity.
    """
    model, y_des, bounds = posed(scenario)
    disturbance = scenario.disturbance
    assert isinstance(disturbance, OpenLoopDisturbance)
    builder = framework.DiagramBuilder()
    with within("mpc"):
        mpc = KinematicMpc(model, scenario.mpc, y_des, bounds.tightened(scenario.tube))
    # The loop, and its logs.
    robot = builder.AddNamedSystem("robot", DisturbedKinematics(
        scenario.model, scenario.start.config, np.asarray(scenario.task.frame, dtype=float)))
    controller = builder.AddNamedSystem("controller", KinematicController(mpc, scenario.ancillary))
    w = builder.AddNamedSystem(
        "disturbance", disturbance.system(6, scenario.seed)).get_output_port()
    config, zeta = robot.GetOutputPort("config"), controller.GetOutputPort("zeta")
    for port, system in ((config, controller), (zeta, robot), (w, robot)):
        builder.Connect(port, system.GetInputPort(port.get_name()))
    logs = {name: LogVectorOutput(port, builder, scenario.log_period) for name, port in (
        ("config", config), ("zeta", zeta), ("disturbance", w),
        ("nominal", controller.GetOutputPort("nominal")))}
    diagram = builder.Build()
    simulator = Simulator(diagram)
    ApplySimulatorConfig(scenario.simulator, simulator)
    simulator.set_monitor(lambda context: progress(
        f"{context.get_time():.1f} of {scenario.duration:g} s",
        context.get_time() / scenario.duration))
    # The run.
    started = time.perf_counter()
    simulator.AdvanceTo(scenario.duration)
    seconds, context = time.perf_counter() - started, simulator.get_context()
    found = {name: log.FindLog(context).data().T.copy() for name, log in logs.items()}
    instants = logs["config"].FindLog(context).sample_times().copy()
    release(diagram)
    nominal, nominal_zeta = np.split(found.pop("nominal"), 2, axis=1)
    chi, chi_nominal = (model.task_pose(each)[:, :6] for each in (found["config"], nominal))
    return Run(scenario, bounds, instants, **found, nominal_config=nominal,
               nominal_zeta=nominal_zeta, chi=chi, chi_nominal=chi_nominal, chi_des=y_des[:6],
               wall_time=seconds)
