"""The closed loop without the command line: a stiffer wall, a smaller force, another start.

The robot's limits and the weights of the MPC come from the shipped scenario; wall, task, start and
disturbance are set here. Prints the force on the wall every second. Not certified: tube and
terminal radius are those of the shipped wall and force.
"""

import argparse

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from uvms_drake.control.laws import Resolved
from uvms_drake.control.limits import make_limits, tighten
from uvms_drake.control.ocp.dynamic_ocp import DynamicOcp
from uvms_drake.control.tube_mpc import make_tube_mpc
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.plant.disturbance import SinusoidalDisturbance
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state
from uvms_drake.station.scenario.scenario import load_scenario

ROBOT = "girona500_arm5e"
WALL = UnilateralPlane(stiffness=2000.0)  # N/m; the plane x = 0, the water is at x < 0
FORCE = np.array([12.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # 𝔉_des on the wall [N, N m]
POSE = np.zeros(6)  # χ: at the origin, the tool along x [m, rad]; x follows from the force
POSTURE = np.array([0.0, 1.1, 0.47, 0.0])  # q_des [rad]
RETREAT = np.array([-0.15, 0.05, -0.05, 0.0, 0.0, 0.05])  # of the start from the task [m, rad]


def main() -> None:
    """Swims to the wall and presses."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=10.0, help="simulated time [s]")
    arguments = parser.parse_args()
    settings = load_scenario("girona500_ideal")

    # The controller's model, task and tightened limits.
    model = ContactModel.load(ROBOT, check_surface(WALL))
    y_des = np.concatenate([model.surface.pose_for(FORCE, POSE), POSTURE])
    limits = tighten(make_limits(
        settings.limits, model.q_lower, model.q_upper, model.surface), settings.tube)
    ocp = DynamicOcp(model, settings.mpc, y_des, limits)

    # Plant and controller are Diagrams with named ports.
    builder = DiagramBuilder()
    uvms = builder.AddNamedSystem("uvms", make_uvms_plant(
        model=ROBOT, surface=WALL, disturbance=SinusoidalDisturbance(bound=0.05)))
    controller = builder.AddNamedSystem("tube_mpc", make_tube_mpc(ocp, Resolved(k=20.0, sigma=5.0)))
    builder.Connect(uvms.GetOutputPort("state"), controller.GetInputPort("state"))
    builder.Connect(controller.GetOutputPort("tau"), uvms.GetInputPort("tau"))
    diagram = builder.Build()

    # At rest, off the wall.
    simulator = Simulator(diagram)
    simulator.get_mutable_integrator().set_maximum_step_size(0.01)
    root = simulator.get_mutable_context()
    start = model.configuration(y_des)
    start[:6] += RETREAT
    uvms_context = uvms.GetMyMutableContextFromRoot(root)
    set_state(uvms, uvms_context, np.concatenate([start, np.zeros(model.size)]))

    print(f"{'t [s]':>6}{'gap [mm]':>10}{'force [N]':>11}{'‖ζ − ζ̄‖':>12}{'MPC step [ms]':>15}")
    simulator.Initialize()
    controller_context = controller.GetMyContextFromRoot(root)
    for time in np.arange(0.0, arguments.duration + 1e-9, 1.0):
        simulator.AdvanceTo(time)
        state = uvms.GetOutputPort("state").Eval(uvms_context)
        force = uvms.GetOutputPort("force").Eval(uvms_context)
        nominal = controller.GetOutputPort("nominal_state").Eval(controller_context)
        seconds = controller.GetOutputPort("solve_seconds").Eval(controller_context)[0]
        gap = -1e3 * model.task_pose(state[: model.size])[0]
        deviation = np.linalg.norm((state - nominal)[model.size:])
        print(f"{time:6.1f}{gap:10.2f}{force[0]:11.3f}{deviation:12.5f}{1e3 * seconds:15.1f}")
    print(f"force at the end: {force[0]:.2f} N, desired {FORCE[0]:.2f} N")


if __name__ == "__main__":
    main()
