"""Forces of Drake's own systems on a robot under water, against power, air and inertia."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import (
    ExternallyAppliedSpatialForce,
    ExternallyAppliedSpatialForceMultiplexer,
    MultibodyPlant,
    Propeller,
    Wing,
)
from pydrake.systems.framework import DiagramBuilder

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.uvms import add_uvms
from uvms_drake.plant.applied_forces import generalized_force
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.plant.hydrodynamics import Hydrodynamics
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state

MODEL = "girona500_arm5e"
AT = np.array([-0.3, 0.2, 0.1])  # m, where a propeller sits on the vehicle
ALONG = RotationMatrix.MakeFromOneVector(np.array([0.6, 0.0, 0.8]), 2)  # its z-axis pushes
POSES = [np.zeros(6), np.array([3.0, -5.0, 0.8, 0.7, -0.4, 2.1])]
JOINTS = np.array([0.2, 0.8, 0.1, -0.4])


@pytest.fixture
def plant(uvms):
    """The robot in a plant of its own, with a Context in motion."""
    context = uvms.plant.CreateDefaultContext()
    rng = np.random.default_rng(0)
    q = np.concatenate([rng.normal(size=7), JOINTS])
    q[:4] /= np.linalg.norm(q[:4])
    uvms.plant.SetPositionsAndVelocities(context, np.concatenate([q, rng.normal(size=10)]))
    return uvms.plant, context


def spatial_force(body, seed):
    rng = np.random.default_rng(seed)
    force = ExternallyAppliedSpatialForce()
    force.body_index, force.p_BoBq_B = body.index(), rng.normal(size=3)
    force.F_Bq_W = SpatialForce(rng.normal(size=3), rng.normal(size=3))
    return force


def forces_on(plant):
    bodies = [plant.get_joint(index).child_body() for index in plant.GetJointIndices()]
    return [spatial_force(body, seed) for seed, body in enumerate(bodies)]


def test_a_generalized_force_does_the_power_of_the_forces(plant):
    plant, context = plant
    forces = forces_on(plant)
    assert len(forces) >= 5
    power = 0.0
    for force in forces:
        body = plant.get_body(force.body_index)
        V, R = body.EvalSpatialVelocityInWorld(context), body.EvalPoseInWorld(context).rotation()
        at = V.translational() + np.cross(V.rotational(), R @ force.p_BoBq_B)
        power += force.F_Bq_W.translational() @ at + force.F_Bq_W.rotational() @ V.rotational()
    tau = generalized_force(plant, context, forces)
    assert tau @ plant.GetVelocities(context) == pytest.approx(power, rel=1e-12)


def test_in_air_a_generalized_force_is_what_the_plant_makes_of_the_forces(plant):
    plant, context = plant
    forces, rates = forces_on(plant), []
    for spatial, generalized in (
            (forces, np.zeros(10)), ([], generalized_force(plant, context, forces))):
        plant.get_applied_spatial_force_input_port().FixValue(context, spatial)
        plant.get_applied_generalized_force_input_port().FixValue(context, generalized)
        rates.append(plant.get_generalized_acceleration_output_port().Eval(context).copy())
    np.testing.assert_allclose(rates[1], rates[0], rtol=1e-10, atol=1e-10)


class Driven:
    """The robot under water with forces of Drake's systems, wired as their headers say."""

    def __init__(self, *kinds):
        builder = DiagramBuilder()
        self.uvms = builder.AddNamedSystem("uvms", make_uvms_plant(
            MODEL, surface=UnilateralPlane(point=np.array([100.0, 0.0, 0.0])),
            disturbance=ConstantDisturbance(0.0)))
        index = self.uvms.GetSubsystemByName("plant").GetBodyByName("vehicle").index()
        self.propellers, ports = [], []
        for kind in kinds:
            if kind == "wing":
                system = builder.AddSystem(Wing(
                    index, surface_area=0.1, fluid_density=1025.0,
                    X_BodyWing=RigidTransform(np.array([0.2, 0.0, -0.3]))))
                builder.Connect(self.uvms.GetOutputPort("body_spatial_velocities"),
                                system.get_body_spatial_velocities_input_port())
                ports.append(system.get_spatial_force_output_port())
            else:
                system = builder.AddSystem(Propeller(index, RigidTransform(ALONG, AT)))
                self.propellers.append(system)
                ports.append(system.get_spatial_forces_output_port())
            builder.Connect(self.uvms.GetOutputPort("body_poses"),
                            system.get_body_poses_input_port())
        total = builder.AddSystem(ExternallyAppliedSpatialForceMultiplexer(len(ports)))
        for i, port in enumerate(ports):
            builder.Connect(port, total.get_input_port(i))
        builder.Connect(
            total.get_output_port(), self.uvms.GetInputPort("applied_spatial_force"))
        self.diagram = builder.Build()
        self.root = self.diagram.CreateDefaultContext()
        self.context = self.uvms.GetMyMutableContextFromRoot(self.root)

    def acceleration(self, eta, thrusts, zeta=None):
        """Returns ζ̇ (10,) at η and the joint angles of this file."""
        zeta = np.zeros(10) if zeta is None else zeta
        set_state(self.uvms, self.context, np.concatenate([eta, JOINTS, zeta]))
        for propeller, thrust in zip(self.propellers, thrusts, strict=True):
            propeller.get_command_input_port().FixValue(
                propeller.GetMyMutableContextFromRoot(self.root), [thrust])
        return self.uvms.GetOutputPort("acceleration").Eval(self.context).copy()


