"""Laws of contact: the plane, the paper's spring, the force by the depth, friction; refusals."""

import math
from dataclasses import replace

import numpy as np
import pytest
from pydrake.geometry import AddContactMaterial, HalfSpace, ProximityProperties
from pydrake.geometry import Sphere as Ball
from pydrake.math import RigidTransform
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.framework import DiagramBuilder
from support.shapes import LAWS
from support.surfaces import (
    AT_REST,
    DISSIPATION,
    NORMALS,
    STIFFNESS,
    TRANSITION,
    Sphere,
    moving,
    plane,
    spring,
    stiffness_matrix,
    tip_at,
)

import uvms_drake as uv
from uvms_drake.model.surface.contact_laws import STEEPEST, Bilinear, Hardening, coulomb
from uvms_drake.model.surface.geometry import Bumpy, Cylinder, Plane
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.unknown_contact import HoldForces, UnknownContact


@pytest.mark.parametrize("law", [spring(), plane()], ids=["spring", "plane"])
@pytest.mark.parametrize(("depth", "rate"), [
    (-0.01, 0.2), (0.4 * TRANSITION, 0.3), (0.4 * TRANSITION, -0.3), (0.02, 0.5), (0.02, -0.5)])
def test_a_complex_step_gives_the_derivative(law, depth, rate):
    frame = plane()
    chi, chi_dot = tip_at(frame, depth), moving(frame, rate)
    rng = np.random.default_rng(4)
    a, b = rng.normal(size=(2, 6))
    h = 1e-20
    exact = np.imag(law.force(chi + 1j * h * a, chi_dot + 1j * h * b)) / h
    h = 1e-6
    finite = (law.force(chi + h * a, chi_dot + h * b)
              - law.force(chi - h * a, chi_dot - h * b)) / (2.0 * h)
    np.testing.assert_allclose(exact, finite, atol=1e-3 if depth < TRANSITION else 1e-6)


@pytest.mark.parametrize("law", [spring(), plane()], ids=["spring", "plane"])
def test_at_rest_the_force_changes_by_no_more_than_its_jacobian_says(law):
    """And by just that, of the spring everywhere and of the plane past the transition."""
    frame, rng = plane(), np.random.default_rng(3)
    near = np.array([tip_at(frame, depth, rng) for depth in rng.uniform(-0.01, 0.03, 500)])
    step = 0.002 * rng.normal(size=(500, 6))
    forces = [law.force(chi, np.zeros((500, 6)))[:, :3] for chi in (near, near + step)]
    change = np.linalg.norm(forces[1] - forces[0], axis=1)
    most = np.linalg.norm(step @ law.force_jacobian().T, axis=1)
    assert np.all(change <= most + 1e-9)
    past = np.min([frame.depth(chi[:, :3]) for chi in (near, near + step)], axis=0) > TRANSITION
    assert 100 < np.count_nonzero(past) < 450
    np.testing.assert_allclose(change[past], most[past], atol=1e-9)


@pytest.mark.parametrize(("radius", "message"), [
    (lambda square: np.sqrt(np.abs(square)),
     r"^force = 'Sphere': must be analytic in complex numbers, .*: by [xyz] a complex step gives "
     r"-?[\d.e+-]+, a difference -?[\d.e+-]+$"),
    (lambda square: np.sqrt(square.real),
     r"^force = 'Sphere': must be analytic in complex numbers"),
    (np.vectorize(math.sqrt, otypes=[float]),
     r"^force = 'Sphere': must be a function of complex numbers too \(")],
    ids=["abs", "real", "math.sqrt"])
def test_a_law_whose_derivative_is_lost_in_complex_numbers_is_refused(radius, message):
    with pytest.raises(uv.InvalidParameter, match=message):
        check_surface(Sphere(radius))


def test_a_force_of_another_shape_is_refused():
    class Flat(Sphere):
        def force(self, chi, chi_dot):
            return super().force(chi, chi_dot)[..., :3]

    with pytest.raises(uv.InvalidParameter, match=r"^force = 'Flat': must be \(\.\.\., 6\) for "):
        check_surface(Flat())


@pytest.mark.parametrize("law", [
    uv.UnilateralPlane(stiffness=1e6, transition=1e-5), uv.UnilateralPlane(stiffness=1e-3),
    uv.UnilateralPlane(point=np.array([1e3, 1e3, 0.0])), uv.BilateralSpring(1e6 * np.eye(6)),
    uv.BilateralSpring(1e-3 * np.eye(6)), uv.BilateralSpring(equilibrium=np.full(6, 3.1))])
def test_hard_and_soft_and_distant_surfaces_pass(law):
    check_surface(law)


