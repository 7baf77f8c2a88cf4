"""Tests of `uvms_drake.tube.estimates`."""

import numpy as np

from uvms_drake.tube.estimates import LEAST_SHARE, Estimate, checked, extremes_of


def test_a_claim_that_a_second_search_beats_is_refuted():
    good, bad = Estimate("a", 1.1, 1.0), Estimate("b", 1.1, 1.2)
    assert checked(()) == ()
    assert all(each.holds for each in checked((good,)))
    condition = checked((good, bad))[0]
    assert not condition.holds
    assert "(b)" in condition.name
    assert condition.left == bad.ratio


def test_a_claim_of_zero_is_refuted_by_anything():
    assert Estimate("a", 0.0, 0.0).ratio == 0.0
    assert not checked((Estimate("a", 0.0, 1e-9),))[0].holds


def test_a_second_search_that_finds_far_less_than_any_claim_has_no_power():
    enough, little = Estimate("a", 1.0, LEAST_SHARE), Estimate("b", 1.0, LEAST_SHARE - 0.01)
    unrefuted, powerful = checked((enough, little))
    assert unrefuted.holds
    assert not powerful.holds
    assert powerful.left == little.ratio
    assert "(b)" in powerful.name
    assert all(each.holds for each in checked((enough,)))


def test_the_extreme_ones_stand_for_several_but_for_zeros():
    claims, second = np.array([2.0, 1.0, 1.0, 0.0, 1e-15]), np.array([1.0, 0.9, 0.7, 0.0, 0.0])
    least, most = extremes_of("all", claims, second)
    assert (least.name, least.ratio) == ("all [0]", 0.5)
    assert (most.name, most.ratio) == ("all [1]", 0.9)
    assert [each.name for each in extremes_of("one", np.ones(1), np.ones(1))] == ["one"]
    assert extremes_of("zeros", np.zeros(2), np.zeros(2)) == ()
