"""The closed loop without a file and without the command line: plant and controller in one Diagram.

Robot, wall, force, law and disturbance are objects; limits, weights of the MPC and the start follow
from the robot. Prints the force on the wall every second. `--certify` computes a certificate first,
and runs with its tube.
"""

import argparse

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder

import uvms_drake as uv


def main() -> None:
    """Swims to the wall and presses."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=10.0, help="simulated time [s]")
    parser.add_argument("--certify", action="store_true", help="takes half a minute")
    arguments = parser.parse_args()
    robot = uv.Robot.load("girona500_arm5e")
    wall = uv.UnilateralPlane(stiffness=2000.0)  # N/m; the plane x = 0, the water is at x < 0
    press = uv.make_scenario(
        robot, wall, force=12.0, posture=[0.0, 1.1, 0.47, 0.0],  # N, rad
        law=uv.Resolved(k=20.0, sigma=5.0), disturbance=0.01)  # 1/s, m/s² or rad/s²
    if arguments.certify:
        certificate = uv.certify(press)
        print(certificate.verdict)
        press = certificate.applied_to(press)

    # Plant and controller are Diagrams with named ports.
    builder = DiagramBuilder()
    plant = builder.AddSystem(uv.make_plant(press))
    controller = builder.AddSystem(uv.make_controller(press))
    for signal in ("state", "force"):
        builder.Connect(plant.GetOutputPort(signal), controller.GetInputPort(signal))
    builder.Connect(controller.GetOutputPort("tau"), plant.GetInputPort("tau"))
    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(press.simulator, simulator)

    print(f"{'t [s]':>6}{'gap [mm]':>10}{'force [N]':>11}{'‖ζ − ζ̄‖':>12}{'MPC step [ms]':>15}")
    root = simulator.get_context()
    plant_context = plant.GetMyContextFromRoot(root)
    controller_context = controller.GetMyContextFromRoot(root)
    for time in np.arange(0.0, arguments.duration + 1e-9, 1.0):
        simulator.AdvanceTo(time)
        state, chi, force = (plant.GetOutputPort(name).Eval(plant_context)
                             for name in ("state", "chi", "force"))
        nominal, seconds = (controller.GetOutputPort(name).Eval(controller_context)
                            for name in ("nominal_state", "solve_seconds"))
        deviation = np.linalg.norm((state - nominal)[len(state) // 2:])
        print(f"{time:6.1f}{-1e3 * chi[0]:10.2f}{force[0]:11.3f}{deviation:12.5f}"
              f"{1e3 * seconds[0]:15.1f}")
    print(f"force at the end: {force[0]:.2f} N, desired {press.task.force[0]:.2f} N")


if __name__ == "__main__":
    main()
