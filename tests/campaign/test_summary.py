"""Tests of `uvms_drake.campaign.summary`: guarantees and their violations."""

import pytest

from uvms_drake.campaign.figures import CAMPAIGN_FIGURES, WALLS_FILE, make_campaign_figures
from uvms_drake.campaign.run import run_one
from uvms_drake.campaign.summary import (
    WALL_MEASURES,
    all_well,
    distribution,
    format_campaign,
    summarise_campaign,
    summarise_times,
)

FINE = {"static": 0.4, "peak": 0.5, "in_class": True, "first_touch_s": 3.0, "settled_s": 2.0}


def without_wall(result):
    return {key: value for key, value in result.items() if key != "wall"}


def test_the_distribution_tells_whose_the_worst_is():
    results = [{"index": i, "margin": value, "force_error": value}
               for i, value in ((4, 0.3), (7, 0.1), (9, None), (2, 0.2))]
    assert distribution(results, "margin")["worst"] == 7
    assert distribution(results, "force_error") == {
        "count": 3, "min": 0.1, "median": 0.2, "p95": pytest.approx(0.29), "max": 0.3, "worst": 4}
    assert distribution([], "margin")["worst"] is None


@pytest.mark.parametrize("broken", [
    {"exits_set": 1}, {"exits_trajectory": 2}, {"limited": True}, {"violations": 1},
    {"finite": False}, {"error": "ValueError: x"}, {"wall": {"static": 1.02}},
    {"wall": {"peak": 1.02}}, {"wall": {}, "mpc_failures": 2}], ids=str)
def test_a_promise_that_is_not_kept_is_told(campaign, result, broken):
    fine = result | {"wall": result["wall"] | FINE}
    worse = fine | broken | {"wall": fine["wall"] | broken.get("wall", {})}
    others = [fine | {"index": i, "ratio_set": 5.0} for i in range(1, 20)]
    assert all_well(summarise_campaign(campaign, [fine, *others]))
    summary = summarise_campaign(campaign, [*others, worse])
    assert not all_well(summary)
    assert summary["worst"][0]["index"] == fine["index"]


def test_a_promise_is_of_walls_of_the_class_alone(campaign, result):
    outside = result | {"wall": result["wall"] | FINE | {"static": 1.5, "in_class": False}}
    summary = summarise_campaign(campaign, [outside])
    assert all_well(summary)
    assert summary["walls"]["not_in_class"] == [0]
    inside = outside | {"index": 1, "wall": outside["wall"] | {"in_class": True}}
    summary = summarise_campaign(campaign, [outside, inside])
    assert summary["walls"]["broken"] == {"static": [1], "peak": [], "no_plan": []}
    assert summary["walls"]["settled_soon"] == 2
    assert "1 (runs 1) at rest" in format_campaign(summary, summarise_times([]), "DIR")


def test_runs_that_are_not_covered_are_told_and_few(campaign, result):
    left = result | {"index": 1, "inside": False, "exits_set": 3}
    summary = summarise_campaign(campaign, [left, *(result | {"index": i} for i in range(2, 40))])
    assert all_well(summary)
    assert summary["counts"]["exits_set"] == 0
    assert "counted 38 of 39 runs" in format_campaign(summary, summarise_times([]), "DIR")
    assert summary["worst"][0]["index"] != 1
    assert not all_well(summarise_campaign(campaign, [left, result]))


def test_figures_and_table_of_runs_that_all_end_alike(campaign, result, tmp_path):
    """The force error at the end is the same in all but rounding."""
    results = [result | {"index": i, "force_error": 20.0 + 4e-15 * i} for i in range(3)]
    times = summarise_times([result["times"]])
    summary = summarise_campaign(campaign, results)
    make_campaign_figures(summary, tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {*CAMPAIGN_FIGURES, WALLS_FILE}
    assert all(path.stat().st_size > 5000 for path in tmp_path.iterdir())
    assert all(text in format_campaign(summary, times, "DIR") for text in WALL_MEASURES.values())
    known = summarise_campaign(campaign, [without_wall(result)])
    assert "walls" not in known
    text = format_campaign(known, times, "DIR")
    assert not any(label in text for label in WALL_MEASURES.values())


def test_a_run_that_raises_is_a_result(campaign, monkeypatch):
    def breaks(scenario):
        raise ZeroDivisionError("of\nno use")

    monkeypatch.setattr("uvms_drake.campaign.run.simulate", breaks)
    result = run_one(campaign, 2)
    assert (result["error"], result["index"]) == ("ZeroDivisionError: of no use", 2)
    summary = summarise_campaign(campaign, [result])
    assert summary["counts"]["exceptions"] == 1 and not all_well(summary)
    assert "exceptions: 1" in format_campaign(summary, summarise_times([result["times"]]), "DIR")
