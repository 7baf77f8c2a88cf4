"""Tests of `station.contact.drawn_mission`: places, times and words of a mission."""

import numpy as np
import pytest

from uvms_drake.mission.steps import Approach, Hold, Mission, Retreat, Slide
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.station.contact.drawn_mission import (
    ends_of,
    in_words,
    places_of,
    searched,
    seconds_of,
)

WALLS = SurfaceClass(direction=np.array([1.0, 0.0, 0.0]))  # t₁ is down, t₂ to the left.
ORIGIN, START = np.array([0.5, 1.0, 2.0]), np.array([-0.4, 1.1, 2.2])
MISSION = Mission([
    Approach(at=np.array([-0.2, 0.0]), within=0.3), Hold(seconds=4.0), Retreat(distance=0.05),
    Approach(at=np.array([0.0, 0.1]), settle=0.5),
    Slide(along=np.array([0.4, 0.0]), speed=0.1), Retreat(distance=0.1)])


def test_the_places_are_those_of_the_steps_as_deep_as_the_start():
    places = places_of(MISSION, WALLS, ORIGIN, START)
    expected = [START[1:], (1.0, 1.8), (1.0, 1.8), (1.0, 1.8), (1.0, 1.8), (1.0, 1.8), (1.0, 1.8),
                (0.9, 2.0), (0.9, 2.0), (0.9, 2.0), (0.9, 2.4), (0.9, 2.4), (0.9, 2.4)]
    np.testing.assert_allclose(places[:, 1:], expected, atol=1e-12)
    np.testing.assert_allclose(places[:, 0], START[0])
    np.testing.assert_allclose(places_of(Mission(), WALLS, ORIGIN, START), [START])


def test_all_places_are_between_the_ends():
    """In the disk of which they are the ends of a diameter; without a mission: start and goal."""
    first, last = ends_of(MISSION, WALLS, START, ORIGIN)
    middle, radius = 0.5 * (first + last), 0.5 * np.linalg.norm(last - first)
    away = np.linalg.norm(places_of(MISSION, WALLS, ORIGIN, START) - middle, axis=1)
    assert np.max(away) == pytest.approx(radius)
    np.testing.assert_allclose(middle, [START[0], 1.0, 2.1])
    ends = ends_of(Mission(), WALLS, START, ORIGIN)
    assert ends[0] is START and ends[1] is ORIGIN


def test_the_time_is_that_of_holds_lines_ways_and_presses():
    """With a lag of 2 s and 3 s to press."""
    ways = [np.hypot(0.1, 0.4), 0.05, 0.05, np.hypot(0.1, 0.2), 0.1]  # From spot to spot, back, to.
    travel = 2.0 * np.sum(np.log(np.array(ways) / 0.01))
    seconds = seconds_of(MISSION, places_of(MISSION, WALLS, ORIGIN, START), lambda _: 3.0, 2.0)
    settling, holding, sliding, lag = 1.0 + 0.5, 4.0, 4.0, 2.0
    assert seconds == pytest.approx(travel + 2 * 3.0 + settling + holding + sliding + lag)


def test_words_have_every_step_and_its_values():
    assert searched(MISSION) == 0.3
    assert searched(Mission()) == np.inf
    assert in_words(Mission(MISSION.steps[3:], retries=2)) == (
        "approach force 10 N, at (0, 0.1) m; slide force 10 N, along (0.4, 0) m, speed 0.1 m/s; "
        "retreat distance 0.1 m; retries of a spot: 2")
