"""A baseline on the simulated robot, with exact measurements and a plane wall or none."""

from typing import NamedTuple

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput

import uvms_drake as uv
from uvms_drake.baselines.baseline import Baseline, RobotGains
from uvms_drake.baselines.law import Law, Measured, PressTask, Reference
from uvms_drake.model.surface.contact_laws import Linear
from uvms_drake.model.surface.geometry import Plane
from uvms_drake.model.surface.law import check_surface

ROBOT = "girona500_arm5e"
POSTURE = np.array([0.0, 1.17, 0.4, 0.0])
FAR = 5.0  # m, of a wall that is not reached


class Press(NamedTuple):
    """Samples of a run."""

    time: np.ndarray
    now: list[Measured]
    """What the laws read."""
    memory: np.ndarray
    """States of the law named "law" (T, m)."""


def task(force: float = 20.0) -> PressTask:
    """Returns a press along x at the origin."""
    return PressTask(np.array([1.0, 0.0, 0.0]), np.zeros(3), np.zeros(3), POSTURE, force)


def run(laws: dict[str, Law], gains: RobotGains, *, seconds: float, stiffness: float = 1000.0,
        depth: float = -FAR, pull: float = 0.0, force: float = 20.0, step: float = 0.005) -> Press:
    """Returns a run from rest, with the tip at a depth in the wall.

    Args:
        laws: As of `Baseline`.
        gains: As of `Baseline`.
        seconds: Duration [s].
        stiffness: Of the wall [N/m].
        depth: Depth of the tip at the start [m].
        pull: Constant force on the tip along x [N].
        force: Desired force [N].
        step: Step of the integrator [s].
    """
    model, pressed = uv.UvmsModel(uv.read_uvms(ROBOT)), task(force)
    start = model.configuration(np.concatenate([[depth, 0.0, 0.0], np.zeros(3), POSTURE]))
    wall = check_surface(uv.ShapedSurface(
        geometry=Plane(point=np.zeros(3), normal=np.array([-1.0, 0.0, 0.0])),
        law=Linear(stiffness=stiffness), dissipation=0.5, friction=0.0))
    builder = DiagramBuilder()
    uvms = builder.AddNamedSystem("uvms", uv.make_uvms_plant(ROBOT, wall, start=start))
    baseline = builder.AddNamedSystem("baseline", Baseline(model, pressed, laws, gains))
    builder.Connect(uvms.GetOutputPort("state"), baseline.GetInputPort("state"))
    builder.Connect(uvms.GetOutputPort("force"), baseline.GetInputPort("force_measured"))
    builder.Connect(baseline.GetOutputPort("tau"), uvms.GetInputPort("tau"))
    kinematics = model.kinematics(start)
    pushed = np.linalg.solve(model.mass_matrix(kinematics), pull * kinematics.J_chi[0])
    source = builder.AddSystem(ConstantVectorSource(pushed))
    builder.Connect(source.get_output_port(), uvms.GetInputPort("disturbance"))
    logs = {name: LogVectorOutput(port, builder, 0.02) for name, port in (
        ("state", uvms.GetOutputPort("state")), ("force", uvms.GetOutputPort("force")),
        ("reference", baseline.GetOutputPort("reference")),
        ("memory", baseline.GetOutputPort("memory")))}
    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(SimulatorConfig(
        integration_scheme="runge_kutta3", max_step_size=step, use_error_control=False), simulator)
    simulator.AdvanceTo(seconds)
    found = {name: log.FindLog(simulator.get_context()) for name, log in logs.items()}
    time = found["state"].sample_times().copy()
    state, read, reference, memory = (found[name].data().T.copy() for name in logs)
    now = [Measured(model, pressed, t, *np.split(x, 2), wrench, Reference.of(values))
           for t, x, wrench, values in zip(time, state, read, reference, strict=True)]
    return Press(time, now, memory)