@pytest.mark.parametrize("law", [spring(), plane()], ids=["spring", "plane"])
def test_the_rows_of_the_static_force_bound_it(law):
    """They are equal to the bound where the force is, and their derivative is that by χ."""
    rng, bound = np.random.default_rng(8), 12.0
    chi = np.concatenate([np.zeros((400, 3)), rng.uniform(-0.2, 0.2, (400, 3))], axis=1)
    chi[:, :3] = law.sample_contact(chi, 2.0 * bound, rng)
    limit = law.static_force_rows(chi, bound)
    value = limit.value[:, 0] if limit.one_sided else np.linalg.norm(limit.value, axis=1)
    np.testing.assert_array_equal(value > limit.bound, law.static_force(chi) > bound)
    assert 0.1 < np.mean(value > limit.bound) < 0.99
    step = 0.001 * rng.normal(size=(400, 6))
    moved = law.static_force_rows(chi + step, bound).value
    np.testing.assert_allclose(moved, limit.value + step @ limit.rows.T, atol=1e-12)


@pytest.mark.parametrize(("rate", "factor"), [
    (0.3, 1.0 + DISSIPATION * 0.3), (-0.3, 1.0 / (1.0 + DISSIPATION * 0.3))])
def test_the_plane_is_harder_on_the_way_in_and_softer_on_the_way_out(rate, factor):
    law, chi = plane(), tip_at(plane(), 0.02)
    np.testing.assert_allclose(
        law.force(chi, moving(law, rate)), factor * law.force(chi, AT_REST), rtol=1e-12)


def test_the_plane_never_pulls_whatever_the_pose_and_speed():
    law, rng = plane(), np.random.default_rng(2)
    for depth, rate in zip(rng.uniform(-0.02, 0.1, 2000), rng.normal(scale=20.0, size=2000),
                           strict=True):
        chi = tip_at(law, depth, rng)
        force = law.force(chi, moving(law, rate))
        assert force[:3] @ law.normal <= 0.0
        np.testing.assert_allclose(np.cross(force[:3], law.normal), 0.0, atol=1e-9)
        np.testing.assert_array_equal(force[3:], 0.0)


@pytest.mark.parametrize(("depth", "rate"), [(0.0, 0.4), (TRANSITION, -0.4), (0.02, 0.0)])
def test_the_force_is_continuously_differentiable_at_every_seam(depth, rate):
    """The derivative along (χ, χ̇) is the same a little before and a little after the seam."""
    law, step, h = plane(), 1e-7, 1e-20
    chi, chi_dot = tip_at(law, depth), moving(law, rate)
    direction = np.append(-law.normal, [0.3, 0.2, 0.1])

    def derivative(s):
        x = (s + 1j * h) * direction
        return np.imag(law.force(chi + x, chi_dot + x)) / h

    scale = STIFFNESS * (1.0 + DISSIPATION)
    np.testing.assert_allclose(derivative(step), derivative(-step), atol=1e-3 * scale)


def test_the_plane_rests_at_the_pose_for_a_force_with_everything_else_as_given():
    law, pose = plane(), tip_at(plane(), -0.3, np.random.default_rng(6))
    force = np.append(-20.0 * law.normal, np.zeros(3))
    chi = law.pose_for(force, pose)
    np.testing.assert_allclose(law.force(chi, AT_REST), force, atol=1e-10)
    np.testing.assert_array_equal(chi[3:], pose[3:])
    np.testing.assert_allclose(np.cross(chi[:3] - pose[:3], law.normal), 0.0, atol=1e-14)


@pytest.mark.parametrize(("force", "pose", "message"), [
    (np.append(20.0 * NORMALS[1], np.zeros(3)), np.zeros(6),
     r"^force = .*: must be −F·normal with F ≥ 1\.245 N and no torque: a plane can only push$"),
    (np.append(-20.0 * NORMALS[1], [0, 0, 1.0]), np.zeros(6), r"^force = .*can only push$"),
    (np.append(-20.0 * NORMALS[1], np.zeros(3)), None,
     r"^pose = None: must be given: a plane leaves five coordinates free$"),
])
def test_a_plane_says_which_forces_it_cannot_carry(force, pose, message):
    with pytest.raises(uv.InvalidParameter, match=message):
        plane().pose_for(force, pose)


def test_the_spring_pulls_and_pushes_by_k_times_its_stretch():
    law = spring()
    stretch = np.array([0.02, -0.01, 0.03, 0.1, -0.2, 0.05])
    for sign in (1.0, -1.0):
        np.testing.assert_allclose(
            law.force(law.equilibrium + sign * stretch, AT_REST),
            sign * stiffness_matrix() @ stretch, rtol=1e-12)


def test_the_spring_does_not_jump_where_an_euler_angle_does():
    """Angles a little below π and a little above −π are the same attitude but for a little."""
    equilibrium = np.array([0.0, 0.0, 0.0, np.pi, 0.0, -np.pi + 0.01])
    law = check_surface(uv.BilateralSpring(stiffness_matrix(), equilibrium))
    chi = np.array([0.0, 0.0, 0.0, -np.pi + 0.02, 0.0, np.pi - 0.01])
    np.testing.assert_allclose(
        law.force(chi, AT_REST), stiffness_matrix() @ [0, 0, 0, 0.02, 0, -0.02], atol=1e-12)


