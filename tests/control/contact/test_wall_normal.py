"""Tests of `uvms_drake.control.contact.wall_normal`."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from uvms_drake.control.contact.wall_normal import (
    LENGTH,
    STEADY,
    STEP,
    TURN_PER_METRE,
    UNKNOWN,
    WallNormal,
    learned,
    wall_turn,
)
from uvms_drake.model.surface.surface_class import SurfaceClass

WALLS = SurfaceClass(np.array([1.0, 0.0, 0.0]), angle=0.2)
TILT = np.array([0.0, 0.12, -0.05])
"""Tilt of a plane of the class."""


KAPPA = 500.0
"""Stiffness along n [N/m]."""


def force(d, friction, normal_force=10.0):
    """Returns 𝐅 of a tip that slides along d on the plane, which friction drags along."""
    normal = (WALLS.direction + TILT) / np.linalg.norm(WALLS.direction + TILT)
    along = d - (d @ normal) * normal
    return normal_force * (normal + friction * along / np.linalg.norm(along))


def tip(d, path, along=10.0):
    """Returns the place of a tip that presses with a force along n [N], on its path along d."""
    return path * d + (along / KAPPA - path * (d @ TILT)) * WALLS.direction


def slid(d, friction, forces=lambda path: 10.0, length=0.15, step=1e-3, factor=1.0):
    """Returns the estimate after a slide in small steps."""
    known = UNKNOWN
    for path in np.arange(0.0, length + 1e-9, step):
        reading_force = force(d, friction, forces(path))
        place = tip(d, path, reading_force @ WALLS.direction)
        known = learned(known, WALLS, place, reading_force, factor * KAPPA)
    return known


@pytest.mark.parametrize("direction", [[1.0, 0.0, 0.0], [0.6, -0.64, 0.48]])
@pytest.mark.parametrize("turn", [-0.4, 0.0, 0.1])
def test_a_wall_is_turned_by_what_turns_its_normal_about_the_vertical(direction, turn):
    """The turn of a wall: n + 𝔱 is along its normal, whose part along n is n."""
    n = np.array(direction)
    c, s = np.cos(turn), np.sin(turn)
    normal = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ n
    assert wall_turn(n, normal / (n @ normal) - n) == pytest.approx(turn, abs=1e-12)
    assert wall_turn(np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.1])) == 0.0
    assert wall_turn(np.array([0.0, 0.0, 1.0]), np.array([0.1, 0.1, 0.0])) == 0.0


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize("path", [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.6, -0.8]])
@pytest.mark.parametrize("forces", [lambda path: 10.0, lambda path: 10.0 + 20.0 * path])
def test_it_learns_a_plane_by_force_and_path(path, friction, forces):
    """For any friction, and while the force changes: a slope of the force is no tilt."""
    found = slid(np.array(path), friction, forces).tilt
    left = np.exp(-0.15 / LENGTH)
    assert found == pytest.approx((1.0 - left) * TILT, abs=0.02 * friction + 1e-3)
    assert WALLS.direction @ found == pytest.approx(0.0, abs=1e-12)


def test_on_a_wall_that_bends_it_is_that_of_where_the_tip_was():
    """A cylinder of 0.75 m: the mean of the last way, `LENGTH` and half of a `STEP` behind."""
    known, radius, turns = UNKNOWN, 0.75, np.linspace(0.0, 0.2, 400)
    for turn in turns:
        normal = np.array([np.cos(turn), np.sin(turn), 0.0])
        place = radius * np.array([1.0 - np.cos(turn), -np.sin(turn), 0.0])
        slope = KAPPA * normal[0] ** 2
        known = learned(known, WALLS, place + 10.0 / KAPPA * normal, 10.0 * normal, slope)
    behind = turns[-1] - wall_turn(WALLS.direction, known.tilt)
    assert behind == pytest.approx((LENGTH + 0.5 * STEP) / radius, rel=0.2)


@pytest.mark.parametrize("ramp", [20.0, 50.0, 130.0])
def test_a_slope_that_is_taken_for_twice_as_stiff_turns_the_wall_by_no_more_than_is_said(ramp):
    d = np.array([0.0, 1.0, 0.0])
    found = slid(d, 0.0, lambda path: 5.0 + ramp * path, factor=2.0).tilt
    off = d @ (found - (1.0 - np.exp(-0.15 / LENGTH)) * TILT)
    assert abs(off) <= STEADY + 0.01 or d @ found == 0.0


def test_while_a_press_begins_the_path_says_nothing():
    """The force rises by 2 N on 5 mm, on a wall that is taken for twice as stiff."""
    d = np.array([0.0, 1.0, 0.0])
    before = learned(UNKNOWN, WALLS, tip(d, 0.0, 5.0), force(d, 0.3, 5.0), 2.0 * KAPPA)
    after = learned(before, WALLS, tip(d, 0.012, 9.0), force(d, 0.3, 9.0), 2.0 * KAPPA)
    assert d @ after.tilt == 0.0
    assert after.tilt[2] < -0.005, "the force across the way does"


def test_at_rest_or_without_a_force_nothing_is_learned():
    d = np.array([0.0, 0.0, 1.0])
    at_rest = learned(UNKNOWN, WALLS, np.zeros(3), force(d, 0.3), KAPPA)
    for _ in range(100):
        at_rest = learned(at_rest, WALLS, 0.9 * STEP * d, force(-d, 0.3), KAPPA)
    assert at_rest.tilt == pytest.approx(np.zeros(3))
    for initial_contact_state in (np.full(3, np.nan), np.array([0.5, 3.0, 0.0])):
        after = learned(at_rest, WALLS, 2.0 * STEP * d, initial_contact_state, KAPPA)
        assert after.tilt == pytest.approx(np.zeros(3))
        assert np.all(np.isnan(after.reading)), "the way begins anew"


def test_what_is_learned_is_of_the_class():
    d, strange = np.array([0.0, 0.0, 1.0]), np.array([1.0, 5.0, 0.0])
    known = learned(UNKNOWN, WALLS, np.zeros(3), strange, KAPPA)
    for k in range(1, 30):
        known = learned(known, WALLS, 0.01 * k * d, strange, KAPPA)
        assert np.linalg.norm(known.tilt) <= WALLS.tilt + 1e-12
    assert np.linalg.norm(known.tilt) == pytest.approx(WALLS.tilt)


def test_the_system_reads_its_ports_and_keeps_what_it_learned_off_the_wall():
    system = WallNormal(WALLS, 0.1, 0.01)
    simulator = Simulator(system)
    context = simulator.get_mutable_context()
    d = np.array([0.0, 0.0, 1.0])
    reading_force = force(d, 0.3)

    def fix(place, touched):
        for name, value in (("reading", [*place, 10.0]), ("touched", [touched]),
                            ("stiffness_used", [KAPPA]),
                            ("force_measured", [*reading_force, 0.0, 0.0, 0.0])):
            system.GetInputPort(name).FixValue(context, np.asarray(value, dtype=float))

    known, path = UNKNOWN, 0.004 * np.arange(50)
    for k, along in enumerate(path):
        place = tip(d, along)
        fix(place, 1.0)
        simulator.AdvanceTo(0.01 * (k + 1) - 0.001)
        known = learned(known, WALLS, place, reading_force, KAPPA)
        if along == 0.04:
            first = system.get_output_port().Eval(context)[0]
    assert context.get_discrete_state(0).value() == pytest.approx(known.tilt, abs=1e-12)
    assert 0.5 * TURN_PER_METRE * 0.04 < first <= TURN_PER_METRE * 0.04
    gone = TURN_PER_METRE * path[-1]
    assert system.get_output_port().Eval(context)[0] == pytest.approx(
        gone, abs=TURN_PER_METRE * 2 * STEP)
    before = system.get_output_port().Eval(context)[0]
    fix(tip(d, path[-1]), 1.0)  # At rest, then off the wall: it does not turn.
    simulator.AdvanceTo(1.0)
    fix(np.zeros(3), 0.0)
    simulator.AdvanceTo(1.5)
    assert system.get_output_port().Eval(context)[0] == before
    assert context.get_discrete_state(0).value() == pytest.approx(known.tilt)
    assert np.all(np.isnan(context.get_discrete_state(1).value()))
    assert known.tilt[1] > 0.1
    for k, along in enumerate(path):  # The path goes on, up to the largest turn.
        fix(tip(d, along), 1.0)
        simulator.AdvanceTo(1.5 + 0.01 * (k + 1) - 0.001)
    assert system.get_output_port().Eval(context)[0] == pytest.approx(0.1)