def wrench(thrust):
    """Returns the force and moment (6,) of a propeller about the vehicle's origin."""
    force = thrust * ALONG.matrix()[:, 2]
    return np.concatenate([force, np.cross(AT, force)])


@pytest.mark.parametrize("eta", POSES, ids=["upright", "turned and moved"])
def test_a_propeller_accelerates_robot_and_water_together(model, eta):
    """By the inertia of the controller's model, which is computed without a MultibodyPlant."""
    driven = Driven("propeller")
    change = driven.acceleration(eta, [100.0]) - driven.acceleration(eta, [0.0])
    M = model.mass_matrix(model.kinematics(np.concatenate([eta, JOINTS])))
    expected = np.linalg.solve(M, np.concatenate([wrench(100.0), np.zeros(4)]))
    np.testing.assert_allclose(change, expected, rtol=1e-9, atol=1e-12)


def test_a_wing_brakes_beside_a_propeller():
    """A plate that falls broadside feels ρ w² S upwards, at its place on the vehicle."""
    sinking = np.concatenate([[0.0, 0.0, 0.5], np.zeros(7)])
    change = (Driven("wing", "propeller").acceleration(POSES[0], [0.0], sinking)
              - Driven("propeller").acceleration(POSES[0], [0.0], sinking))
    assert change[2] < -0.02


def test_a_generalized_force_in_the_plants_order_adds_to_tau():
    uvms = Driven("propeller").uvms
    context = uvms.CreateDefaultContext()
    uvms.GetInputPort("applied_spatial_force").FixValue(context, [])
    rates = []
    for name, force in (("tau", [10.0, 20, 30, 4, 5, 6, 0.1, 0.2, 0.3, 0.4]),
                        ("applied_generalized_force",
                         [4.0, 5, 6, 10, 20, 30, 0.1, 0.2, 0.3, 0.4])):
        set_state(uvms, context, np.concatenate([np.zeros(6), JOINTS, np.zeros(10)]))
        for port in ("tau", "applied_generalized_force"):
            uvms.GetInputPort(port).FixValue(context, force if port == name else np.zeros(10))
        rates.append(uvms.EvalTimeDerivatives(context).CopyToVector())
    np.testing.assert_allclose(rates[1], rates[0], rtol=1e-12, atol=1e-12)


def submerged(builder):
    plant = builder.AddNamedSystem("plant", MultibodyPlant(0.0))
    uvms = add_uvms(plant, MODEL)
    plant.Finalize()
    return plant, uvms


@pytest.mark.parametrize("name", ["applied_spatial_force", "actuation"])
def test_a_force_that_came_before_the_water_is_refused(name):
    builder = DiagramBuilder()
    plant, uvms = submerged(builder)
    builder.ExportInput(plant.GetInputPort(name))
    with pytest.raises(InvalidParameter, match=rf"^plant\.{name} = .*: must be free: under water"):
        Hydrodynamics.AddToBuilder(builder, plant, uvms.hydrodynamics)
