"""Two robots in one Diagram, side by side on one wall, each with its own controller."""

import argparse
from dataclasses import replace

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder

import uvms_drake as uv

SIDES = {"port": -1.5, "starboard": 1.5}  # y of the places on the wall [m]
FORCES = {"port": 10.0, "starboard": 15.0}  # N


def main() -> None:
    """Swims to the wall with both and presses."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=5.0, help="simulated time [s]")
    arguments = parser.parse_args()
    main_scenario = uv.load_scenario("girona500_ideal")

    builder, robots = DiagramBuilder(), {}
    for name, y in SIDES.items():
        # The scenario, moved along the wall.
        offset = np.array([0.0, y, 0.0, 0.0, 0.0, 0.0])
        task = replace(main_scenario.task, pose=main_scenario.task.pose + offset,
                       force=np.array([FORCES[name], 0.0, 0.0, 0.0, 0.0, 0.0]))
        start = replace(main_scenario.start, eta=main_scenario.start.eta + offset)
        scenario = replace(main_scenario, task=task, start=start)
        ocp = uv.make_ocp(scenario)

        # Plant and controller, connected.
        robots[name] = uvms = builder.AddNamedSystem(f"{name} uvms", uv.make_uvms_plant(
            scenario.model, surface=scenario.surface, disturbance=scenario.disturbance,
            start=scenario.start.config))
        controller = builder.AddNamedSystem(
            f"{name} tube_mpc", uv.make_tube_mpc(ocp, scenario.ancillary))
        builder.Connect(uvms.GetOutputPort("state"), controller.GetInputPort("state"))
        builder.Connect(controller.GetOutputPort("tau"), uvms.GetInputPort("tau"))

    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(uv.with_step(main_scenario).simulator, simulator)
    simulator.AdvanceTo(arguments.duration)
    for name, uvms in robots.items():
        context = uvms.GetMyContextFromRoot(simulator.get_context())
        force = uvms.GetOutputPort("force").Eval(context)[0]
        print(f"{name}: {force:.2f} N, desired {FORCES[name]:.2f} N")


if __name__ == "__main__":
    main()
