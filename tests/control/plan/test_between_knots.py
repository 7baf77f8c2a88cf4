"""Tests of `uvms_drake.control.plan.between_knots`: against random parabolas and a safe region."""

import numpy as np
import pytest

from uvms_drake.control.contact.safe_region import apex
from uvms_drake.control.plan.plan import between_knots, stopping_distance
from uvms_drake.model.surface.surface_class import SurfaceClass


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


def test_where_the_tube_is_thicker_than_what_the_wall_forgives_there_is_no_approach():
    distance = stopping_distance(45.0, 1.0, 20e3, 2.4e-3)
    assert distance == pytest.approx(43.0 / 20e3 - 4.8e-3)
    assert distance < 0.0


def test_a_tip_that_swings_back_reduces_the_distance():
    """After a reading of 0 N + ν of a tip that retreats with 0.1 m/s at c₊ = 2 s/m."""
    surface = SurfaceClass(np.array([1.0, 0.0, 0.0]), 2000.0, dissipation=2.0)
    point, velocity = np.zeros((1, 3)), np.array([[-0.1, 0.0, 0.0]])
    edge = apex(surface, point, velocity, np.array([1.0, 0.0, 0.0]), 45.0, 1.0)[0]
    distance = stopping_distance(45.0, 1.0, 2000.0, 2.4e-3, retreat=0.2)
    assert distance == pytest.approx(edge - 2.0 * 2.4e-3)
    assert distance < stopping_distance(45.0, 1.0, 2000.0, 2.4e-3)
    assert stopping_distance(45.0, 1.0, 2000.0, 0.0, retreat=1.0) == -np.inf
