"""The whole chain on one robot: an unknown wall is found and pressed with the desired force.

The robot follows the plan exactly: the tests are of safe region, target and planner together,
also with a force sensor that fails.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput
from support.tracking import DIRECTION, POSITION, at_rest, tracking_ocp

import uvms_drake as uv
from uvms_drake.common.wiring import outputs, wire
from uvms_drake.control.contact.contact_estimator import ContactEstimator
from uvms_drake.control.contact.contact_state import EstimatorSettings
from uvms_drake.control.contact.press_target import PressTarget
from uvms_drake.control.mpc.nominal_mpc import NominalMpc
from uvms_drake.control.mpc.planner import FAILED, MPC_REPORT
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.sensing.faults import ForceFault, FrozenForce, JumpedForce, LostForce
from uvms_drake.sensing.force_fault_detector import ForceFaultDetector
from uvms_drake.sensing.wrist_sensor import cut_noise

WALLS = SurfaceClass(DIRECTION, stiffness=2000.0, dissipation=2.0)
SENSING = EstimatorSettings(force_max=20.0, noise=0.2, period=0.02, window=0.02)
MARGIN = 1e-4  # m, how far the robot may be off the plan here
DESIRED = 12.0  # N
H = 0.2  # s


class FollowsExactly(LeafSystem):
    """𝔮̇ = Γ(𝔮)ζ, ζ̇ = ζ̄̇, and the force of a wall at `place` on the tip."""

    def __init__(self, model: uv.UvmsModel, start: np.ndarray, place: float, stiffness: float):
        super().__init__()
        self._model, self._place, self._stiffness = model, place, stiffness
        self._acceleration_port = self.DeclareVectorInputPort("acceleration", model.size)
        state = self.DeclareContinuousState(BasicVector(start))
        self.DeclareStateOutputPort("state", state)
        self.DeclareVectorOutputPort("force", 6, self._force, {self.xc_ticket()})

    def DoCalcTimeDerivatives(self, context, derivatives):
        config, zeta = np.split(context.get_continuous_state_vector().CopyToVector(), 2)
        derivatives.get_mutable_vector().SetFromVector(np.concatenate([
            uv.configuration_rate(config, zeta), self._acceleration_port.Eval(context)]))

    def _force(self, context: Context, output: BasicVector) -> None:
        """Hunt and Crossley's, along n."""
        config, zeta = np.split(context.get_continuous_state_vector().CopyToVector(), 2)
        kinematics = self._model.kinematics(config)
        depth = max(kinematics.chi[:3] @ DIRECTION - self._place, 0.0)
        rate = (kinematics.J_chi[:3] @ zeta) @ DIRECTION
        size = self._stiffness * depth * max(1.0 + WALLS.dissipation * rate, 0.0)
        output.SetFromVector(np.append(size * DIRECTION, np.zeros(3)))


class Sampled(LeafSystem):
    """The last sample of a force, with a noise up to `largest` that never repeats itself."""

    def __init__(self, period: float, largest: float):
        super().__init__()
        self._period, self._largest = period, largest
        self._port = self.DeclareVectorInputPort("force", 6)
        state = self.DeclareDiscreteState(6)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._sample)
        self.DeclareStateOutputPort("sample", state)

    def _sample(self, context, state):
        index = round(context.get_time() / self._period)
        sigma = self._largest / np.sqrt(12.0) * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        state.set_value(self._port.Eval(context) + cut_noise(sigma, 2.0, 3, index))


