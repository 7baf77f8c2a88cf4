"""Tests of `uvms_drake.control.contact.approach`: against linear programs and random plans."""

import numpy as np
import pytest
from pydrake.solvers import ClpSolver, MathematicalProgram

from uvms_drake.control.contact.approach import (
    approach_speed,
    between_knots,
    stopping_distance,
    stopping_room,
)
from uvms_drake.control.contact.front import apex
from uvms_drake.model.surface.surface_class import SurfaceClass

GRIDS = [(0.2, 0.2), (0.1, 0.05), (0.5, 1.3)]


def braking(step, deceleration, count=40, *, forward=True):
    """A program over v_0 and a_0 ... with the depths and speeds of its knots as expressions."""
    program = MathematicalProgram()
    speed = program.NewContinuousVariables(1)[0]
    a = program.NewContinuousVariables(count)
    program.AddBoundingBoxConstraint(-deceleration, deceleration, a)
    x, v, states = 0.0, speed, []
    for each in a:
        states.append((x, v))
        x, v = x + step * v + 0.5 * step**2 * each, v + step * each
        if forward:
            program.AddLinearConstraint(v >= 0.0)
    program.AddLinearEqualityConstraint(v, 0.0)
    return program, speed, [*states, (x, v)]


def solved(program):
    result = ClpSolver().Solve(program)
    assert result.is_success()
    return result


@pytest.mark.parametrize(("step", "deceleration"), GRIDS)
@pytest.mark.parametrize("units", [0.0, 0.3, 1.0, 1.7, 4.0, 9.9])
def test_no_plan_stops_shorter(step, deceleration, units):
    """Nor does one that may go back, where the rows between knots are kept."""
    speed, ways = units * deceleration * step, []
    for forward in (True, False):
        program, start, states = braking(step, deceleration, forward=forward)
        program.AddLinearEqualityConstraint(start, speed)
        furthest = program.NewContinuousVariables(1)[0]
        for x, v in states:
            program.AddLinearConstraint(x - furthest <= 0.0)
            program.AddLinearConstraint(between_knots(x, v, step) - furthest <= 0.0)
        program.AddLinearCost(furthest)
        ways.append(solved(program).GetSolution(furthest))
    assert ways == pytest.approx([stopping_distance(speed, step, deceleration)] * 2, abs=1e-9)


def test_at_the_grids_own_speeds_it_is_what_no_grid_can_better():
    for m in range(6):
        v = 0.04 * m
        assert stopping_distance(v, 0.2, 0.2) == pytest.approx(v**2 / 0.4)


def test_limits_at_knots_alone_are_left_between_them():
    """By ah²/8; the row of `between_knots` sees it, with any acceleration."""
    h, a = 0.2, 0.2
    v = 0.5 * a * h
    t = np.linspace(0.0, h, 101)
    x = v * t - 0.5 * a * t**2
    assert max(x[0], x[-1]) == pytest.approx(0.0, abs=1e-15)
    assert np.max(x) == pytest.approx(a * h**2 / 8.0)
    rng = np.random.default_rng(0)
    for x0, v0, a0 in rng.uniform(-1.0, 1.0, (200, 3)):
        x = x0 + v0 * t + 0.5 * a0 * t**2
        assert np.max(x) <= max(x[0], x[-1], between_knots(x0, v0, h)) + 1e-12


@pytest.mark.parametrize("jerk", [-3.0, 3.0])
def test_what_an_acceleration_that_changes_adds(jerk):
    """Between the knots (2/81) h³j, attained by jt²(h − t)/6; of the way of an interval h³j/12."""
    h = 0.2
    t = np.linspace(0.0, h, 3001)
    bulge = jerk * t**2 * (h - t) / 6.0
    assert np.max(np.abs(bulge)) == pytest.approx(2.0 / 81.0 * h**3 * abs(jerk))
    for x0, v0, a0 in np.random.default_rng(5).uniform(-1.0, 1.0, (200, 3)):
        x = x0 + v0 * t + 0.5 * a0 * t**2 + jerk / 6.0 * t**3
        most = max(x[0], x[-1], between_knots(x0, v0, h)) + 2.0 / 81.0 * h**3 * abs(jerk)
        assert np.max(x) <= most + 1e-12
        v = v0 + a0 * h + 0.5 * jerk * h**2
        assert abs(x[-1] - x0 - 0.5 * h * (v0 + v)) == pytest.approx(h**3 * abs(jerk) / 12.0)


