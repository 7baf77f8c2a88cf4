"""The whole chain on one robot: a wall that nobody measured is found, and pressed as asked for.

The robot follows the plan exactly: what is tried is whether front, target and planner fit together.
"""

import numpy as np
import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import Adder, ConstantVectorSource, LogVectorOutput, MatrixGain
from support.tracking import DIRECTION, POSITION, at_rest, tracking_ocp

from uvms_drake.control.contact.approach import approach_speed, stopping_room
from uvms_drake.control.contact.explored_front import ExploredFront
from uvms_drake.control.contact.felt import ForceSensing
from uvms_drake.control.contact.target import PressTarget
from uvms_drake.control.nominal_mpc import FAILED, MPC_REPORT, NominalMpc
from uvms_drake.control.scp import SequentialConvexSolver
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.model.uvms_model import UvmsModel, configuration_rate

WALLS = SurfaceClass(DIRECTION, stiffness=2000.0, dissipation=2.0)
SENSING = ForceSensing(force_max=20.0, noise=0.2, period=0.02)
MARGIN = 1e-4  # m, how far the robot may be off the plan here
DESIRED = 12.0  # N
DECELERATION = 0.15  # m/s²
H = 0.2  # s


class FollowsExactly(LeafSystem):
    """𝔮̇ = Γ(𝔮)ζ, ζ̇ = ζ̄̇, and the force of a wall at `place` on the tip."""

    def __init__(self, model: UvmsModel, start: np.ndarray, place: float, stiffness: float):
        super().__init__()
        self._model, self._place, self._stiffness = model, place, stiffness
        self._acceleration_port = self.DeclareVectorInputPort("acceleration", model.size)
        state = self.DeclareContinuousState(BasicVector(start))
        self.DeclareStateOutputPort("state", state)
        self.DeclareVectorOutputPort("force", 6, self._force, {self.xc_ticket()})

    def DoCalcTimeDerivatives(self, context, derivatives):
        config, zeta = np.split(context.get_continuous_state_vector().CopyToVector(), 2)
        derivatives.get_mutable_vector().SetFromVector(np.concatenate([
            configuration_rate(config, zeta), self._acceleration_port.Eval(context)]))

    def _force(self, context: Context, output: BasicVector) -> None:
        """Hunt and Crossley's, along n."""
        config, zeta = np.split(context.get_continuous_state_vector().CopyToVector(), 2)
        kinematics = self._model.kinematics(config)
        depth = max(kinematics.chi[:3] @ DIRECTION - self._place, 0.0)
        rate = (kinematics.J_chi[:3] @ zeta) @ DIRECTION
        size = self._stiffness * depth * max(1.0 + WALLS.dissipation * rate, 0.0)
        output.SetFromVector(np.append(size * DIRECTION, np.zeros(3)))


def press(place: float, stiffness: float, duration: float) -> dict[str, np.ndarray]:
    """Returns the MPC's reports, and of a run the time and the depth in the wall."""
    ocp = tracking_ocp(force=1.2 * SENSING.force_max, overrides=(
        "mpc.horizon=5", "mpc.iterations=2"))
    start = at_rest(ocp, POSITION)
    builder = DiagramBuilder()
    robot = builder.AddNamedSystem("robot", FollowsExactly(ocp.model, start, place, stiffness))
    mpc = NominalMpc.AddToBuilder(builder, SequentialConvexSolver(ocp),
                                  state=robot.GetOutputPort("state"))
    builder.Connect(mpc.GetOutputPort("nominal_acceleration"), robot.get_input_port())
    front = ExploredFront.AddToBuilder(
        builder, ocp.model, WALLS, SENSING, margin=MARGIN, state=robot.GetOutputPort("state"),
        measured_force=robot.GetOutputPort("force"))
    desired = builder.AddSystem(ConstantVectorSource([DESIRED]))
    depth = PressTarget.AddToBuilder(builder, front, desired_force=desired.get_output_port())
    along = builder.AddSystem(MatrixGain(D=DIRECTION[:, None]))
    beside = builder.AddSystem(ConstantVectorSource(POSITION - POSITION @ DIRECTION * DIRECTION))
    target = builder.AddSystem(Adder(2, 3))
    builder.Connect(depth.get_output_port(), along.get_input_port())
    builder.Connect(along.get_output_port(), target.get_input_port(0))
    builder.Connect(beside.get_output_port(), target.get_input_port(1))
    builder.Connect(target.get_output_port(), mpc.GetInputPort("target"))
    builder.Connect(front.GetOutputPort("safe_depth"), mpc.GetInputPort("safe_depth"))
    room = stopping_room(SENSING.force_max, SENSING.noise, WALLS.stiffness, MARGIN)
    speed = builder.AddSystem(ConstantVectorSource([approach_speed(
        room, H, DECELERATION, SENSING.period + H)]))
    builder.Connect(speed.get_output_port(), mpc.GetInputPort("approach_speed"))
    logs = [LogVectorOutput(robot.GetOutputPort("state"), builder, SENSING.period),
            LogVectorOutput(mpc.GetOutputPort("report"), builder, H)]
    diagram = builder.Build()
    simulator = Simulator(diagram)
    ApplySimulatorConfig(SimulatorConfig(
        integration_scheme="runge_kutta3", max_step_size=SENSING.period,
        use_error_control=False), simulator)
    simulator.AdvanceTo(duration)
    state, report = (log.FindLog(simulator.get_context()) for log in logs)
    kinematics = ocp.model.kinematics(state.data()[:10].T)
    return {**dict(zip(MPC_REPORT, report.data(), strict=True)), "time": state.sample_times(),
            "depth": kinematics.chi[:, :3] @ DIRECTION - place}


@pytest.mark.parametrize(("ahead", "share"), [(0.06, 1.0), (0.03, 0.3)])
def test_a_wall_that_nobody_measured_is_pressed_as_asked_for_and_never_harder(ahead, share):
    """At most F_max at rest in any state that is passed; every problem of the planner feasible."""
    stiffness = share * WALLS.stiffness
    run = press(POSITION @ DIRECTION + ahead, stiffness, 12.0)
    force = stiffness * np.maximum(run["depth"], 0.0)
    assert force[0] == 0.0, "it begins in the water"
    assert np.max(force) <= SENSING.force_max
    settled = run["time"] > 10.0
    assert np.all(np.abs(force[settled] - DESIRED) <= SENSING.noise + WALLS.stiffness * MARGIN)
    assert np.max(run["violation"]) <= 1e-6
    assert np.max(run["terminal_slack"]) <= 1e-6
    assert not np.any(run["status"] == FAILED)
