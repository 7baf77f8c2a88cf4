"""The surface laws as functions of χ and χ̇."""

import numpy as np
import pytest

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.euler import rotation_matrix
from uvms_drake.model.surface.law import (
    BilateralSpring,
    UnilateralPlane,
    dissipation_factor,
    make_surface_law,
    plane_load,
    static_force,
)

STIFFNESS, DISSIPATION, TRANSITION = 830.0, 1.7, 0.003  # N/m, s/m, m
NORMALS = [np.array([-1.0, 0.0, 0.0]),
           rotation_matrix(np.array([0.7, -0.4, 2.1])) @ np.array([-1.0, 0.0, 0.0])]
AT_REST = np.zeros(6)


def plane(normal=NORMALS[1], dissipation=DISSIPATION, point=(2.0, -0.3, 1.1)):
    return make_surface_law(UnilateralPlane(
        np.array(point), normal, STIFFNESS, dissipation, TRANSITION))


def stiffness_matrix():
    A = np.random.default_rng(0).normal(size=(6, 6))
    return A @ A.T + np.eye(6)


def spring():
    return make_surface_law(BilateralSpring(
        stiffness_matrix(), np.array([0.4, -0.2, 1.3, 0.1, -0.3, 0.7])))


def tip_at(law, depth, rng=None):
    """Returns χ at a depth in a plane, anywhere along the plane."""
    aside = np.zeros(3) if rng is None else rng.normal(size=3)
    aside -= law.normal * (aside @ law.normal)
    rpy = np.array([0.3, -0.2, 0.5]) if rng is None else rng.uniform(-1.4, 1.4, 3)
    return np.concatenate([law.point + aside - depth * law.normal, rpy])


def moving(law, rate):
    """Returns χ̇ that enters a plane at `rate` while it slides and turns."""
    tangent = np.cross(law.normal, [0.2, -0.7, 0.4])
    return np.concatenate([-rate * law.normal + tangent, [0.4, -0.9, 1.1]])


def work(law, duration=2.0 * np.pi, steps=4000):
    """Returns ∮ 𝔉ᵀχ̇ dt along a closed path through the surface and out of it."""
    center = tip_at(law, 0.001) if hasattr(law, "normal") else law.chi_eq
    amplitude = np.array([0.02, -0.03, 0.015, 0.3, 0.2, -0.4])
    frequency = np.array([1, 2, 3, 2, 1, 4])
    t = np.linspace(0.0, duration, steps, endpoint=False)[:, None]
    chi = center + amplitude * np.sin(frequency * t + np.arange(6))
    chi_dot = amplitude * frequency * np.cos(frequency * t + np.arange(6))
    return np.sum(law.force(chi, chi_dot) * chi_dot) * duration / steps


# The paper's spring ------------------------------------------------------------------------------


def test_the_spring_pulls_and_pushes_by_k_times_its_stretch():
    law = spring()
    stretch = np.array([0.02, -0.01, 0.03, 0.1, -0.2, 0.05])
    for sign in (1.0, -1.0):
        np.testing.assert_allclose(
            law.force(law.chi_eq + sign * stretch, AT_REST), sign * stiffness_matrix() @ stretch,
            rtol=1e-12)


def test_the_spring_does_not_depend_on_velocity():
    law, chi = spring(), np.arange(6.0)
    np.testing.assert_array_equal(law.force(chi, AT_REST), law.force(chi, np.ones(6)))


def test_the_spring_does_no_work_around_a_closed_path():
    assert work(spring()) == pytest.approx(0.0, abs=1e-12)


def test_the_spring_does_not_jump_where_an_euler_angle_does():
    """Angles a little below π and a little above −π are the same attitude but for a little."""
    equilibrium = np.array([0.0, 0.0, 0.0, np.pi, 0.0, -np.pi + 0.01])
    law = make_surface_law(BilateralSpring(stiffness_matrix(), equilibrium))
    chi = np.array([0.0, 0.0, 0.0, -np.pi + 0.02, 0.0, np.pi - 0.01])
    np.testing.assert_allclose(
        law.force(chi, AT_REST), stiffness_matrix() @ [0, 0, 0, 0.02, 0, -0.02], atol=1e-12)


