"""Tests of `uvms_drake.certificate.assumptions`."""

from dataclasses import replace

import pytest
from support.scenarios import OF_A_STATION

from uvms_drake.certificate.assumptions import (
    SCOPE,
    Assumption,
    assumed_conditions,
    assumptions_of,
    scope_of,
    undriven_axes,
    unnamed_axes,
)
from uvms_drake.common.errors import ScenarioError
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import load_scenario

REAL = ("bluerov2_real_loop", "girona500_real_loop", "jacket_inspection_real")
"""Scenarios with thrusters, which are not certified."""


def unmet(scenario):
    return [item.name for item in assumed_conditions(scenario)
            if not item.holds]


@pytest.mark.parametrize("name", sorted(set(OF_A_STATION) - set(REAL)))
def test_every_shipped_scenario_names_the_axes_that_its_robot_does_not_drive(name):
    scenario = load_scenario(name)
    model = load_model(scenario)
    assert unnamed_axes(scenario.actuation, model) == ()
    statement = scope_of(assumptions_of(scenario, model))["actuation"]
    assert ("NOT girona500_arm5e as it is, whose thrusters drive no roll" in statement) == (
        scenario.model == "girona500_arm5e")


@pytest.mark.parametrize("name", OF_A_STATION)
def test_every_assumption_is_a_statement_with_a_guarantor(name):
    scenario = load_scenario(name)
    found = assumptions_of(scenario, load_model(scenario))
    assert list(scope_of(found)) == list(SCOPE)
    assert all(item.statement and item.guaranteed_by for item in found)
    assert len({item.statement for item in found}) == len(found)


def test_a_robot_with_undriven_axes_is_not_certified_unless_the_scenario_names_them():
    for override in ("actuation=[]", "actuation=[!IdealWrench {}]",
                     "actuation=[!IdealWrench {undriven: [sway]}]"):
        scenario = load_scenario("girona500_ideal", [override])
        (name,) = unmet(scenario)
        assert name.endswith("unnamed by an !IdealWrench: roll")
    (advice,) = [item.advice for item in assumed_conditions(scenario)
                 if not item.holds]
    assert advice.startswith("--set 'actuation=[!IdealWrench {undriven: [roll]}]'")
    assert unmet(load_scenario("girona500_ideal")) == []
    assert unmet(load_scenario("bluerov2_ideal", ["actuation=[]"])) == []


def test_limits_of_thrusters_are_no_wrench_on_an_undriven_axis():
    scenario = load_scenario("girona500_ideal", ["limits.thrusters=[1]", "actuation=[]"])
    assert undriven_axes(load_model(scenario)) == ("roll",)
    assert unmet(scenario)


@pytest.mark.parametrize("actuation", [
    "[!IdealWrench {}, !SampledCommand {}]", "[!Thrusters {}, !IdealWrench {}]",
    "[!IdealWrench {undriven: [up]}]"])
def test_an_ideal_wrench_is_the_last_part_on_axes_that_exist(actuation):
    with pytest.raises(ScenarioError, match=r"actuation\[\d\]"):
        load_scenario("girona500_ideal", [f"actuation={actuation}"])


def test_clock_lag_and_dead_time_are_in_the_statement_of_the_wrench():
    scenario = load_scenario("girona500_real_loop")
    found = scope_of(assumptions_of(scenario, load_model(scenario)))
    assert "the thrusters of girona500_arm5e as its files have them" in found["actuation"]
    assert "at the ticks of the clock" in found["sensing"]


def test_the_first_of_several_statements_is_the_scope():
    first = Assumption("surface", "a", "operator")
    assert scope_of([first, replace(first, statement="b")]) == {"surface": "a"}
