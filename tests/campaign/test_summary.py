"""Tests of `uvms_drake.campaign.summary`: guarantees and their violations."""

from dataclasses import replace

import pytest
from support.missions import SHORT, mission_record

import uvms_drake as uv
from uvms_drake.campaign.campaign import make_campaign
from uvms_drake.campaign.failures import certificate_in_probability, failures_of
from uvms_drake.campaign.figures import CAMPAIGN_FIGURES, WALLS_FILE, make_campaign_figures
from uvms_drake.campaign.run import mission_outcome, run_one
from uvms_drake.campaign.summary import (
    WALL_MEASURES,
    all_well,
    distribution,
    format_campaign,
    summarise_campaign,
    summarise_times,
)
from uvms_drake.certificate.attempts import Attempt
from uvms_drake.certificate.in_probability import failure_bound, spent
from uvms_drake.command.drawn_runs import drawable
from uvms_drake.mission.law import RUNNING, SKIPPED, TIME_OUT
from uvms_drake.report.metrics import metrics

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
    {"wall": {"peak": 1.02}}, {"wall": {}, "mpc_failures": 2}, {"retreated_s": 5.0},
    {"left": ["depth"]}, {"exits_bands": 1}], ids=str)
def test_a_promise_that_is_not_kept_is_told(campaign, result, broken):
    fine = result | {"wall": result["wall"] | FINE}
    worse = fine | broken | {"wall": fine["wall"] | broken.get("wall", {})}
    others = [fine | {"index": i, "ratio_set": 5.0} for i in range(1, 20)]
    assert all_well(summarise_campaign(campaign, [fine, *others]))
    summary = summarise_campaign(campaign, [*others, worse])
    assert not all_well(summary)
    assert summary["worst"][0]["index"] == fine["index"]


@pytest.mark.parametrize("certified", [False, True])
def test_a_run_of_a_certified_campaign_is_watched_as_a_certified_one(
        campaign, certified, monkeypatch):
    seen = []
    monkeypatch.setattr("uvms_drake.campaign.run.simulate", lambda scenario, certified: seen.append(
        certified))
    run_one(replace(campaign, certified=certified), 0)
    assert seen == [certified]


def test_a_promise_is_of_walls_of_the_class_alone(campaign, result):
    outside = result | {"wall": result["wall"] | FINE | {"static": 1.5, "in_class": False},
                        "left": ["depth"], "exits_bands": 1, "mpc_failures": 1}
    summary = summarise_campaign(campaign, [outside])
    assert all_well(summary)
    assert summary["walls"]["not_in_class"] == [0]
    inside = outside | {"index": 1, "wall": outside["wall"] | {"in_class": True},
                        "mpc_failures": 0}
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
    def breaks(scenario, certified):
        raise ZeroDivisionError("of\nno use")

    monkeypatch.setattr("uvms_drake.campaign.run.simulate", breaks)
    result = run_one(campaign, 2)
    assert (result["error"], result["index"]) == ("ZeroDivisionError: of no use", 2)
    summary = summarise_campaign(campaign, [result])
    assert summary["counts"]["exceptions"] == 1 and not all_well(summary)
    assert "exceptions: 1" in format_campaign(summary, summarise_times([result["times"]]), "DIR")


# Tests of the failures that a certificate in probability counts.


KEPT = {"index": 0, "error": None, "finite": True, "exits_set": 0, "exits_trajectory": 0,
        "violations": 0, "limited": False, "mpc_failures": 0, "losses": 0, "inside": True,
        "use": {"nu1": 0.6, "u_heave": 0.9}, "off_line": 0.8, "supervisor": {"slope": 0.3},
        "starts": 2, "walls": 1, "desired_force": 10.0, "touched": True,
        "wall": {"static": 0.4, "peak": 0.5, "losses": 0, "in_class": True,
                 "first_touch_s": 12.0}}


@pytest.fixture(scope="module")
def real():
    return uv.load_scenario("girona500_real_loop")


