"""Tests of the failures that a certificate in probability counts, and of its distribution."""

from dataclasses import replace

import numpy as np
import pytest
from support.missions import SHORT, TIMES, mission_record
from uvms_drake.certificate.drawn_values import drawn_values, outside_ranges

from uvms_drake.campaign.campaign import make_campaign
from uvms_drake.campaign.contact_metrics import mission_metrics
from uvms_drake.campaign.model_uncertainty import as_declared, as_declared_thrusters
from uvms_drake.campaign.probability.declared_distribution import (
    declared_distribution,
    declared_ranges,
)
from uvms_drake.campaign.probability.failures import certificate_in_probability, failures_of
from uvms_drake.campaign.run import run_one
from uvms_drake.campaign.variation import vary
from uvms_drake.certificate.certificate import probability_fingerprint
from uvms_drake.command.campaign.runs import drawable
from uvms_drake.common.errors import ScenarioError
from uvms_drake.mission.law import RUNNING, SKIPPED, TIME_OUT
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import dump_scenario, load_scenario

KEPT = {"index": 0, "error": None, "finite": True, "exits_set": 0, "exits_trajectory": 0,
        "violations": 0, "limited": False, "mpc_failures": 0, "losses": 0, "inside": True,
        "wall": {"static": 0.4, "peak": 0.5, "losses": 0, "in_class": True,
                 "first_touch_s": 12.0}}


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("girona500_real_loop")


@pytest.fixture(scope="module")
def campaign(scenario):
    return make_campaign(scenario, 1, None)


def with_wall(**changes):
    return KEPT | {"wall": KEPT["wall"] | changes}


@pytest.mark.parametrize(("result", "kinds"), [
    (KEPT, ()), (KEPT | {"inside": False}, ()), (with_wall(in_class=False), ()),
    ({"index": 0, "error": "ValueError: x"}, ("exception",)),
    (KEPT | {"finite": False}, ("not finite",)), (KEPT | {"exits_set": 1}, ("tube",)),
    (KEPT | {"exits_trajectory": 2}, ("tube",)), (KEPT | {"violations": 3}, ("limit",)),
    (KEPT | {"limited": True}, ("saturation",)), (with_wall(static=1.01), ("force",)),
    (with_wall(peak=1.01, in_class=False), ("force",)), (KEPT | {"mpc_failures": 1}, ("no plan",)),
    (with_wall(first_touch_s=None), ("no touch",)),
    (KEPT | {"losses": 1}, ("contact",)), (with_wall(losses=1), ("contact",)),
    (KEPT | {"mission": {"done": True, "failures": ["Slide 4: time-out"]}}, ()),
    (KEPT | {"mission": {"done": False}}, ("mission",)),
    (with_wall(first_touch_s=None) | {"mission": {"done": False}}, ("no touch", "mission")),
    (KEPT | {"apart": {"tip": 0.4, "joints": 0.9}}, ()),
    (KEPT | {"apart": {"tip": 0.4, "joints": 1.01}}, ("linear",)),
    (KEPT | {"apart": {"tip": 0.4, "joints": None}}, ("linear",)),
    (KEPT | {"apart": {"tip": 0.4, "joints": float("nan")}}, ("linear",)),
    (KEPT | {"plan": {"approach": 0.9, "press": 1.0, "start": 0.1}}, ()),
    (KEPT | {"plan": {"approach": 1.01, "press": 0.5}}, ("plan",)),
    (KEPT | {"plan": {"approach": 0.5, "press": None}}, ("plan",)),
    (KEPT | {"exits_set": 1, "violations": 1}, ("tube", "limit"))])
def test_every_kind_of_failure_counts(result, kinds):
    assert failures_of(result) == kinds


def test_a_run_that_fails_in_two_ways_is_one_failure(campaign, scenario):
    results = [KEPT | {"index": i} for i in range(60)]
    results[7] |= {"exits_set": 1, "violations": 2}
    results[9] |= {"exits_set": 1}
    found = certificate_in_probability(campaign, scenario, results[::-1], 0.95)
    assert (found.runs, found.failures, found.failed) == (60, 2, (7, 9))
    assert (found.kinds["tube"], found.kinds["limit"]) == (2, 1)
    assert found.apart == {} and found.plan == {}
    assert found.probability == pytest.approx(0.1012, abs=1e-4)
    assert certificate_in_probability(
        campaign, scenario, [KEPT | {"index": i} for i in range(60)], 0.95
    ).probability == pytest.approx(1.0 - 0.05**(1.0 / 60.0))


