"""Drake's own Propeller as thrusters of the vehicle: six of them, wired as its documentation says.

The controller asks for a wrench; its allocation to the thrusters is one matrix here. Their forces
act on the robot by the port `applied_spatial_force`, and accelerate its added mass, too. Thrusters
with lag, saturation and dead band are a part of a scenario, `actuation: [!Thrusters {}]`.
"""

import argparse

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import Propeller, PropellerInfo
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import MatrixGain

import uvms_drake as uv

PLACES = np.array([[-0.6, -0.35, 0.0], [-0.6, 0.35, 0.0], [0.5, -0.35, 0.0], [0.5, 0.35, 0.0],
                   [-0.6, 0.0, 0.0], [0.0, 0.0, -0.4]])  # p_BoP_B [m]
AXES = np.array([[1, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 1], [0, 0.8, 0.6], [0, 1, 0]])


def main() -> None:
    """Presses on the wall, driven by propellers."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=5.0, help="simulated time [s]")
    arguments = parser.parse_args()
    scenario = uv.load_scenario("girona500_ideal")
    ocp, builder = uv.make_ocp(scenario), DiagramBuilder()
    uvms = builder.AddSystem(uv.make_uvms_plant(
        scenario.model, surface=scenario.surface, disturbance=scenario.disturbance,
        start=scenario.start.config))
    controller = builder.AddSystem(uv.make_tube_mpc(ocp, scenario.ancillary))
    builder.Connect(uvms.GetOutputPort("state"), controller.GetInputPort("state"))

    # Joint torques go to the joints, the vehicle's wrench to the thrusters.
    wrench_of_thrusts = np.vstack([AXES.T, np.cross(PLACES, AXES).T])
    joints = builder.AddSystem(MatrixGain(np.diag([0.0] * 6 + [1.0] * ocp.model.num_joints)))
    allocation = builder.AddSystem(MatrixGain(
        np.linalg.inv(wrench_of_thrusts) @ np.eye(6, ocp.model.size)))
    for gain in (joints, allocation):
        builder.Connect(controller.GetOutputPort("tau"), gain.get_input_port())
    builder.Connect(joints.get_output_port(), uvms.GetInputPort("tau"))

    # The thrust of a propeller is along its z-axis.
    vehicle = uvms.GetSubsystemByName("plant").GetBodyByName("vehicle").index()
    thrusters = builder.AddSystem(Propeller([PropellerInfo(vehicle, RigidTransform(
        RotationMatrix.MakeFromOneVector(axis, 2), place))
        for axis, place in zip(AXES, PLACES, strict=True)]))
    builder.Connect(allocation.get_output_port(), thrusters.get_command_input_port())
    builder.Connect(uvms.GetOutputPort("body_poses"), thrusters.get_body_poses_input_port())
    builder.Connect(thrusters.get_spatial_forces_output_port(),
                    uvms.GetInputPort("applied_spatial_force"))

    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(uv.with_step(scenario).simulator, simulator)
    simulator.AdvanceTo(arguments.duration)
    context = uvms.GetMyContextFromRoot(simulator.get_context())
    force = uvms.GetOutputPort("force").Eval(context)[0]
    print(f"force at the end: {force:.2f} N, desired {scenario.task.force[0]:.2f} N")


if __name__ == "__main__":
    main()
