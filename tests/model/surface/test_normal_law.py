"""The static force by the depth."""

import numpy as np
import pytest
from support.shapes import LAWS

every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
depths = np.linspace(-0.01, 0.1, 20001)


def slope(law, depth):
    return law.force(depth + 1e-30j).imag / 1e-30


@every_law
def test_outside_there_is_no_force_and_inside_it_grows(law):
    force = law.force(depths)
    np.testing.assert_array_equal(force[depths <= 0.0], 0.0)
    assert np.all(np.diff(force[depths > 0.0]) > 0.0)


@every_law
def test_the_slope_is_that_of_the_force_continuous_and_within_its_bounds(law):
    slopes, (least, most) = slope(law, depths), law.slopes
    finite = np.gradient(law.force(depths), depths)
    np.testing.assert_allclose(slopes[1:-1], finite[1:-1], atol=0.01 * most)
    assert np.max(np.abs(np.diff(slopes))) < 0.02 * most
    past = slopes[depths >= law.transition]
    assert np.max(slopes) == pytest.approx(most)
    assert np.min(past) >= least * (1.0 - 1e-12)
    assert np.min(past) < 1.1 * least


def test_two_straight_lines():
    """The area under the slope: k up to the knee, ratio k after it, both with half a transition."""
    law = LAWS["bilinear"]
    for depth in (0.003, 0.0079):
        assert law.force(np.array(depth)) == pytest.approx(900.0 * (depth - 0.001))
    assert law.force(np.array(0.05)) == pytest.approx(900.0 * 0.008 + 2700.0 * (0.05 - 0.009))


def test_it_hardens_all_the_way_down_and_is_straight_from_there_on():
    law = LAWS["hardening"]
    inside = depths[(depths > law.transition) & (depths < law.depth)]
    assert np.all(np.diff(slope(law, inside)) > 0.0)
    assert slope(law, np.array(law.depth)) == pytest.approx(6.0 * 700.0)
    assert law.force(np.array(0.1)) - law.force(np.array(0.05)) == pytest.approx(6.0 * 700.0 * 0.05)


@every_law
@pytest.mark.parametrize("force", [0.0, 0.01, 3.0, 20.0, 500.0])
def test_the_depth_for_a_force_gives_that_force(law, force):
    assert law.force(np.array(law.depth_for(force))) == pytest.approx(force, rel=1e-12, abs=1e-12)