def test_the_spring_rests_at_the_pose_for_a_force():
    law, force = spring(), np.array([20.0, 1.0, -2.0, 0.3, 0.2, -0.1]) * 0.05
    np.testing.assert_allclose(law.force(law.pose_for(force, None), AT_REST), force, atol=1e-12)


# The plane ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("normal", NORMALS)
def test_past_the_transition_the_plane_is_a_spring(normal):
    law, depth = plane(normal), 0.02
    magnitude = STIFFNESS * (depth - 0.5 * TRANSITION)
    np.testing.assert_allclose(
        law.force(tip_at(law, depth), AT_REST), np.append(-magnitude * normal, np.zeros(3)),
        atol=1e-11)


@pytest.mark.parametrize(("rate", "factor"), [
    (0.3, 1.0 + DISSIPATION * 0.3), (-0.3, 1.0 / (1.0 + DISSIPATION * 0.3))])
def test_the_plane_is_harder_on_the_way_in_and_softer_on_the_way_out(rate, factor):
    law, chi = plane(), tip_at(plane(), 0.02)
    np.testing.assert_allclose(
        law.force(chi, moving(law, rate)), factor * law.force(chi, AT_REST), rtol=1e-12)


def test_outside_the_plane_there_is_no_force():
    law = plane()
    np.testing.assert_array_equal(law.force(tip_at(law, -1e-9), moving(law, 3.0)), np.zeros(6))


def test_the_plane_never_pulls_whatever_the_pose_and_speed():
    law, rng = plane(), np.random.default_rng(2)
    for depth, rate in zip(rng.uniform(-0.02, 0.1, 2000), rng.normal(scale=20.0, size=2000),
                           strict=True):
        chi = tip_at(law, depth, rng)
        force = law.force(chi, moving(law, rate))
        assert force[:3] @ law.normal <= 0.0
        np.testing.assert_allclose(np.cross(force[:3], law.normal), 0.0, atol=1e-9)
        np.testing.assert_array_equal(force[3:], 0.0)


def test_the_plane_without_dissipation_does_no_work_around_a_closed_path():
    assert work(plane(dissipation=0.0)) == pytest.approx(0.0, abs=1e-9)


def test_the_plane_with_dissipation_takes_energy_around_a_closed_path():
    assert work(plane()) > 1e-3


@pytest.mark.parametrize("depth", [0.0, TRANSITION])
def test_the_load_and_its_slope_are_continuous(depth):
    h = 1e-7
    left, at, right = plane_load(depth + h * np.array([-1.0, 0.0, 1.0]), TRANSITION)
    slope = 0.0 if depth == 0.0 else 1.0
    np.testing.assert_allclose([(at - left) / h, (right - at) / h], slope, atol=1e-6)


def test_the_dissipation_factor_is_positive_and_its_slope_continuous():
    h = 1e-7
    left, at, right = dissipation_factor(h * np.array([-1.0, 0.0, 1.0]))
    np.testing.assert_allclose([at, (at - left) / h, (right - at) / h], 1.0, atol=1e-6)
    assert np.all(dissipation_factor(np.linspace(-1e6, 1e6, 1001)) > 0.0)


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


def test_the_depth_for_a_force_is_where_the_plane_carries_it():
    law = plane()
    for magnitude in (0.5 * STIFFNESS * TRANSITION, 2.0, 30.0):
        pose = tip_at(law, law.depth_for(magnitude))
        assert static_force(law, pose) == pytest.approx(magnitude, rel=1e-12)
    with pytest.raises(InvalidParameter, match=r"at least 1\.245 N"):
        law.depth_for(1.2)


@pytest.mark.parametrize("law", [spring(), plane()], ids=["spring", "plane"])
def test_a_stack_of_poses_gives_a_stack_of_forces(law):
    rng = np.random.default_rng(5)
    chi = rng.normal(scale=2.0, size=(3, 4, 6))
    chi_dot = rng.normal(size=(3, 4, 6))
    forces, depths = law.force(chi, chi_dot), law.penetration(chi)
    assert forces.shape == (3, 4, 6)
    assert depths.shape == (3, 4)
    for index in np.ndindex(3, 4):
        np.testing.assert_allclose(forces[index], law.force(chi[index], chi_dot[index]), rtol=1e-12)
        np.testing.assert_allclose(depths[index], law.penetration(chi[index]), rtol=1e-12)


