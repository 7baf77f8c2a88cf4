"""Tests of `uvms_drake.control.costs.costs`."""

import numpy as np
import pytest

from uvms_drake.control.costs.costs import OffsetCost

COST = OffsetCost(slope=60.0, width=0.01)


def test_the_quadratic_touches_the_cost_and_is_never_below_it(derivative):
    rng = np.random.default_rng(0)
    for size in (0.0, 1e-3, 0.1, 3.0):
        e = size * rng.normal(size=3)
        H, g = COST.quadratic(e)
        for b in 0.3 * rng.normal(size=(50, 3)):
            model = COST.value(e) + g @ b + 0.5 * b @ H @ b
            assert COST.value(e + b) <= model + 1e-12
        slopes = [derivative(lambda s, d=d, e=e: COST.value(e + s * d), 1e-5) for d in np.eye(3)]
        np.testing.assert_allclose(g, slopes, rtol=1e-6, atol=1e-7)
        assert np.linalg.norm(g) <= COST.slope


def test_it_is_a_norm_but_for_its_width():
    e = np.array([0.3, -0.4, 1.2])
    assert COST.slope * (1.3 - COST.width) <= COST.value(e) <= COST.slope * 1.3
    assert COST.value(np.zeros(3)) == 0.0


def test_against_a_gradient_its_minimum_moves_as_derived():
    """The minimum of V_o(e) − fᵀe, found by its own majorants."""
    for pull in (6.0, 30.0, 54.0):
        f, e = pull * np.array([0.6, 0.0, 0.8]), np.zeros(3)
        for _ in range(2000):
            H, g = COST.quadratic(e)
            e = e + np.linalg.solve(H, f - g)
        assert np.linalg.norm(e) == pytest.approx(
            COST.width * pull / np.sqrt(COST.slope**2 - pull**2), rel=1e-6)
