"""Tests of `tube.coupled.budget`: sums, norms, and the way through a file."""


import json
from dataclasses import replace

import numpy as np
import pytest

from uvms_drake.common.jsonable import jsonable, restored
from uvms_drake.tube.coupled.budget import (
    CoupledBudget,
    Source,
    Stability,
    by_chance,
    quantile,
    radii_of,
)

ROWS = ("depth", "tip y", "tip z", "roll", "pitch", "q1", "q2", "depth speed", "tip speed y",
        "tip speed z", "surge", "sway", "heave", "roll rate", "pitch rate", "yaw rate", "q1 rate",
        "q2 rate")
ONES, NONE = np.ones(len(ROWS)), np.zeros(len(ROWS))
SOURCES = (
    Source("noise", 9.0 * ONES, 3.0 * ONES, True), Source("fixes", 8.0 * ONES, 4.0 * ONES, True),
    Source("plan", 2.0 * ONES, NONE, False),
    Source("friction", 50.0 * ONES, NONE, False, counted=False))


def budget():
    return CoupledBudget(
        ROWS, SOURCES, 1e-3, 6.0, 40.0 * ONES, 2, {"depth": 30.0}, {"depth": 20.0, "joints": 50.0},
        (Stability("tip gains", "gain", 1.2),), 0.05)


def test_random_sources_add_up_by_their_squares_and_the_others_as_they_are():
    np.testing.assert_allclose(by_chance(SOURCES, 6.0), 6.0 * 5.0 + 2.0)
    np.testing.assert_allclose(budget().worst, 9.0 + 8.0 + 2.0)


def test_shares_by_chance_add_up_to_the_sum_without_what_is_not_counted():
    whole = budget()
    (depth,) = whole.shares().values()
    assert sum(depth.values()) == pytest.approx(whole.by_chance[whole.rows.index("depth")])
    assert set(depth) == {each.name for each in SOURCES if each.counted}
    quiet = replace(whole, sources=tuple(
        replace(each, std=0.0 * each.std) for each in SOURCES if each.random))
    assert set(quiet.shares()["depth"].values()) == {0.0}
    assert replace(whole, sources=()).shares() == {}


def test_the_quantile_is_that_of_a_union_bound():
    q = quantile(40, 2200.0, 1e-3)
    assert 2.0 * 40 * 2200.0 * np.exp(-0.5 * q**2) == pytest.approx(1e-3)


def test_radii_are_norms_of_their_rows():
    radii = radii_of(ROWS, np.arange(len(ROWS), dtype=float))
    assert radii["position"] == pytest.approx(np.sqrt(0 + 1 + 4))
    assert radii["joints"] == pytest.approx(np.hypot(5.0, 6.0))
    assert radii["qdot"] == pytest.approx(np.hypot(16.0, 17.0))


def test_a_budget_goes_through_a_file():
    data = json.loads(json.dumps(jsonable(budget().to_data(), names=True)))
    again = CoupledBudget.from_data(restored(data))
    np.testing.assert_array_equal(again.by_chance, budget().by_chance)
    assert again.stability == budget().stability and again.left == budget().left
    assert data["sums"]["worst"][0] == pytest.approx(19.0)
