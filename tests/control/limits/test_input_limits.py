"""Tests of `control.limits.input_in_contact`, against forces drawn at random and on a grid."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from support.thrusters import eight_thrusters

import uvms_drake as uv
from uvms_drake.control.limits.input_in_contact import ForceCone, UnderContact
from uvms_drake.control.limits.inputs import Accelerations, Forces, ThrusterForces
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.surface.surface_class import SurfaceClass

CONE = ForceCone(np.array([0.6, 0.0, 0.8]), 25.0, 0.4)


def across(normal: np.ndarray) -> np.ndarray:
    """Returns two unit vectors (2, 3) across n."""
    return np.linalg.svd(normal[None])[2][1:]


@pytest.fixture(scope="module")
def points(model, states) -> uv.Points:
    """Four states, with an input."""
    config, zeta = np.split(states["free"][:4], 2, axis=1)
    u = np.random.default_rng(1).uniform(-0.3, 0.3, config.shape)
    return uv.Points(model, config, model.task_pose(config), zeta, u)


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


def test_without_a_spread_the_slopes_are_finite(points):
    """Then the two values at the other end are the same, and the norm has a kink."""
    limit = UnderContact(Accelerations(np.ones(10)), ForceCone(CONE.direction, 25.0))
    found = limit.slopes(points)
    assert np.all(np.isfinite(found.y))
    np.testing.assert_array_equal(found.y[:, 10:20], found.y[:, 20:])


def test_bounds_are_the_limits_own_less_what_the_tube_took_before(points):
    tube = uv.limits.TubeRadii(u=np.full(10, 0.25))
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


# Rows of τ by the allocation, and plans -----------------------------------------------------------


@pytest.fixture
def five(girona) -> ThrusterForces:
    """Of the Girona 500, without roll."""
    return ThrusterForces.of(girona.thrusters, np.array([20.0]), 10)


def test_the_values_are_the_forces_of_the_allocation_and_what_it_does_not_give(
        girona, five, points):
    eight = ThrusterForces.of(eight_thrusters(bias=3.0), np.zeros(0), 10)
    small = replace(points, u=0.02 * points.u)
    for limit, parameters in ((five, girona.thrusters), (eight, eight_thrusters(bias=3.0))):
        allocation = Allocation.to(ThrusterModel.of(parameters))
        for values, tau in zip(limit.values(small), small.tau, strict=True):
            undone = allocation.shortfall(tau[:6])[allocation.thrusters.undriven]
            np.testing.assert_allclose(
                values, np.append(allocation.forces(tau[:6]), undone), atol=1e-10)
        assert np.all(limit.excess(small) < 0.0)


def test_bounds_are_those_of_the_curves_and_the_allowance(five):
    np.testing.assert_array_equal(five.lower, [*[-95.122] * 5, -20.0])
    np.testing.assert_array_equal(five.upper, [*[104.659] * 5, 20.0])
    units = {label: five.unit_of(f"{label}_max") for label in five.labels}
    assert units["thrusters.surge_port"] == "N" and units["thrusters.roll"] == "N m"


def test_a_contact_force_comes_to_them_as_to_the_forces(five, points):
    force = np.array([3.0, -2.0, 1.0])
    pressed = replace(points, forces=points.tau + Forces(np.ones(10)).by_force(points) @ force)
    np.testing.assert_allclose(five.values(pressed) - five.values(points),
                               five.by_force(points) @ force, atol=1e-10)


def test_the_tube_takes_what_its_radii_of_forces_make_at_most(five, points):
    """No τ within the radii changes a value more, and one sign of each does."""
    tube = uv.limits.TubeRadii(u=np.zeros(10), tau=np.linspace(1.0, 10.0, 10))
    taken = five.tube_takes(tube)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (500, 10))
    before = replace(points.subset(slice(0, 1), points.u[:1]), whole=None)
    changes = np.array([five.values(replace(before, forces=before.tau + sign * tube.tau))
                        for sign in signs])[:, 0] - five.values(before)
    largest = np.max(np.abs(changes), axis=0)
    assert np.all(largest <= taken + 1e-9) and np.all(largest > 0.999 * taken)
    assert five.tube_takes(uv.limits.TubeRadii()) is None
    np.testing.assert_allclose(five.tightened(tube).upper, five.upper - taken)


def test_a_plan_keeps_every_thruster_within_its_limits(short_ocp, start_plans, five):
    """With 4/5 of the forces that the plan without such limits takes."""
    def asked(plan):
        at = np.concatenate([plan.config[:-1], plan.config[1:]])
        points = uv.Points(short_ocp.model, at, short_ocp.model.task_pose(at),
                        u=np.concatenate(short_ocp.inputs(plan)))
        return np.max(np.abs(five.values(points)), axis=0)

    guess = start_plans["off"][2]
    free = SequentialConvexSolver(short_ocp).solve(guess, 30, 1e-8)
    bound = 0.8 * asked(free.plan)
    limited = copy.copy(short_ocp)
    limited.limits = short_ocp.limits | {"thrusters": replace(five, bound=bound, lowest=-bound)}
    found = SequentialConvexSolver(limited).solve(guess, 60, 1e-8)
    used = asked(found.plan) / bound
    assert np.max(used) < 1.0 + 1e-4 and np.sum(used > 0.99) >= 3
    assert found.evaluation.cost > 1.005 * free.evaluation.cost


class Free:
    """A surface of which nothing is limited."""

    contact = None


def test_the_tube_needs_the_radii_of_the_forces(girona):
    limits = uv.limits.make_limits(
        uv.limits.Limits(u=np.ones(10), thrusters=np.array([5.0])), np.full(4, -1.0), np.ones(4),
        Free(), thrusters=girona.thrusters)
    with pytest.raises(uv.InvalidParameter, match=r"^limits\.thrusters = .* unless tube\.tau has"):
        uv.limits.tighten(limits, uv.limits.TubeRadii(u=np.zeros(10)))
    much = uv.limits.TubeRadii(u=np.zeros(10), tau=np.array([0, 0, 0, 0, 0, 60.0, 0, 0, 0, 0]))
    with pytest.raises(uv.InvalidParameter, match=r"^limits\.thrusters\.surge_port = 99\.\d*: "):
        uv.limits.tighten(limits, much)