@pytest.mark.parametrize("normal", NORMALS)
def test_past_the_transition_the_plane_is_a_spring(normal):
    law, depth = plane(normal), 0.02
    magnitude = STIFFNESS * (depth - 0.5 * TRANSITION)
    np.testing.assert_allclose(
        law.force(tip_at(law, depth), AT_REST), np.append(-magnitude * normal, np.zeros(3)),
        atol=1e-11)


every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
depths = np.linspace(-0.01, 0.1, 20001)


def slope(law, depth):
    return law.force(depth + 1e-30j).imag / 1e-30


@every_law
def test_outside_there_is_no_force_and_inside_it_grows(law):
    force = law.force(depths)
    np.testing.assert_array_equal(force[depths <= 0.0], 0.0)
    assert np.all(np.diff(force[depths > 0.0]) > 0.0)


@every_law
def test_the_slope_is_that_of_the_force_continuous_and_within_its_bounds(law):
    slopes, (least, most) = slope(law, depths), law.slopes
    finite = np.gradient(law.force(depths), depths)
    np.testing.assert_allclose(slopes[1:-1], finite[1:-1], atol=0.01 * most)
    assert np.max(np.abs(np.diff(slopes))) < 0.02 * most
    past = slopes[depths >= law.transition]
    assert np.max(slopes) == pytest.approx(most)
    assert np.min(past) >= least * (1.0 - 1e-12)
    assert np.min(past) < 1.1 * least


def test_two_straight_lines():
    """The area under the slope: k up to the knee, ratio k after it, both with half a transition."""
    law = LAWS["bilinear"]
    for depth in (0.003, 0.0079):
        assert law.force(np.array(depth)) == pytest.approx(900.0 * (depth - 0.001))
    assert law.force(np.array(0.05)) == pytest.approx(900.0 * 0.008 + 2700.0 * (0.05 - 0.009))


def test_it_hardens_all_the_way_down_and_is_straight_from_there_on():
    law = LAWS["hardening"]
    inside = depths[(depths > law.transition) & (depths < law.depth)]
    assert np.all(np.diff(slope(law, inside)) > 0.0)
    assert slope(law, np.array(law.depth)) == pytest.approx(6.0 * 700.0)
    assert law.force(np.array(0.1)) - law.force(np.array(0.05)) == pytest.approx(6.0 * 700.0 * 0.05)


@every_law
@pytest.mark.parametrize("force", [0.0, 0.01, 3.0, 20.0, 500.0])
def test_the_depth_for_a_force_gives_that_force(law, force):
    assert law.force(np.array(law.depth_for(force))) == pytest.approx(force, rel=1e-12, abs=1e-12)


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
    plant.RegisterCollisionGeometry(ball, RigidTransform(), Ball(0.1), "ball", properties)
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


def test_the_steepest_slope_is_what_it_is_said_to_be():
    speeds = np.linspace(0.0, 1.5 * CREEP, 3001)
    slopes = np.diff([force(speed) for speed in speeds]) / np.diff(speeds)
    assert np.max(slopes) == pytest.approx(STEEPEST * MU / CREEP, rel=1e-5)


CONTACT = UnknownContact()


@pytest.mark.parametrize(("bad", "message"), [
    (uv.UnilateralPlane(normal=np.array([1.0, 1.0, 0.0])), "normal = .*: must be a unit vector"),
    (uv.UnilateralPlane(stiffness=0.0), "stiffness = 0.0: must be positive"),
    (uv.UnilateralPlane(dissipation=1e4), "dissipation = 10000.0: must be at most 1000 s/m"),
    (uv.BilateralSpring(stiffness=-np.eye(6)), "stiffness = .*: must be"),
    (uv.ShapedSurface(Plane(point=np.zeros(2))), "geometry.point = .*: must be 3 finite numbers"),
    (uv.ShapedSurface(Cylinder(axis=np.array([0.6, 0.0, 0.8]))), "axis = .*: must be perp"),
    (uv.ShapedSurface(Bumpy(wavelength=np.inf)), "geometry.wavelength = inf: must be from 0.001"),
    (uv.ShapedSurface(Bumpy(amplitude=0.2, wavelength=0.1)), "geometry.slope = .*: must be at"),
    (uv.ShapedSurface(law=Bilinear(knee=0.001)), "law.knee = 0.001: must be at least the tran"),
    (uv.ShapedSurface(law=Hardening(ratio=0.5)), "law.ratio = 0.5: must be at least 1"),
    (replace(CONTACT, angle=0.5), "angle = 0.5: must be from 0 to 0.45"),
    (replace(CONTACT, hold=HoldForces(force_rate=100.0)), "hold.force_rate = 100.0: must be")])
def test_the_first_bad_value_is_named(bad, message):
    with pytest.raises(uv.InvalidParameter, match=message):
        bad.checked()
