"""Tests of `uvms_drake.certificate.assumptions`."""

import json
from dataclasses import replace

import pytest
from support.scenarios import OF_A_STATION

from uvms_drake.certificate.assumptions import (
    SCOPE,
    Assumption,
    assumptions_of,
    scope_of,
    undriven_axes,
    unnamed_axes,
)
from uvms_drake.certificate.certificate import Certificate
from uvms_drake.certificate.certify import assumed_conditions
from uvms_drake.certificate.table import format_certificate, scope, verdict
from uvms_drake.common.errors import ScenarioError
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import load_scenario

REAL = ("bluerov2_real_loop", "girona500_real_loop", "jacket_inspection_real")
"""Scenarios with thrusters, which are not certified."""


def unmet(scenario):
    return [item.name for item in assumed_conditions(scenario) if not item.holds]


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
    (failed,) = [item for item in assumed_conditions(scenario) if not item.holds]
    assert failed.advice.startswith("--set 'actuation=[!IdealWrench {undriven: [roll]}]'")
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


def test_the_first_lines_of_the_verdict_are_its_scope():
    scenario = load_scenario("girona500_contact")
    certificate = Certificate(
        scenario="s", law="resolved", k=1.0, sigma=1.0, d_bound=0.1, files={}, inputs="",
        versions={}, assumptions=assumptions_of(scenario, load_model(scenario)))
    lines = format_certificate(certificate).splitlines()
    assert lines[-4:] == [*scope(certificate), verdict(certificate)]
    assert lines[-4].startswith("asked for actuation: an ideal wrench on six axes")
    assert "every wall, 0.09 m or more off the tip at the start" in lines[-2]
    held = [line for line in lines if line.endswith("[operator]")]
    assert len(held) == sum(item.guaranteed_by == "operator" for item in certificate.assumptions)
    data = certificate.to_data()
    assert {"statement", "guaranteed_by"} <= set(data["assumptions"][0])
    assert Certificate.from_data(json.loads(json.dumps(data))).assumptions == (
        certificate.assumptions)


def test_a_clock_or_a_lag_is_in_the_statement_of_the_wrench():
    for name, words in (("girona500_sampled", "zero-order hold of 0.00391 s"),
                        ("girona500_lag", "lag of 0.03 s")):
        scenario = load_scenario(name)
        assert words in scope_of(assumptions_of(scenario, load_model(scenario)))["actuation"]
        assert unmet(scenario) == []


def test_a_lag_behind_a_clock_is_stated_with_both_and_its_dead_time():
    scenario = load_scenario("girona500_sampled", [
        "actuation=[!SampledCommand {period: 0.02, delay: 0.01}, "
        "!LaggedWrench {lag: 0.1, dead_time: 0.03}, !IdealWrench {undriven: [roll]}]"])
    found = scope_of(assumptions_of(scenario, load_model(scenario)))
    assert ("under a zero-order hold of 0.02 s, 0.01 s late, the wrench sampled every 0.01 s, with "
            "a lag of 0.1 s after a dead time of 0.03 s") in found["actuation"]
    assert "at the ticks of the clock" in found["sensing"]


def test_the_first_of_several_statements_is_the_scope():
    first = Assumption("surface", "a", "operator")
    assert scope_of([first, replace(first, statement="b")]) == {"surface": "a"}
