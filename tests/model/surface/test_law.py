"""Properties of all surfaces, and refusals of `check_surface`."""

import math

import numpy as np
import pytest
from support.surfaces import TRANSITION, Sphere, moving, plane, spring, tip_at

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.surface.spring import BilateralSpring


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


def test_a_surface_of_ones_own_passes():
    sphere = Sphere()
    assert check_surface(sphere) is sphere


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
    with pytest.raises(InvalidParameter, match=message):
        check_surface(Sphere(radius))


def test_a_force_of_another_shape_is_refused():
    class Flat(Sphere):
        def force(self, chi, chi_dot):
            return super().force(chi, chi_dot)[..., :3]

    with pytest.raises(InvalidParameter, match=r"^force = 'Flat': must be \(\.\.\., 6\) for "):
        check_surface(Flat())


@pytest.mark.parametrize("law", [
    UnilateralPlane(stiffness=1e6, transition=1e-5), UnilateralPlane(stiffness=1e-3),
    UnilateralPlane(point=np.array([1e3, 1e3, 0.0])), BilateralSpring(1e6 * np.eye(6)),
    BilateralSpring(1e-3 * np.eye(6)), BilateralSpring(equilibrium=np.full(6, 3.1))])
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
