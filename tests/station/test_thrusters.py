"""A closed loop with thrusters, by a scenario's file."""

import numpy as np
import pytest

import uvms_drake as uv
from uvms_drake.certificate.assumptions import assumed_conditions
from uvms_drake.common.errors import ScenarioError
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.signals.sensor_actuator import VEHICLE_WRENCH
from uvms_drake.station.scenario.scenario import dump_scenario

PART = "actuation=[!Thrusters {lag: 0.2, dead_time: 0.02, error: [0.1]}]"


def test_a_law_takes_what_the_thrusters_give_by_their_model():
    scenario = uv.load_scenario("girona500_ideal", [
        "duration=0.3", PART, "ancillary=!TipFirst {undriven: [roll]}"])
    record = uv.simulate(scenario)
    force, wrench = (record.signals[name] for name in ("thruster_force", VEHICLE_WRENCH))
    known = ThrusterModel.of(record.model.thrusters)
    np.testing.assert_allclose(wrench, force @ known.B.T / 1.1, atol=1e-9)
    assert np.ptp(force, axis=0).max() > 1.0
    # The law gives joints torques for the wrench as it is: the tip goes as it is planned to.
    off = np.linalg.norm(record.chi[:, :3] - record.chi_nominal[:, :3], axis=1)
    assert np.max(off) < 5e-4


def test_thrusters_void_a_certificate_and_say_why():
    scenario = uv.load_scenario("girona500_ideal", [PART])
    given_up = [condition.name for condition in assumed_conditions(scenario) if not condition.holds]
    assert given_up == ["actuation[0], Thrusters: the proofs take the vehicle's wrench for given "
                        "at once and on all six axes"]


@pytest.mark.parametrize("name", ["girona500_tip_first", "girona500_contact"])
def test_what_is_late_voids_a_certificate_with_a_budget_and_without(name):
    late = "actuation=[!SampledCommand {period: 0.001, delay: 0.0}, !Thrusters {}]"
    given_up = [item.name for item in assumed_conditions(
        uv.load_scenario(name, [late])) if not item.holds]
    assert [each.partition(":")[0] for each in given_up] == [
        "actuation[0], SampledCommand", "actuation[1], Thrusters"]


def test_a_scenarios_thrusters_are_checked_and_written_in_full():
    assert "dead_time: 0.02" in dump_scenario(uv.load_scenario("girona500_ideal", [PART]))
    with pytest.raises(ScenarioError, match=r"actuation\[0\]\.dead_time = 0\.003: must be a mult"):
        uv.load_scenario("girona500_ideal", ["actuation=[!Thrusters {dead_time: 0.003}]"])
