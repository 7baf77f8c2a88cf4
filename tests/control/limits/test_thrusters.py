"""Tests of `uvms_drake.control.limits.thrusters`: rows of τ by the allocation, and plans."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from support.thrusters import eight_thrusters

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.limits import Limits, TubeRadii, make_limits, tighten
from uvms_drake.control.limits.input_in_contact import ForceCone, UnderContact
from uvms_drake.control.limits.inputs import Forces, ThrusterForces
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.control.plan.points import Points, slopes
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.propulsion.thrusters import ThrusterModel


@pytest.fixture
def five(girona) -> ThrusterForces:
    """Of the Girona 500, without roll."""
    return ThrusterForces.of(girona.thrusters, np.array([20.0]), 10)


@pytest.fixture
def points(model, states) -> Points:
    config, zeta = np.split(states["free"][:4], 2, axis=1)
    u = np.random.default_rng(1).normal(size=(4, 10))
    return Points(model, config, model.task_pose(config), zeta, u)


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


def test_slopes_are_those_of_complex_steps(five, points):
    limit = UnderContact(five, ForceCone(np.array([0.6, 0.0, 0.8]), 20.0, 0.3))
    for each in (five, limit):
        found, expected = each.slopes(points), slopes(each.values, points, "input")
        for slope, other in ((found.y, expected.y), (found.u, expected.u)):
            np.testing.assert_allclose(
                np.broadcast_to(slope, other.shape), other, atol=1e-9 * np.max(np.abs(other)))


def test_a_contact_force_comes_to_them_as_to_the_forces(five, points):
    force = np.array([3.0, -2.0, 1.0])
    pressed = replace(points, forces=points.tau + Forces(np.ones(10)).by_force(points) @ force)
    np.testing.assert_allclose(five.values(pressed) - five.values(points),
                               five.by_force(points) @ force, atol=1e-10)


def test_the_tube_takes_what_its_radii_of_forces_make_at_most(five, points):
    """No τ within the radii changes a value more, and one sign of each does."""
    tube = TubeRadii(u=np.zeros(10), tau=np.linspace(1.0, 10.0, 10))
    taken = five.tube_takes(tube)
    signs = np.random.default_rng(0).choice([-1.0, 1.0], (500, 10))
    before = replace(points.subset(slice(0, 1), points.u[:1]), whole=None)
    changes = np.array([five.values(replace(before, forces=before.tau + sign * tube.tau))
                        for sign in signs])[:, 0] - five.values(before)
    largest = np.max(np.abs(changes), axis=0)
    assert np.all(largest <= taken + 1e-9) and np.all(largest > 0.999 * taken)
    assert five.tube_takes(TubeRadii()) is None
    np.testing.assert_allclose(five.tightened(tube).upper, five.upper - taken)


def test_a_plan_keeps_every_thruster_within_its_limits(short_ocp, start_plans, five):
    """With 4/5 of the forces that the plan without such limits takes."""
    def asked(plan):
        at = np.concatenate([plan.config[:-1], plan.config[1:]])
        points = Points(short_ocp.model, at, short_ocp.model.task_pose(at),
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
    limits = make_limits(Limits(u=np.ones(10), thrusters=np.array([5.0])), np.full(4, -1.0),
                         np.ones(4), Free(), thrusters=girona.thrusters)
    with pytest.raises(InvalidParameter, match=r"^limits\.thrusters = .* unless tube\.tau has"):
        tighten(limits, TubeRadii(u=np.zeros(10)))
    much = TubeRadii(u=np.zeros(10), tau=np.array([0, 0, 0, 0, 0, 60.0, 0, 0, 0, 0]))
    with pytest.raises(InvalidParameter, match=r"^limits\.thrusters\.surge_port = 99\.\d*: must"):
        tighten(limits, much)