def certificate_of(scenario, results, earlier=0, confidence=0.95):
    """The certificate of results, after so many earlier attempts."""
    mine = Attempt("girona500_arm5e, SensedContact, press", scenario.name, len(results), 64 * "b",
                   confidence)
    attempts = (*(replace(mine, identity=64 * str(i)) for i in range(earlier)), mine)
    campaign = make_campaign(scenario, mine.seed, None, len(results))
    return certificate_in_probability(campaign, attempts, scenario, results, confidence)


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
    (KEPT | {"touched": False}, ("no touch",)),
    (KEPT | {"off_line": 1.01}, ("force line",)), (KEPT | {"off_line": None}, ()),
    *((KEPT | {"use": {"position": 0.3, row: 1.01}}, ("tube",)) for row in (
        "depth", "nu1", "nu2", "qdot", "tip_speed", "roll", "pitch", "u_q4", "tau_surge")),
    (KEPT | {"mission": {"done": False}}, ("mission",)), (KEPT | {"mission": {"done": True}}, ()),
    (KEPT | {"exits_set": 1, "violations": 1}, ("tube", "limit"))])
def test_every_kind_of_failure_counts(result, kinds):
    assert failures_of(result) == kinds


def test_a_run_that_fails_in_two_ways_is_one_failure_and_none_can_be_left_out(real):
    results = [KEPT | {"index": i} for i in range(60)]
    assert certificate_of(real, results).probability == pytest.approx(1.0 - 0.025**(1.0 / 60.0))
    results[7] |= {"exits_set": 1, "violations": 2}
    results[9] |= {"exits_set": 1}
    results[3] |= {"starts": 5, "use": {"nu1": 0.2, "u_heave": 0.95}}
    results[8] = {"index": 8, "error": "ValueError: x", "starts": 3, "walls": 1}
    found = certificate_of(real, results[::-1])
    assert (found.draws, found.use) == ({"starts": 124, "walls": 60}, {"nu1": 0.6, "u_heave": 0.95})
    assert found.supervisor == {"slope": 0.3}
    assert found.force == {"least": 10.0, "largest": 10.0, "off_line": 0.8}
    assert (found.runs, found.failures, found.failed) == (60, 3, (7, 8, 9))
    assert (found.kinds["tube"], found.kinds["limit"]) == (2, 1)
    assert found.probability == failure_bound(60, 3, 0.975)
    with pytest.raises(AssertionError, match="a run is missing"):
        certificate_of(real, results[1:])
    with pytest.raises(AssertionError):  # Runs of a seed that is not that of the attempt.
        certificate_in_probability(
            make_campaign(real, 1, None, 60), found.attempts, real, results, 0.95)


def test_each_attempt_at_a_task_has_a_larger_bound(real):
    """Clopper and Pearson at 1 − 0.05/(k(k + 1)), whose parts of 0.05 add up to it."""
    results = [KEPT | {"index": i} for i in range(60)]
    found = [certificate_of(real, results, earlier) for earlier in range(3)]
    assert [each.attempt for each in found] == [1, 2, 3]
    for k, each in enumerate(found, 1):
        assert each.probability == pytest.approx(1.0 - (0.05 / (k * (k + 1)))**(1.0 / 60.0))
        assert f"over all attempts (attempt {k})" in each.verdict
    assert sum(1.0 - spent(0.95, k) for k in range(1, 100000)) == pytest.approx(0.05, rel=1e-4)


def test_the_scenarios_own_run_is_among_those_that_are_drawn(real):
    assert certificate_of(real, [KEPT]).never_drawn == ()
    far = uv.load_scenario("girona500_real_loop", [
        "task.force=[5.0, 0.0, 0.0, 0.0, 0.0, 0.0]", "surface.geometry.point=[0.14, 0.0, 0.0]",
        "surface.law.stiffness=300.0"])
    (said,) = certificate_of(far, [KEPT]).never_drawn
    assert said.startswith("wall: 0.")


def test_the_mission_of_every_run_is_a_part_of_the_claim():
    scenario = uv.load_scenario("jacket_inspection_real")
    results = [KEPT | {"index": i, "mission": {"done": i != 2}} for i in range(4)]
    found = certificate_of(scenario, results)
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


@pytest.mark.long
def test_a_drawn_mission_is_done_on_a_wall_of_the_class():
    campaign = make_campaign(drawable(uv.load_scenario("girona500_inspection", SHORT)), 3, None)
    result = run_one(campaign, 0)
    assert result["error"] is None
    assert result["mission"]["failures"] == []
    assert result["mission"]["over_s"] < 30.0
    assert result["wall"]["in_class"]
    assert failures_of(result) == ()
