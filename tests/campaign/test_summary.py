"""Tests of `uvms_drake.campaign.summary`: guarantees and their violations."""

from dataclasses import replace

import pytest

from uvms_drake.campaign.run import run_one
from uvms_drake.campaign.summary import (
    all_well,
    distribution,
    format_campaign,
    summarise_campaign,
    summarise_times,
)

pytestmark = pytest.mark.long


def test_the_distribution_tells_whose_the_worst_is():
    results = [{"index": i, "margin": value, "force_error": value}
               for i, value in ((4, 0.3), (7, 0.1), (9, None), (2, 0.2))]
    assert distribution(results, "margin")["worst"] == 7
    assert distribution(results, "force_error") == {
        "count": 3, "min": 0.1, "median": 0.2, "p95": pytest.approx(0.29), "max": 0.3, "worst": 4}
    assert distribution([], "margin")["worst"] is None


def test_a_promise_that_is_not_kept_is_told(campaign):
    result = run_one(campaign, 0)["result"]
    beyond = replace(campaign, outside=True)
    assert all_well(summarise_campaign(beyond, [result]))
    assert all_well(summarise_campaign(beyond, [result | {"exits_set": 1, "violations": 2}]))
    assert not all_well(summarise_campaign(campaign, [result | {"exits_set": 1}]))
    for broken in ({"proportional": False}, {"finite": False}, {"logged": False},
                   {"error": "ValueError: x"}):
        worse = [*(result | {"index": i, "ratio_set": 5.0} for i in range(1, 20)), result | broken]
        summary = summarise_campaign(beyond, worse)
        assert not all_well(summary), broken
        assert summary["worst"][0]["index"] == result["index"]
    for broken in ({"limited": True}, {"violations": 1}, {"exits_trajectory": 2}):
        summary = summarise_campaign(campaign, [result | {"index": 7}, result | broken])
        assert not all_well(summary), broken
        assert summary["worst"][0]["index"] == result["index"]


def test_runs_that_are_not_covered_are_told_and_few(campaign):
    result = run_one(campaign, 0)["result"]
    left = result | {"index": 1, "inside": False, "exits_set": 3}
    summary = summarise_campaign(campaign, [left, *(result | {"index": i} for i in range(2, 40))])
    assert all_well(summary)
    assert summary["counts"]["exits_set"] == 0
    assert "counted 38 of 39 runs" in format_campaign(summary, summarise_times([]), "DIR")
    assert summary["worst"][0]["index"] != 1
    assert not all_well(summarise_campaign(campaign, [left, result]))