def test_the_largest_distance_from_the_linear_loop_is_kept(campaign, scenario):
    results = [KEPT | {"index": i, "apart": {"tip": 0.1 * i, "joints": 1.1 - 0.3 * i}}
               for i in range(3)]
    found = certificate_in_probability(campaign, scenario, results, 0.95)
    assert found.apart == pytest.approx({"tip": 0.2, "joints": 1.1})
    assert (found.failed, found.kinds["linear"]) == ((0,), 1)


def test_no_run_can_be_left_out(campaign, scenario):
    with pytest.raises(AssertionError, match="a run is missing"):
        certificate_in_probability(campaign, scenario, [KEPT, KEPT | {"index": 2}], 0.95)


def test_the_distribution_is_told_with_the_scenarios_own_sizes(scenario):
    text = "\n".join(declared_distribution(scenario))
    for part in ("mass 0.1", "current 0.1 m/s from any heading", "uniform from 5 to 21.3 N",
                 "friction up to 0.5", "stiffness from 0.1 of 1000 N/m"):
        assert part in text, part
    assert "waves" not in text
    wavy = load_scenario(scenario.name, [
        "waves=[{amplitude: 0.1}]", "model_error.joint_friction.coulomb=[0.5]",
        "model_error.payload.mass=0.5", "disturbance.bound=0.02"])
    text = "\n".join(declared_distribution(wavy))
    for part in ("waves 0.0", "joint friction 0.5 N m", "payload 0.5 kg", "full bound 0.02"):
        assert part in text, part


def test_the_mission_of_every_run_is_a_part_of_the_distribution_and_of_the_claim():
    scenario = load_scenario("jacket_inspection_real")
    text = "\n".join(declared_distribution(scenario))
    for part in ("mission, the same in every run: approach ", "at (-0.2, 0.06) m",
                 "slide force 10 N, along (0.5, 0) m, speed 0.02 m/s", "wherever the mission may"):
        assert part in text, part
    assert "desired force: uniform" not in text
    assert "turned by any angle" not in text  # Its places are along axes of the world.
    ranges = {each.name: each for each in declared_ranges(scenario)}
    assert (ranges["task.force"].low, ranges["task.force"].high) == (10.0, 10.0)
    # Of four runs one did not complete it.
    results = [KEPT | {"index": i, "mission": {"done": i != 2}} for i in range(4)]
    found = certificate_in_probability(
        make_campaign(scenario, 1, None), scenario, results, 0.95)
    assert found.mission == ("approach, hold, retreat, approach, hold, retreat, approach, hold, "
                             "slide, retreat")
    assert (found.failed, found.kinds["mission"]) == ((2,), 1)
    assert found.verdict.endswith(f"for the declared distribution of the mission {found.mission}")


def test_it_is_told_how_a_mission_ended_and_which_attempts_failed():
    assert mission_metrics(mission_record()) == {
        "done": True, "outcome": "done", "over_s": pytest.approx(5.0), "failures": []}
    time = mission_record().time
    stopped = mission_metrics(mission_record(
        outcome=np.where(time < 5.0, RUNNING, SKIPPED), failures=1.0 * (time >= 4.0),
        reason=np.where(time < 4.0, 0, TIME_OUT)))
    assert (stopped["done"], stopped["outcome"]) == (False, "skipped in part")
    assert stopped["failures"] == ["Slide 2: time-out"]
    unfinished = mission_metrics(mission_record(
        outcome=0.0 * time + RUNNING, step=np.searchsorted(TIMES[1:-1], time + 1e-9)))
    assert (unfinished["done"], unfinished["over_s"]) == (False, None)
    assert unfinished["failures"] == ["Retreat 3: not over"]


@pytest.mark.slow
def test_a_drawn_mission_is_done_on_a_wall_of_the_class():
    campaign = make_campaign(drawable(load_scenario("girona500_inspection", SHORT)), 3, None)
    result = run_one(campaign, 0)["result"]
    assert result["error"] is None
    assert result["mission"]["failures"] == []
    assert result["mission"]["over_s"] < 30.0
    assert result["wall"]["in_class"]
    assert failures_of(result) == ()


@pytest.mark.slow
def test_what_is_drawn_is_in_the_declared_ranges(campaign):
    """But for the place of the vehicle, which is shifted with everything."""
    ranges = [each for each in declared_ranges(campaign.base) if "start.eta" not in each.name]
    drawn = [vary(campaign, index).scenario for index in range(4)]
    values = [drawn_values(each, load_model(each)) for each in drawn]
    for each in values:
        assert {entry.name for entry in ranges} <= each.keys()
        assert outside_ranges(ranges, each) == []
    for name in ("task.force", "wall, distance", "current, horizontal", "model_error.mass"):
        assert len({each[name] for each in values}) > 1, name


