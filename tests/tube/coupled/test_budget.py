"""Tests of `tube.coupled.budget`: sums, norms, and the way through a file."""


import json
from dataclasses import replace

import numpy as np
import pytest

from uvms_drake.common.jsonable import jsonable, restored
from uvms_drake.tube.coupled.budget import (
    APPROACH,
    PLANNED,
    PRESS,
    CoupledBudget,
    Source,
    Stability,
    Stage,
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
    Source(PLANNED, 2.0 * ONES, NONE, False),
    Source("friction", 50.0 * ONES, NONE, False, counted=False))


def budget():
    """Returns one whose plan is 7 in the approach, at joints alone, and 2 in the press."""
    joints = np.array([7.0 * row.startswith("q") for row in ROWS])
    gentle = tuple(replace(each, worst=joints) if each.name == PLANNED else each
                   for each in SOURCES)
    return CoupledBudget(
        ROWS, (Stage(APPROACH, gentle, 40.0 * ONES), Stage(PRESS, SOURCES, 41.0 * ONES)), 1e-3, 6.0,
        2, {"depth": 30.0, "q1": 9.0}, {"depth": 20.0, "joints": 50.0},
        (Stability("tip gains", "gain", 1.2),), 0.05)


def test_random_sources_add_up_by_their_squares_and_the_others_as_they_are():
    np.testing.assert_allclose(by_chance(SOURCES, 6.0), 6.0 * 5.0 + 2.0)
    np.testing.assert_allclose(budget().stages[1].worst, 9.0 + 8.0 + 2.0)


def test_a_row_is_that_of_the_larger_stage_and_the_depth_is_of_the_press():
    whole = budget()
    assert whole.row("q1") == pytest.approx(30.0 + 7.0)
    assert whole.row("tip y") == whole.row("depth") == pytest.approx(30.0 + 2.0)
    worse = replace(whole, stages=(replace(whole.stages[0], sources=tuple(
        replace(each, worst=9.0 * ONES) for each in SOURCES)), whole.stages[1]))
    assert worse.row("depth") == pytest.approx(32.0) and worse.row("tip y") == pytest.approx(39.0)
    assert worse.radii()["depth"] == pytest.approx(32.0)
    assert worse.radii()["joints"] == pytest.approx(39.0 * np.sqrt(2.0))


def test_the_robots_own_deviations_are_in_no_radius():
    own = replace(budget(), own=("roll", "roll rate")).radii()
    assert own["roll"] == 0.0 and own["nu2"] == pytest.approx(32.0 * np.sqrt(2.0))


def test_it_tells_whether_it_counts_the_plan():
    whole = budget()
    assert whole.planned
    assert not replace(whole, stages=(whole.stages[0], replace(
        whole.stages[1], sources=SOURCES[:2]))).planned


def test_shares_by_chance_add_up_to_the_sum_without_what_is_not_counted():
    whole = budget()
    shares = whole.shares()
    for row in ("depth", "q1"):
        assert sum(shares[row].values()) == pytest.approx(whole.row(row))
        assert set(shares[row]) == {each.name for each in SOURCES if each.counted}
    quiet = replace(whole, stages=tuple(replace(stage, sources=tuple(
        replace(each, std=0.0 * each.std) for each in SOURCES if each.random))
        for stage in whole.stages))
    assert set(quiet.shares()["depth"].values()) == {0.0}
    assert replace(whole, stages=()).shares() == {}


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
    for stage, known in zip(again.stages, budget().stages, strict=True):
        np.testing.assert_array_equal(again.by_chance(stage), budget().by_chance(known))
        np.testing.assert_array_equal(stage.elsewhere, known.elsewhere)
    assert again.stability == budget().stability and again.left == budget().left
    assert data["sums"][PRESS]["worst"][0] == pytest.approx(19.0)
