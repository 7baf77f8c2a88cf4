"""A robot without thrust drifts in a current: the plant alone, wired from its parts.

The water carries the Girona 500 along at 0.22 m/s. Drag brings it to the current's speed, more and
more slowly, and turns it across the flow, while its one kilogram of spare buoyancy lifts it.
"""

import argparse

import numpy as np
from pydrake.geometry import MeshcatVisualizer, MeshcatVisualizerParams
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

import uvms_drake as uv
from uvms_drake.model.coordinates import Coordinates
from uvms_drake.plant.hydrodynamics import Hydrodynamics
from uvms_drake.plant.order import ToPaperOrder
from uvms_drake.visual.stage import NED, turn_down

CURRENT = np.array([0.2, 0.1, 0.0])  # m/s, in World (north, east, down)
START = np.array([0.0, 0.0, 20.0, 0.0, 0.0, 0.0])  # η: 20 m deep, level, heading north [m, rad]
ARM = np.array([0.0, 1.1, 0.47, 0.0])  # q: reaching forward [rad]


def main() -> None:
    """Drifts for a minute."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=60.0, help="simulated time [s]")
    parser.add_argument("--meshcat", action="store_true", help="watch it in a browser")
    arguments = parser.parse_args()

    # Robot and water; Hydrodynamics wires itself to the plant's state and force ports.
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    uvms = uv.Robot.load("girona500_arm5e").add_to(plant)
    for joint in uvms.joints:  # A continuous plant has no end stops, and warns of every limit.
        joint.set_position_limits([-np.inf], [np.inf])
    plant.Finalize()
    water = Hydrodynamics.AddToBuilder(builder, plant, uvms.hydrodynamics)
    current = builder.AddNamedSystem("current", ConstantVectorSource(CURRENT))
    builder.Connect(current.get_output_port(), water.GetInputPort("current"))

    # The state as the paper writes it: η, q, then body-fixed velocities.
    coordinates = Coordinates(uvms)
    state = builder.AddNamedSystem("to_paper_order", ToPaperOrder(coordinates))
    builder.Connect(plant.get_state_output_port(), state.GetInputPort("plant_state"))
    if arguments.meshcat:
        meshcat = uv.open_meshcat()
        turn_down(meshcat)  # Meshcat's z-axis points up, ours down.
        MeshcatVisualizer.AddToBuilder(
            builder, scene_graph, meshcat, MeshcatVisualizerParams(prefix=f"{NED}/uvms"))
    diagram = builder.Build()

    simulator = Simulator(diagram)
    simulator.set_target_realtime_rate(10.0 if arguments.meshcat else 0.0)
    context = simulator.get_mutable_context()
    plant.SetPositionsAndVelocities(
        plant.GetMyMutableContextFromRoot(context),
        coordinates.to_drake(np.concatenate([START, ARM, np.zeros(10)])))

    print(f"current: {CURRENT[0]:.2f} m/s north, {CURRENT[1]:.2f} m/s east")
    print(f"{'t [s]':>6}{'north [m/s]':>13}{'east [m/s]':>12}{'depth [m]':>11}{'yaw [deg]':>11}")
    for time in np.linspace(0.0, arguments.duration, 7):
        simulator.AdvanceTo(time)
        v_WB = uvms.vehicle.EvalSpatialVelocityInWorld(
            plant.GetMyContextFromRoot(context)).translational()
        eta = state.GetOutputPort("state").Eval(state.GetMyContextFromRoot(context))[:6]
        print(f"{time:6.1f}{v_WB[0]:13.4f}{v_WB[1]:12.4f}{eta[2]:11.3f}"
              f"{np.degrees(eta[5]):11.2f}")
    print(f"share of the current's speed: {v_WB[:2] @ CURRENT[:2] / (CURRENT @ CURRENT):.3f}")


if __name__ == "__main__":
    main()