def press(place: float, stiffness: float, duration: float, fault: ForceFault | None = None,
          sensing: EstimatorSettings = SENSING) -> dict[str, np.ndarray]:
    """Returns the MPC's reports, and of a run time, depth in the wall, and if the force is lost."""
    ocp = tracking_ocp(force=1.2 * SENSING.force_max, overrides=(
        "mpc.horizon=5", "mpc.iterations=2"))
    start = at_rest(ocp, POSITION)
    builder = DiagramBuilder()
    robot = builder.AddNamedSystem("robot", FollowsExactly(ocp.model, start, place, stiffness))
    mpc = NominalMpc.AddToBuilder(
        builder, SequentialConvexSolver(ocp), state=robot.GetOutputPort("state"))
    builder.Connect(mpc.GetOutputPort("nominal_acceleration"), robot.get_input_port())
    sampled = builder.AddSystem(Sampled(sensing.period, 0.5 * sensing.noise))
    builder.Connect(robot.GetOutputPort("force"), sampled.get_input_port())
    given = sampled.get_output_port()
    if fault is not None:
        given = fault.add_to(builder, ocp.model, given, uv.Signals(), 0)
    watch = ForceFaultDetector.AddToBuilder(
        builder, ocp.model, sensing.period, repeats=sensing.repeats,
        state=robot.GetOutputPort("state"), force_measured=given)
    estimator = ContactEstimator.AddToBuilder(
        builder, ocp.model, WALLS, sensing.watched, margin=MARGIN,
        state=robot.GetOutputPort("state"), force_measured=watch.GetOutputPort("force_valid"))
    desired = builder.AddSystem(ConstantVectorSource([DESIRED]))
    target = PressTarget.AddToBuilder(
        builder, DIRECTION, POSITION, desired_force=desired.get_output_port())
    wire(builder, target, outputs(estimator))
    builder.Connect(target.GetOutputPort("target"), mpc.GetInputPort("target"))
    builder.Connect(estimator.GetOutputPort("facet_depths"), mpc.GetInputPort("safe_depth"))
    logs = [LogVectorOutput(robot.GetOutputPort("state"), builder, SENSING.period),
            LogVectorOutput(estimator.GetOutputPort("force_lost"), builder, SENSING.period),
            LogVectorOutput(mpc.GetOutputPort("report"), builder, H)]
    diagram = builder.Build()
    simulator = Simulator(diagram)
    ApplySimulatorConfig(SimulatorConfig(
        integration_scheme="runge_kutta3", max_step_size=SENSING.period,
        use_error_control=False), simulator)
    simulator.AdvanceTo(duration)
    state, lost, report = (log.FindLog(simulator.get_context()) for log in logs)
    kinematics = ocp.model.kinematics(state.data()[:10].T)
    return {**dict(zip(MPC_REPORT, report.data(), strict=True)), "time": state.sample_times(),
            "depth": kinematics.chi[:, :3] @ DIRECTION - place, "lost": lost.data()[0] > 0.0}


@pytest.mark.parametrize(("distance", "share"), [(0.06, 1.0), (0.03, 0.3)])
def test_an_unknown_wall_is_pressed_with_the_desired_force_and_never_harder(distance, share):
    """At most F_max at rest in any state that is passed; every problem of the planner feasible."""
    stiffness = share * WALLS.stiffness
    run = press(POSITION @ DIRECTION + distance, stiffness, 12.0)
    force = stiffness * np.maximum(run["depth"], 0.0)
    assert force[0] == 0.0, "it begins in the water"
    assert np.max(force) <= SENSING.force_max
    assert_every_problem_was_feasible(run)
    assert not np.any(run["lost"])
    assert_it_presses(run, force, 10.0)


def assert_every_problem_was_feasible(run):
    assert np.max(run["violation"]) <= 1e-6
    assert np.max(run["terminal_slack"]) <= 1e-6
    assert not np.any(run["status"] == FAILED)


def assert_it_presses(run, force, since):
    settled = run["time"] > since
    assert np.all(np.abs(force[settled] - DESIRED) <= SENSING.noise + WALLS.stiffness * MARGIN)


BEFORE, AT, WHILE = 1.0, 2.5, 5.0
"""Instants before the touch, just before it, and while it presses [s]."""
DURATION = 1.5  # s
FAULTS = {"lost": LostForce, "frozen": FrozenForce,
          "jumped": partial(JumpedForce, jump=-0.5 * SENSING.noise * np.eye(6)[0])}
MARKS = {("frozen", AT): (), ("lost", WHILE): pytest.mark.slow, ("frozen", WHILE): pytest.mark.slow}
"""Marks of faults at their instants; others are `long`."""


@pytest.mark.parametrize(("kind", "start"), [
    pytest.param(kind, start, marks=MARKS.get((kind, start), pytest.mark.long))
    for kind in FAULTS for start in (BEFORE, AT, WHILE)])
def test_a_sensor_that_fails_for_a_while_presses_no_harder_and_it_goes_on_afterwards(kind, start):
    """It leaves the wall if readings are missing; covered faults change nothing."""
    run = press(POSITION @ DIRECTION + 0.03, WALLS.stiffness, 13.5, FAULTS[kind](start, DURATION))
    force = WALLS.stiffness * np.maximum(run["depth"], 0.0)
    assert np.max(force) <= SENSING.force_max
    assert_every_problem_was_feasible(run)
    assert_it_presses(run, force, 13.0)
    while_lost, over = run["time"][run["lost"]], start + DURATION + 2.5 * SENSING.period
    if kind == "jumped":
        assert not len(while_lost)
    else:
        counted = (SENSING.patience + SENSING.repeats + 3) * SENSING.period
        assert start < while_lost[0] <= start + counted
        assert while_lost[-1] <= over
        assert np.all(force[np.abs(run["time"] - over) < 0.1] < 0.6 * SENSING.force_max)


def test_a_frozen_sensor_without_a_detector_makes_it_press_as_hard_as_it_can():
    """The detector matters for the tests above."""
    run = press(POSITION @ DIRECTION + 0.03, WALLS.stiffness, 4.0, FrozenForce(BEFORE, 5.0),
                replace(SENSING, repeats=0))
    assert WALLS.stiffness * np.max(run["depth"]) > 2.0 * SENSING.force_max
    assert not np.any(run["lost"])
