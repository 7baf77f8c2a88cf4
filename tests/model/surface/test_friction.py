"""Friction, against Drake's own."""

import numpy as np
import pytest
from pydrake.geometry import AddContactMaterial, HalfSpace, ProximityProperties, Sphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.framework import DiagramBuilder

from uvms_drake.model.surface.contact_laws import STEEPEST, coulomb, slip_factor

MU, CREEP = 0.35, 0.004


def force(speed):
    """Returns the force per normal force along the velocity."""
    return coulomb(np.array([0.0, speed, 0.0]), MU, CREEP)[1]


def drakes(speed):
    """Returns friction over normal force of a ball that slides on a half-space, in Drake."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    inertia = SpatialInertia(1.0, np.zeros(3), UnitInertia.SolidSphere(0.1))
    ball = plant.AddRigidBody("ball", inertia)
    properties = ProximityProperties()
    AddContactMaterial(dissipation=0.0, point_stiffness=1e4, friction=CoulombFriction(MU, MU),
                       properties=properties)
    plant.RegisterCollisionGeometry(ball, RigidTransform(), Sphere(0.1), "ball", properties)
    plant.RegisterCollisionGeometry(
        plant.world_body(), RigidTransform(), HalfSpace(), "floor", properties)
    plant.Finalize()
    plant.set_stiction_tolerance(CREEP)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    mine = plant.GetMyMutableContextFromRoot(context)
    plant.SetPositions(mine, [1.0, 0, 0, 0, 0, 0, 0.099])
    plant.SetVelocities(mine, [0.0, 0, 0, 0, speed, 0])
    results = plant.get_contact_results_output_port().Eval(mine)
    contact = results.point_pair_contact_info(0).contact_force()
    return abs(contact[1] / contact[2])


@pytest.mark.parametrize("speed", [1e-4, 0.001, 0.002, 0.0035, 0.004, 0.0041, 0.3])
def test_it_is_drakes(speed):
    assert force(speed) == pytest.approx(drakes(speed), rel=1e-9)


def test_the_force_is_along_the_velocity_and_at_most_the_coefficient():
    rng = np.random.default_rng(0)
    velocity = rng.normal(size=(1000, 3)) * 10.0 ** rng.uniform(-5.0, 1.0, (1000, 1))
    out = coulomb(velocity, MU, CREEP)
    size, speed = np.linalg.norm(out, axis=1), np.linalg.norm(velocity, axis=1)
    np.testing.assert_allclose(np.sum(out * velocity, axis=1), size * speed, rtol=1e-12)
    assert np.all(size <= MU * (1.0 + 1e-12))
    np.testing.assert_allclose(size[speed > CREEP], MU)


@pytest.mark.parametrize("slip", [0.0, 1.0])
def test_the_factor_and_its_slope_are_continuous(slip):
    h = 1e-7
    x = slip + h * np.arange(3.0) if slip == 0.0 else slip + h * np.array([-1.0, 0.0, 1.0])
    left, at, right = slip_factor(x)
    slope = 0.0 if slip == 0.0 else -1.0
    np.testing.assert_allclose([(at - left) / h, (right - at) / h], slope, atol=1e-5)


@pytest.mark.parametrize("speed", [0.0, 1e-4, 0.0039, 0.0041, 0.2])
def test_a_complex_step_gives_the_derivative(speed):
    velocity, h = speed * np.array([0.6, 0.0, 0.8]), 1e-9
    for direction in np.eye(3):
        exact = coulomb(velocity + 1e-30j * direction, MU, CREEP).imag / 1e-30
        finite = (coulomb(velocity + h * direction, MU, CREEP)
                  - coulomb(velocity - h * direction, MU, CREEP)) / (2.0 * h)
        np.testing.assert_allclose(exact, finite, atol=1e-4 * MU / CREEP)


def test_the_steepest_slope_is_what_it_is_said_to_be():
    speeds = np.linspace(0.0, 1.5 * CREEP, 3001)
    slopes = np.diff([force(speed) for speed in speeds]) / np.diff(speeds)
    assert np.max(slopes) == pytest.approx(STEEPEST * MU / CREEP, rel=1e-5)
