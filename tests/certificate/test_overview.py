"""The certificate in short: five numbers, or each failed condition with advice."""

from dataclasses import replace

import numpy as np
import pytest

from uvms_drake.certificate.certificate import Certificate
from uvms_drake.certificate.certify import assumed_conditions
from uvms_drake.certificate.overview import force_bounds, format_overview, tightest_limit
from uvms_drake.certificate.table import format_certificate
from uvms_drake.station.contact.mission_legs import Leg
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.ultimate_bounds import HOLD


def tightened(label: str, radius: float, limit: float) -> Condition:
    """Returns the condition that the tube leaves something of a limit."""
    return Condition(f"tube in limits.{label}", radius, "<", limit, theorem="t", kind="tightening",
                     topic="limits.u" if label[0] == "u" else "", about=label)


HOLDS = Certificate(
    scenario="girona500_contact", law="resolved", k=50.0, sigma=50.0, d_bound=0.1, files={},
    inputs="", versions={}, tightening=24, proven=10,
    bounds={"position": 0.002041, "orientation": 0.007, "force": 16.79},
    conditions=(Condition("fine", 1.0, ">", 0.0, theorem="t"),
                tightened("q1", 0.01, 0.25),
                tightened("u[2]", 0.56, 0.7),
                tightened("nu1", 0.007, 0.15)))


@pytest.fixture
def scenario():
    return load_scenario("girona500_contact")


def forces(certificate, scenario):
    return force_bounds(
        certificate, scenario.contact.force_limit(scenario.limits), scenario.task.force)


def rows_of(text):
    """Returns the texts of the rows by their first 18 characters."""
    return {line[:18].strip(): line[18:] for line in text.splitlines()}


def test_a_certificate_that_holds_is_a_verdict_and_five_numbers(scenario):
    text = format_overview(HOLDS, forces(HOLDS, scenario), 27.31)
    assert len(text.splitlines()) == 7
    assert text.startswith("girona500_contact: certified: all 4 conditions hold; of the 24 ")
    rows, largest = rows_of(text), scenario.contact.force
    assert rows["largest force"] == (f"{largest:.4g} N in motion, 36.79 N in a hold of 20 ± 16.8 N;"
                                     " static, without impact and damping")
    assert rows["end-effector"] == "within 2.04 mm and 7 mrad of the plan"
    assert rows["tightest limit"] == (
        "u[2]: the tube takes 80 %, 0.14 of 0.7 is left for the plan")
    assert rows["proven"] == "10 of the 24 numbers that tighten limits; 14 estimated"
    assert rows["computed in"] == "27.3 s"


def test_the_tightest_limit_is_that_of_the_largest_part_and_not_of_the_smallest_number():
    assert tightest_limit(HOLDS).name == "tube in limits.u[2]"
    assert tightest_limit(replace(HOLDS, conditions=())) is None


def test_a_force_is_limited_by_what_the_scenario_limits():
    known = load_scenario("girona500_ideal")
    assert forces(HOLDS, known).motion == known.limits.static_force
    assert forces(replace(HOLDS, bounds={}), known).error is None


def test_the_band_of_a_hold_is_that_of_a_plan_that_has_stood_where_there_is_one(scenario):
    stood = replace(HOLDS, bounds=HOLDS.bounds | {HOLD: 3.25})
    text = format_overview(stood, forces(stood, scenario))
    assert " 23.25 N in a hold of 20 ± 3.25 N" in text


def test_a_mission_holds_with_its_hardest_step(scenario):
    legs = (Leg("Approach", 10.0, None, 1.0, 60.0, ""), Leg("Hold", 12.0, 8.5, 5.0, 60.0, ""),
            Leg("Slide", 10.0, 11.0, 25.0, 50.0, ""))
    assert forces(replace(HOLDS, legs=legs), scenario)[1:] == (10.0, 11.0)
    stood = (*legs[:2], replace(legs[2], hold_band=2.0))
    assert forces(replace(HOLDS, legs=stood), scenario)[1:] == (12.0, 8.5)


def test_every_failed_condition_is_told_by_how_much_and_with_advice(scenario):
    failing = replace(HOLDS, conditions=(
        *HOLDS.conditions, tightened("u[1]", 0.5, 0.3),
        Condition("first plan, distance to the terminal set", 2.0, "<=", 1.0,
                  "--set mpc.horizon=23", theorem="t", topic="first plan to the terminal set"),
        Condition("unheard of", np.nan, "<=", 1.0, theorem="t")))
    lines = format_overview(failing, forces(failing, scenario)).splitlines()
    begin = lines.index("does not hold")
    assert lines[begin + 1] == "  tube in limits.u[1]: 0.5 < 0.3 does not hold by 0.2"
    assert lines[begin + 2].startswith("    what would help: a smaller disturbance.bound")
    assert lines[begin + 4].startswith("    what would help: --set mpc.horizon=23, or a longer")
    assert lines[-1] == "  unheard of: nan <= 1 does not hold"
    assert not any("largest force" in line for line in lines), "nothing is claimed"


def test_an_assumption_that_is_kept_does_not_read_like_its_opposite(scenario):
    """D15: `none of this: faults, which the proofs do not cover ... holds`."""
    text = format_certificate(replace(HOLDS, conditions=tuple(assumed_conditions(scenario))))
    assert "none of this" not in text
    assert "  faults: as the proofs assume " in text
