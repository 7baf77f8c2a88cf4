"""Tests of the failures that a certificate in probability counts."""

import pytest
from support.missions import SHORT, mission_record

import uvms_drake as uv
from uvms_drake.campaign.campaign import make_campaign
from uvms_drake.campaign.failures import certificate_in_probability, failures_of
from uvms_drake.campaign.run import mission_outcome, run_one
from uvms_drake.command.drawn_runs import drawable
from uvms_drake.mission.law import RUNNING, SKIPPED, TIME_OUT
from uvms_drake.report.metrics import metrics

KEPT = {"index": 0, "error": None, "finite": True, "exits_set": 0, "exits_trajectory": 0,
        "violations": 0, "limited": False, "mpc_failures": 0, "losses": 0, "inside": True,
        "wall": {"static": 0.4, "peak": 0.5, "losses": 0, "in_class": True,
                 "first_touch_s": 12.0}}


@pytest.fixture(scope="module")
def real():
    return uv.load_scenario("girona500_real_loop")


def with_wall(**changes):
    return KEPT | {"wall": KEPT["wall"] | changes}


@pytest.mark.parametrize(("result", "kinds"), [
    (KEPT, ()), (KEPT | {"inside": False}, ()), (with_wall(in_class=False), ()),
    ({"index": 0, "error": "ValueError: x"}, ("exception",)),
    (KEPT | {"finite": False}, ("not finite",)), (KEPT | {"exits_set": 1}, ("tube",)),
    (KEPT | {"exits_trajectory": 2}, ("tube",)), (KEPT | {"violations": 3}, ("limit",)),
    (KEPT | {"limited": True}, ("saturation",)), (with_wall(static=1.01), ("force",)),
    (with_wall(peak=1.01, in_class=False), ("force",)), (KEPT | {"mpc_failures": 1}, ("no plan",)),
    (KEPT | {"losses": 1}, ("contact",)), (with_wall(losses=2), ("contact",)),
    (with_wall(first_touch_s=None), ("no touch",)),
    (KEPT | {"mission": {"done": False}}, ("mission",)), (KEPT | {"mission": {"done": True}}, ()),
    (KEPT | {"exits_set": 1, "violations": 1}, ("tube", "limit"))])
def test_every_kind_of_failure_counts(result, kinds):
    assert failures_of(result) == kinds


def test_a_run_that_fails_in_two_ways_is_one_failure_and_none_can_be_left_out(real):
    campaign = make_campaign(real, 1, None, 60)
    results = [KEPT | {"index": i} for i in range(60)]
    assert certificate_in_probability(campaign, real, results, 0.95).probability == pytest.approx(
        1.0 - 0.05**(1.0 / 60.0))
    results[7] |= {"exits_set": 1, "violations": 2}
    results[9] |= {"exits_set": 1}
    found = certificate_in_probability(campaign, real, results[::-1], 0.95)
    assert (found.runs, found.failures, found.failed) == (60, 2, (7, 9))
    assert (found.kinds["tube"], found.kinds["limit"]) == (2, 1)
    assert found.probability == pytest.approx(0.1012, abs=1e-4)
    with pytest.raises(AssertionError, match="a run is missing"):
        certificate_in_probability(campaign, real, results[1:], 0.95)


def test_the_mission_of_every_run_is_a_part_of_the_claim():
    scenario = uv.load_scenario("jacket_inspection_real")
    results = [KEPT | {"index": i, "mission": {"done": i != 2}} for i in range(4)]
    found = certificate_in_probability(make_campaign(scenario, 1, None), scenario, results, 0.95)
    assert found.mission == ("approach, hold, retreat, approach, hold, retreat, approach, hold, "
                             "slide, retreat")
    assert (found.failed, found.kinds["mission"]) == ((2,), 1)
    assert found.verdict.endswith(f"for the declared distribution of the mission {found.mission}")


def test_it_is_told_how_a_mission_ended_and_which_attempts_failed():
    def outcome(**progress):
        return mission_outcome(metrics(mission_record(**progress))["mission"])

    assert outcome() == {
        "done": True, "outcome": "done", "over_s": pytest.approx(5.0), "failures": []}
    time = mission_record().time
    stopped = outcome(
        outcome=1.0 * (time < 5.0) * RUNNING + (time >= 5.0) * SKIPPED,
        failures=1.0 * (time >= 4.0), reason=(time >= 4.0) * TIME_OUT)
    assert (stopped["done"], stopped["outcome"]) == (False, "skipped in part")
    assert stopped["failures"] == ["Slide 2: time-out"]
    unfinished = outcome(outcome=0.0 * time + RUNNING, step=1.0 * (time >= 1.0))
    assert (unfinished["done"], unfinished["over_s"]) == (False, None)
    assert unfinished["failures"] == ["Hold 1: not over"]


@pytest.mark.slow
def test_a_drawn_mission_is_done_on_a_wall_of_the_class():
    campaign = make_campaign(drawable(uv.load_scenario("girona500_inspection", SHORT)), 3, None)
    result = run_one(campaign, 0)
    assert result["error"] is None
    assert result["mission"]["failures"] == []
    assert result["mission"]["over_s"] < 30.0
    assert result["wall"]["in_class"]
    assert failures_of(result) == ()
