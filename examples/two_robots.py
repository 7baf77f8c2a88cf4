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
    main_scenario = uv.with_step(uv.load_scenario("girona500_ideal"))

    builder, robots = DiagramBuilder(), {}
    for name, y in SIDES.items():
        # The scenario, moved along the wall.
        offset = np.array([0.0, y, 0.0, 0.0, 0.0, 0.0])
        task = replace(main_scenario.task, pose=main_scenario.task.pose + offset,
                       force=np.array([FORCES[name], 0.0, 0.0, 0.0, 0.0, 0.0]))
        start = replace(main_scenario.start, eta=main_scenario.start.eta + offset)
        scenario = replace(main_scenario, task=task, start=start)

        # Plant and controller, connected.
        robots[name] = plant = builder.AddNamedSystem(f"{name} plant", uv.make_plant(scenario))
        controller = builder.AddNamedSystem(f"{name} controller", uv.make_controller(scenario))
        for signal in ("state", "force"):
            builder.Connect(plant.GetOutputPort(signal), controller.GetInputPort(signal))
        builder.Connect(controller.GetOutputPort("tau"), plant.GetInputPort("tau"))

    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(main_scenario.simulator, simulator)
    simulator.AdvanceTo(arguments.duration)
    for name, plant in robots.items():
        context = plant.GetMyContextFromRoot(simulator.get_context())
        force = plant.GetOutputPort("force").Eval(context)[0]
        print(f"{name}: {force:.2f} N, desired {FORCES[name]:.2f} N")


if __name__ == "__main__":
    main()
