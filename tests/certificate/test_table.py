"""Tests of `uvms_drake.certificate.table`; the whole table is looked at in test_certify."""

import json
import re
from dataclasses import fields, replace

import numpy as np
import pytest

from uvms_drake.certificate.certificate import Certificate
from uvms_drake.certificate.certify import assumed_conditions
from uvms_drake.certificate.table import HELP, format_certificate, verdict
from uvms_drake.control.limits import HoldRadii, TubeRadii
from uvms_drake.station.contact.mission_legs import Leg
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.tube.conditions import Condition, assumption
from uvms_drake.tube.constants import QUANTITIES, Constant
from uvms_drake.tube.contact.tip_motion import JERK
from uvms_drake.tube.estimates import Estimate
from uvms_drake.tube.law_tube import WEIGHTED
from uvms_drake.tube.ultimate_bounds import HOLD, LIKELY

EMPTY = Certificate(scenario="s", law="resolved", k=1.0, sigma=1.0, d_bound=0.1, files={},
                    inputs="", versions={})


def test_the_first_failed_condition_is_the_verdict():
    certificate = replace(EMPTY, conditions=(
        Condition("fine", 1.0, ">", 0.0, theorem="t"),
        Condition("tube in limits.u[1]", 0.5, "<", 0.3, theorem="t", topic="limits.u"),
        Condition("worse", 9.0, "<", 0.0, theorem="t")))
    assert verdict(certificate).startswith(
        "not certified: tube in limits.u[1]: 0.5 < 0.3 does not hold by 0.2; what would help: ")
    assert format_certificate(certificate).count("DOES NOT HOLD") == 2


def test_a_yes_or_no_or_a_count_is_said_without_a_number():
    broken_assumptions = assumption("faults", "which the proofs do not cover", 2.0, theorem="t")
    kept = replace(broken_assumptions, left=0.0)
    assert verdict(replace(EMPTY, conditions=(broken_assumptions,))).startswith(
        f"not certified: {broken_assumptions.name}")
    assert "does not hold" not in verdict(replace(EMPTY, conditions=(broken_assumptions,)))
    row = format_certificate(replace(EMPTY, conditions=(kept,))).splitlines()[5]
    assert row.split() == ["faults:", "as", "the", "proofs", "assume", "holds"]


def test_a_number_that_is_none_fails_without_an_amount():
    line = verdict(replace(EMPTY, conditions=(Condition("x", np.nan, "<=", 0.0, theorem="t"),)))
    assert line == "not certified: x: nan <= 0 does not hold"


@pytest.mark.parametrize(("override", "line"), [
    ("faults=[!StuckJoint {}]", "not certified: faults, which the proofs do not cover; what would "
                                "help: no faults but those of the solver"),
    ("mpc.terminal_set=false", "not certified: mpc.terminal_set, none; what would help: "
                               "terminal_set: true"),
    ("surface_error.stiffness=1.25", "not certified: surface_error, which the controller does not "
                                     "know: 0.25 <= 0 does not hold by 0.25; what would help: "
                                     "leaving it out: it acts as a disturbance that d̃ does not "
                                     "count")])
def test_what_is_given_up_has_a_number_only_if_it_is_a_quantity(override, line):
    scenario = load_scenario("girona500_ideal", [override])
    assert verdict(replace(EMPTY, conditions=tuple(assumed_conditions(scenario)))) == line


def test_every_step_of_a_mission_has_a_row_and_comes_back_from_a_file():
    legs = (Leg("Approach", 10.0, None, 1.0, 60.0, ""), Leg("Hold", 10.0, 8.5, 5.0, 60.0, "", 3.25),
            Leg("Slide", 12.0, 9.5, 25.0, 50.0, "mission.steps[2], how fast: 2 <= 1"))
    certificate = replace(EMPTY, legs=legs)
    rows = format_certificate(certificate).split("mission:")[1].splitlines()[2:5]
    assert [row.split()[:7] for row in rows] == [
        ["0", "Approach", "10", "-", "-", "1", "60"], ["1", "Hold", "10", "8.5", "3.25", "5", "60"],
        ["2", "Slide", "12", "9.5", "-", "25", "50"]]
    assert rows[2].endswith("not certified: mission.steps[2], how fast: 2 <= 1")
    data = certificate.to_data()
    del data["sha256"], data["certified"]
    assert Certificate.from_data(json.loads(json.dumps(data))).legs == legs
    assert "mission:" not in format_certificate(EMPTY)
    assert "legs" not in EMPTY.to_data()


def test_the_verdict_says_how_much_is_proven():
    certificate = replace(EMPTY, conditions=(Condition("fine", 1.0, ">", 0.0, theorem="t"),),
                          tightening=21,
                          proven=9, estimates=(Estimate("ω", 1.0, 0.5), Estimate("u", 2.0, 1.8)))
    assert verdict(certificate) == (
        "certified: all 1 conditions hold; of the 21 numbers that tighten limits 9 are proven, "
        "12 estimated (a second search found up to 90% of the claims)")
    felt = replace(certificate, estimates=(Estimate(JERK, 1.0, 0.9),))
    assert " 9 are proven, given the jerk of the tip, 12 estimated" in verdict(felt)
    rows = format_certificate(certificate).splitlines()
    title = "estimates: claimed value, and the part of it that a second search found"
    closest = rows.index(title) + 1
    assert rows[closest].split() == ["u", "2", "90%"]
    assert rows[closest + 1].split() == ["ω", "1", "50%"]