def test_waves_and_friction_are_drawn_where_they_are_declared(scenario):
    declared = load_scenario(scenario.name, [
        "waves=[{amplitude: 0.1, period: 6.0}]", "model_error.joint_friction.static=[0.5]"])
    drawn = []
    for seed in range(20):
        each = as_declared(declared.unknowns, np.random.default_rng(seed))
        drawn.append(replace(declared, model_error=each.error, current=each.current,
                             waves=each.waves))
    ranges = [each for each in declared_ranges(declared)
              if each.name in ("waves", "model_error.joint_friction")]
    model = load_model(declared)
    values = [drawn_values(each, model) for each in drawn]
    assert all(outside_ranges(ranges, each) == [] for each in values)
    for entry in ranges:
        reached = [each[entry.name] for each in values]
        assert max(reached) == pytest.approx(entry.high)
        assert min(reached) < 0.5 * entry.high
    assert len({each.waves[0].phase for each in drawn}) == 20
    # Without them the same numbers are drawn as ever.
    plain = as_declared(scenario.unknowns, np.random.default_rng(0))
    assert plain.error.mass == drawn[0].model_error.mass
    assert plain.waves == []


def test_errors_of_the_thrusters_are_drawn_one_by_one_where_they_are_declared(scenario):
    declared = load_scenario(scenario.name, ["actuation.1.error=[0.1]"])
    text = "\n".join(declared_distribution(declared))
    assert "force of each thruster off by 0.1 of it; each of either sign" in text
    assert "thruster" not in "\n".join(declared_distribution(scenario))
    model = load_model(declared)
    drawn = [as_declared_thrusters(declared.actuation, model, np.random.default_rng(seed))
             for seed in range(60)]
    errors = np.array([thrusters.error for _, thrusters in drawn])
    assert errors.shape == (60, 5)
    assert np.max(np.abs(errors)) == pytest.approx(0.1)
    assert 0.15 < np.mean(np.abs(errors) > 0.1 - 1e-12) < 0.35  # A quarter is of the full size.
    assert np.all(np.abs(np.mean(errors, axis=0)) < 0.03)
    assert np.all(np.abs(np.corrcoef(errors.T) - np.eye(5)) < 0.5)
    # Each is in the declared range, and of the same certificate.
    (entry,) = (each for each in declared_ranges(declared) if each.name == "thrusters.error")
    assert (entry.low, entry.high) == (0.0, 0.1)
    for actuation in drawn[:3]:
        each = replace(declared, actuation=actuation)
        assert outside_ranges([entry], drawn_values(each, model)) == []
        assert (probability_fingerprint(each)["inputs"]
                == probability_fingerprint(declared)["inputs"])
    larger = load_scenario(scenario.name, ["actuation.1.error=[0.1, 0.0, -0.11, 0.0, 0.0]"])
    assert outside_ranges([entry], drawn_values(larger, model)) == [
        "thrusters.error is 0.11, declared from 0 to 0.1"]
    # Without them no number is drawn.
    rng = np.random.default_rng(1)
    assert as_declared_thrusters(scenario.actuation, model, rng) == scenario.actuation
    assert rng.uniform() == np.random.default_rng(1).uniform()


def test_drawn_errors_of_the_thrusters_leave_every_other_draw_as_it_is(scenario, campaign):
    other = load_scenario(scenario.name, ["actuation.1.error=[0.1]"])
    plain, wrong = (vary(each, 0).scenario for each in (campaign, make_campaign(other, 1, None)))
    assert np.max(np.abs(wrong.actuation[1].error)) > 0.0
    assert len(set(wrong.actuation[1].error)) == 5 or 0.1 in np.abs(wrong.actuation[1].error)
    wrong.actuation[1].error = np.zeros(1)
    assert dump_scenario(wrong) == dump_scenario(plain)


@pytest.mark.parametrize(("override", "said"), [
    ("actuation.1.error=[1.5]", "actuation[1].error = [1.5]: must be numbers between -1 and 1"),
    ("actuation.1.error=0.1", "actuation[1].error = 0.1: must be a list")])
def test_an_error_of_the_thrusters_without_a_meaning_is_one_line(scenario, override, said):
    with pytest.raises(ScenarioError) as refused:
        load_scenario(scenario.name, [override])
    assert said in str(refused.value) and "\n" not in str(refused.value)