def test_a_force_does_not_change_its_arguments():
    for law in (spring(), plane()):
        chi, chi_dot = tip_at(plane(), 0.02), moving(plane(), 0.1)
        copies = chi.copy(), chi_dot.copy()
        law.force(chi, chi_dot)
        np.testing.assert_array_equal((chi, chi_dot), copies)


def test_penetration_is_the_depth_in_a_plane_and_the_stretch_of_a_spring():
    law = plane()
    assert law.penetration(tip_at(law, 0.013)) == pytest.approx(0.013)
    assert law.penetration(tip_at(law, -0.5)) == 0.0
    law = spring()
    assert law.penetration(law.chi_eq + [0.3, 0.0, -0.4, 1, 1, 1]) == pytest.approx(0.5)


def test_the_plane_rests_at_the_pose_for_a_force_with_everything_else_as_given():
    law, pose = plane(), tip_at(plane(), -0.3, np.random.default_rng(6))
    force = np.append(-20.0 * law.normal, np.zeros(3))
    chi = law.pose_for(force, pose)
    np.testing.assert_allclose(law.force(chi, AT_REST), force, atol=1e-10)
    np.testing.assert_array_equal(chi[3:], pose[3:])
    np.testing.assert_allclose(np.cross(chi[:3] - pose[:3], law.normal), 0.0, atol=1e-14)


# Bad input ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("force", "pose", "message"), [
    (np.append(20.0 * NORMALS[1], np.zeros(3)), np.zeros(6),
     r"^force = .*: must be −F·normal with F ≥ 1\.245 N and no torque: a plane can only push$"),
    (np.append(-20.0 * NORMALS[1], [0, 0, 1.0]), np.zeros(6), r"^force = .*can only push$"),
    (np.append(-20.0 * NORMALS[1], np.zeros(3)), None,
     r"^pose = None: must be given: a plane leaves five coordinates free$"),
])
def test_a_plane_says_which_forces_it_cannot_carry(force, pose, message):
    with pytest.raises(InvalidParameter, match=message):
        plane().pose_for(force, pose)


def test_a_spring_says_that_a_force_fixes_the_pose():
    with pytest.raises(InvalidParameter, match=r"^pose = .*: must be left out: "):
        spring().pose_for(np.zeros(6), np.zeros(6))


@pytest.mark.parametrize(("config", "message"), [
    (BilateralSpring(stiffness=np.triu(np.ones((6, 6)))),
     r"^stiffness = .*: must be a symmetric positive definite 6×6 matrix \(it is not symmetric\)$"),
    (BilateralSpring(stiffness=np.diag([1, 1, 1, 1, 1, -3.0])),
     r"^stiffness = .* \(its smallest eigenvalue is -3\)$"),
    (BilateralSpring(stiffness=np.eye(3)), r"^stiffness = .*: must be a symmetric positive def"),
    (BilateralSpring(equilibrium=np.zeros(5)),
     r"^equilibrium = \[0\., 0\., 0\., 0\., 0\.\]: must be 6 finite numbers$"),
    (UnilateralPlane(normal=np.array([1.0, 1.0, 0.0])),
     r"^normal = \[1\., 1\., 0\.\]: must be a unit vector$"),
    (UnilateralPlane(point=np.array([np.nan, 0, 0])), r"^point = .*: must be 3 finite numbers$"),
    (UnilateralPlane(stiffness=0.0), r"^stiffness = 0\.0: must be positive$"),
    (UnilateralPlane(transition=-0.1), r"^transition = -0\.1: must be positive$"),
    (UnilateralPlane(dissipation=float("nan")), r"^dissipation = nan: must be zero or positive$"),
])
def test_bad_parameters_are_named(config, message):
    with pytest.raises(InvalidParameter, match=message):
        make_surface_law(config)
