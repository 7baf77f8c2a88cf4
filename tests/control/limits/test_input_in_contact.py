"""Tests of `control.limits.input_in_contact`, against forces drawn at random and on a grid."""

import numpy as np
import pytest

from uvms_drake.control.limits.input_in_contact import ForceCone, UnderContact
from uvms_drake.control.limits.inputs import Accelerations, Forces
from uvms_drake.control.limits.radii import TubeRadii
from uvms_drake.control.plan.points import Points, check_slopes, slopes
from uvms_drake.model.surface.surface_class import SurfaceClass

CONE = ForceCone(np.array([0.6, 0.0, 0.8]), 25.0, 0.4)


def across(normal: np.ndarray) -> np.ndarray:
    """Returns two unit vectors (2, 3) across n."""
    return np.linalg.svd(normal[None])[2][1:]


@pytest.fixture(scope="module")
def points(model, states) -> Points:
    """Four states, with an input."""
    config, zeta = np.split(states["free"][:4], 2, axis=1)
    u = np.random.default_rng(1).uniform(-0.3, 0.3, config.shape)
    return Points(model, config, model.task_pose(config), zeta, u)


@pytest.fixture(params=[Accelerations, Forces])
def limit(request) -> UnderContact:
    return UnderContact(request.param(np.linspace(1.0, 2.0, 10)), CONE)


def test_the_input_is_what_the_law_commands_with_the_measured_force(model, points):
    """𝔲 = ζ̇ − f₀ + M⁻¹Jᵀ𝔉 and τ of inverse dynamics with 𝔉 given; drift knows of no surface."""
    rng = np.random.default_rng(2)
    force, zeta_dot = rng.normal(size=3), rng.normal(size=10)
    wrench = np.tile(np.concatenate([force, np.zeros(3)]), (4, 1))
    tau, tau_free = (model.inverse_dynamics(
        model.kinematics(points.config), points.zeta, zeta_dot * np.ones((4, 1)), contact)
        for contact in (wrench, 0.0 * wrench))
    bound = np.ones(10)
    np.testing.assert_allclose(
        Forces(bound).by_force(points) @ force, tau - tau_free, atol=1e-9)
    np.testing.assert_allclose(
        (points.mass_matrix @ (Accelerations(bound).by_force(points) @ force)[..., None])[..., 0],
        tau - tau_free, atol=1e-9)


def test_values_are_the_extremes_over_all_forces_of_the_cone(limit, points):
    values = np.stack(np.split(limit.values(points), 3, axis=-1))
    free = limit.limit.values(points)
    np.testing.assert_array_equal(values[0], free)
    angles = np.linspace(0.0, 2.0 * np.pi, 721)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ across(CONE.direction)
    forces = CONE.largest * (CONE.direction + np.tan(CONE.spread) * ring)
    reached = free + np.moveaxis(limit.limit.by_force(points) @ forces.T, -1, 0)
    np.testing.assert_allclose(values[1], np.max(reached, axis=0), rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(values[2], np.min(reached, axis=0), rtol=1e-4, atol=1e-6)
    inside = np.random.default_rng(3).uniform(size=(721, 2))
    less = inside[:, :1] * CONE.largest * (
        CONE.direction + inside[:, 1:] * np.tan(CONE.spread) * ring)
    reached = free + np.moveaxis(limit.limit.by_force(points) @ less.T, -1, 0)
    assert np.all(reached <= np.max(values, axis=0) + 1e-9)
    assert np.all(reached >= np.min(values, axis=0) - 1e-9)


def test_slopes_are_those_of_complex_steps_and_of_differences(limit, points):
    found, expected = limit.slopes(points), slopes(limit.values, points, "input")
    np.testing.assert_allclose(found.y, expected.y, atol=1e-9 * np.max(np.abs(expected.y)))
    np.testing.assert_allclose(
        np.broadcast_to(found.u, expected.u.shape), expected.u, atol=1e-9)
    at = points.subset(slice(0, 1), points.u[:1])
    one = Points(at.model, at.config[0], at.y[0], at.zeta[0], at.u[0])
    check_slopes("limit", limit.values, one, "input")


def test_some_of_the_points_twice_with_other_inputs_are_as_alone(limit, points):
    """As both ends of an interval are, which share the geometry of the knots."""
    some = points.subset(np.array([0, 2, 2, 3]), np.linspace(-0.3, 0.3, 40).reshape(4, 10))
    alone = Points(some.model, some.config, some.y, some.zeta, some.u)
    np.testing.assert_allclose(limit.values(some), limit.values(alone), atol=1e-9)
    found, expected = limit.slopes(some), limit.slopes(alone)
    np.testing.assert_allclose(found.y, expected.y, atol=1e-9 * np.max(np.abs(expected.y)))
    np.testing.assert_allclose(np.broadcast_to(found.u, expected.u.shape), expected.u, atol=1e-9)


def test_without_a_spread_the_slopes_are_finite(points):
    """Then the two values at the other end are the same, and the norm has a kink."""
    limit = UnderContact(Accelerations(np.ones(10)), ForceCone(CONE.direction, 25.0))
    found = limit.slopes(points)
    assert np.all(np.isfinite(found.y))
    np.testing.assert_array_equal(found.y[:, 10:20], found.y[:, 20:])


def test_bounds_are_the_limits_own_less_what_the_tube_took_before(points):
    tube = TubeRadii(u=np.full(10, 0.25))
    limit = UnderContact(Accelerations(np.ones(10)).tightened(tube), CONE)
    np.testing.assert_array_equal(limit.upper, np.full(30, 0.75))
    np.testing.assert_array_equal(limit.lower, np.full(30, -0.75))
    assert limit.tube_takes(tube) is None, "the tightening of the force's part is not known"
    assert limit.name == "u" and len(set(limit.labels)) == 30


def random_force(rng, normal, force, tilt, friction):
    """Returns a force of a surface: its normal within `tilt`, friction within its cone."""
    u, v = across(normal)
    angle, turn, slide = rng.uniform(0.0, tilt), *rng.uniform(0.0, 2.0 * np.pi, 2)
    own = np.cos(angle) * normal + np.sin(angle) * (np.cos(turn) * u + np.sin(turn) * v)
    t = across(own)
    rub = rng.choice([1.0, rng.uniform()]) * friction * (
        np.cos(slide) * t[0] + np.sin(slide) * t[1])
    return rng.choice([1.0, rng.uniform()]) * force * (own + rub)


@pytest.mark.parametrize(("tilt", "friction"), [(0.1, 0.0), (0.0, 0.5), (0.1, 0.5), (0.6, 0.2)])
def test_the_cone_of_a_surface_is_the_smallest_that_has_all_its_forces(tilt, friction):
    surface = SurfaceClass(CONE.direction, angle=tilt, friction=friction)
    cone, rng = ForceCone.of_surface(surface, 20.0), np.random.default_rng(4)
    forces = np.array([random_force(rng, CONE.direction, 20.0, tilt, friction)
                       for _ in range(3000)])
    along = forces @ CONE.direction
    angle = np.arctan2(np.linalg.norm(forces - along[:, None] * CONE.direction, axis=1), along)
    assert cone.largest * 0.98 < np.max(along) <= cone.largest * (1.0 + 1e-12)
    assert cone.spread * 0.95 < np.max(angle) <= cone.spread + 1e-9
