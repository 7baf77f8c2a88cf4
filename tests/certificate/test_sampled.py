"""Tests of the certificate of a command that is sampled and held."""

from dataclasses import replace

import pytest

from uvms_drake.actuation import SampledCommand, Thrusters
from uvms_drake.certificate.certify import assumed_conditions, certify
from uvms_drake.control.laws import Resolved
from uvms_drake.station.scenario.scenario import load_scenario


@pytest.fixture(scope="module")
def sampled():
    return load_scenario("girona500_sampled")


def failed(scenario):
    return [condition.name for condition in assumed_conditions(scenario) if not condition.holds]


def test_a_clock_alone_is_counted_under_tip_first_and_nothing_else_is(sampled):
    assert failed(sampled) == []
    for other in (replace(sampled, actuation=[*sampled.actuation, Thrusters()]),
                  replace(sampled, ancillary=Resolved(k=40.0, sigma=40.0))):
        assert any("SampledCommand" in name for name in failed(other))


@pytest.mark.long
def test_the_sampled_scenario_is_certified_and_with_a_clock_of_40_hertz_it_is_not(sampled):
    certificate = certify(sampled)
    assert certificate.certified
    assert certificate.tube.position < 1e-3
    slow = certify(replace(sampled, actuation=[SampledCommand(period=0.025, delay=0.0)]))
    assert not slow.certified