@pytest.mark.parametrize(("step", "deceleration"), GRIDS)
@pytest.mark.parametrize("reaction", [0.0, 0.03, 0.3])
def test_no_speed_is_larger_that_can_be_stopped_in_time(step, deceleration, reaction):
    """The largest v of a linear program: react at v, then a plan that ends within L."""
    for units in (0.01, 0.5, 0.7, 3.0, 20.0):
        length = units * deceleration * step**2
        program, speed, states = braking(step, deceleration)
        for x, _ in states:
            program.AddLinearConstraint(x + reaction * speed <= length)
        program.AddLinearCost(-speed)
        fastest = solved(program).GetSolution(speed)
        assert approach_speed(length, step, deceleration, reaction) == pytest.approx(
            fastest, abs=1e-9)


def test_the_front_alone_needs_one_more_interval():
    """Plans at 0, h, ...: keep v for an interval, then stop. The largest v that repeats."""
    h, a, length = 0.2, 0.2, 0.0167
    program, speed, states = braking(h, a)
    program.AddLinearConstraint(states[1][1] == speed)
    for x, _ in states:
        program.AddLinearConstraint(x <= length)
    program.AddLinearCost(-speed)
    assert approach_speed(length, h, a, h) == pytest.approx(solved(program).GetSolution(speed))


def test_where_the_tube_is_thicker_than_what_the_wall_forgives_there_is_no_approach():
    room = stopping_room(45.0, 1.0, 20e3, 2.4e-3)
    assert room == pytest.approx(43.0 / 20e3 - 4.8e-3)
    assert room < 0.0
    assert approach_speed(room, 0.2, 0.2, 0.01) == 0.0
    assert approach_speed(0.0, 0.2, 0.2, 0.0) == 0.0


def test_a_bias_takes_twice_from_the_room():
    """It hides ν of the force, and it was already there before the contact.

    All readings are ν too high. The last one below a touch was made where the wall begins, and it
    bounds the force by 2ν; the front is (F_max − 2ν)/κ₊ ahead. From v_app of a room with one ν, the
    plan that comes next ends beyond.
    """
    force_max, nu, kappa, margin, h, a = 45.0, 1.0, 2000.0, 2.4e-3, 0.2, 0.2
    reading = 0.0 + nu
    front = (force_max - (reading + nu)) / kappa - margin

    def end(room):
        return margin + stopping_distance(approach_speed(room, h, a, 0.0), h, a)

    assert end(stopping_room(force_max, nu, kappa, margin)) == pytest.approx(front)
    assert end((force_max - nu) / kappa - 2.0 * margin) > front + 4e-4


def test_a_tip_that_swings_back_hides_more_from_the_room():
    """The front after a reading of 0 N + ν of a tip that retreats with 0.1 m/s at c₊ = 2 s/m."""
    surface = SurfaceClass(np.array([1.0, 0.0, 0.0]), 2000.0, dissipation=2.0)
    point, velocity = np.zeros((1, 3)), np.array([[-0.1, 0.0, 0.0]])
    front = apex(surface, point, velocity, np.array([1.0, 0.0, 0.0]), 45.0, 1.0)[0]
    room = stopping_room(45.0, 1.0, 2000.0, 2.4e-3, retreat=0.2)
    assert room == pytest.approx(front - 2.0 * 2.4e-3)
    assert room < stopping_room(45.0, 1.0, 2000.0, 2.4e-3)
    assert approach_speed(stopping_room(45.0, 1.0, 2000.0, 0.0, retreat=1.0), 0.2, 0.2, 0.0) == 0.0
