"""Tests of `uvms_drake.tube.estimates`."""

import numpy as np

from uvms_drake.tube.estimates import Estimate, largest_of, unrefuted


def test_a_claim_that_a_second_search_beats_is_refuted():
    good, bad = Estimate("a", 1.1, 1.0), Estimate("b", 1.1, 1.2)
    assert unrefuted(()) == ()
    assert unrefuted((good,))[0].holds
    condition = unrefuted((good, bad))[0]
    assert not condition.holds
    assert "(b)" in condition.name
    assert condition.left == bad.ratio


def test_a_claim_of_zero_is_refuted_by_anything():
    assert Estimate("a", 0.0, 0.0).ratio == 0.0
    assert not unrefuted((Estimate("a", 0.0, 1e-9),))[0].holds


def test_the_one_that_comes_closest_stands_for_several():
    closest = largest_of("all", np.array([2.0, 1.0]), np.array([1.0, 0.9]))
    assert (closest.claim, closest.second) == (1.0, 0.9)