@pytest.mark.parametrize("topic", HELP)
def test_every_advice_is_given(topic):
    line = verdict(replace(EMPTY, conditions=(
        Condition("...", 1.0, "<", 0.0, theorem="t", topic=topic),)))
    assert line.endswith(HELP[topic])


def test_a_limit_without_an_advice_of_its_own_has_that_of_all():
    line = verdict(replace(EMPTY, conditions=(Condition(
        "tube in limits.q1", 1.0, "<", 0.0, theorem="t", kind="tightening", topic="limits.q"),)))
    assert line.endswith(HELP["tightening"])


@pytest.mark.parametrize("name", ["girona500_contact", "girona500_real_loop"])
def test_every_topic_of_an_assumption_has_its_advice(name):
    """But those that have one in figures, or none that is known."""
    for condition in assumed_conditions(load_scenario(name)):
        assert condition.kind == "assumption"
        assert condition.name.startswith(f"{condition.about}, ")
        assert condition.topic in HELP or condition.about in (
            "axes that the robot's thrusters do not drive", "contact.tangential_lag")


def test_the_bounds_of_the_components_stand_in_the_place_of_one():
    first = format_certificate(EMPTY).splitlines()[0]
    assert first.endswith("law resolved, k = 1 1/s, σ = 1 1/s, d̃ = 0.1 m/s², rad/s²")
    weighted = replace(EMPTY, weights=np.array([0.2, 0.5, 1.0]))
    assert format_certificate(weighted).splitlines()[0].endswith(
        "σ = 1 1/s, ‖W⁻¹d‖ ≤ 1, W = 0.02, 0.05, 0.1 m/s², rad/s²")


NUMBERS = len(fields(TubeRadii)) - 4
"""Radii of one number: all but those of u, of τ and of two kinds of hold."""


def test_both_bands_of_the_force_stand_under_the_tube_with_the_time_of_the_second():
    hold = HoldRadii(time=1.31, depth=4e-4, position=6e-4, advance=0.0156, standing=0.0025,
                     reading=2.13, age=0.03)
    bounds = {"position": 0.002, "force": 16.83, HOLD: 6.12, LIKELY: 4.95}
    tube = TubeRadii(hold=hold, likely_hold=hold)
    text = format_certificate(replace(EMPTY, tube=tube, bounds=bounds))
    assert "in a hold, from 1.3 s on with the tip of the plan below 2.5 mm/s\n  depth " in text
    assert re.search(r"^  error of a reading +2[.]13 N, along the direction$", text, re.MULTILINE)
    last = text.split("ultimate bound of the force ")[1].splitlines()
    assert last[0].split(maxsplit=1) == [
        "16.83", "N, at touch and in motion, the plan at its target"]
    assert last[1].split(maxsplit=1) == [
        "6.12", "N, in a hold, from 1.3 s after the plan stands"]
    assert last[2].split(maxsplit=1)[0] == "4.95" and last[2].endswith("not certified")
    # And nothing of it without a hold.
    without = format_certificate(replace(EMPTY, tube=TubeRadii(), bounds={"force": 16.83}))
    assert "in a hold" not in without and "ultimate bound of the force" in without


def test_every_constant_and_radius_has_a_unit():
    constants = tuple(Constant(name, 1.5, "estimated", 9, {}, 1.1, 1.25)
                      for name in (*QUANTITIES, *WEIGHTED.values()))
    tube = TubeRadii(*[2.5] * NUMBERS, u=np.array([0.5, 0.25]), tau=np.array([8.0]))
    text = format_certificate(replace(EMPTY, constants=constants, tube=tube))
    for name, unit in (("J_max", "-"), ("Jx_W_max", "-"), ("J_dot_max", "1/s")):
        assert re.search(rf"^  {name} +1[.]5 {unit} +estimated, 9 samples", text, re.MULTILINE)
    for name, unit in (("e", "m, rad"), ("nu2", "rad/s"), ("roll", "rad"), ("z", "m/s, rad/s")):
        assert re.search(rf"^  {name} +2[.]5 {unit}$", text, re.MULTILINE)
    assert re.search(r"^  u +0[.]5, 0[.]25 m/s², rad/s²$", text, re.MULTILINE)
    assert re.search(r"^  tau +8 N, N m$", text, re.MULTILINE)


def test_radii_that_a_motion_has_not_are_not_in_the_table():
    tube = TubeRadii(*[2.5] * NUMBERS, u=np.zeros(0), tau=None)
    lines = format_certificate(replace(EMPTY, tube=tube)).splitlines()
    assert not any(line.startswith(("  u ", "  tau ")) for line in lines)
