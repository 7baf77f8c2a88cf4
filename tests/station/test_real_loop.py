"""The shipped scenarios of vehicles as they are: thrusters, clocks, navigation, wrong models."""

import numpy as np
import pytest

import uvms_drake as uv
from uvms_drake.certificate.assumptions import assumed_conditions
from uvms_drake.report.events import events


@pytest.mark.parametrize("name", ["bluerov2_real_loop", "girona500_real_loop"])
def test_it_says_what_no_proof_covers(name):
    given_up = [item.name.split(",")[0] for item in assumed_conditions(
        uv.load_scenario(name)) if not item.holds]
    assert given_up == [
        "sensing[0]", "actuation[0]", "actuation[1]", "current", "model_error",
        "contact.tangential_lag"]


def test_what_is_logged_as_felt_is_what_the_law_takes_slowly():
    station = uv.make_station(uv.load_scenario("girona500_real_loop"))
    sources = {(to[0].get_name(), to[0].get_input_port(to[1]).get_name()): of[0].get_name()
               for to, of in station.connection_map().items()}
    assert sources["tangential_filter", "measured"] == "hold_last_value"
    assert sources["log.force_last_valid", "data"] == "hold_last_value"
    assert sources["tube_mpc", "force_measured"] == "tangential_filter"


@pytest.mark.slow
def test_it_hovers_until_its_forces_can_be_there_and_keeps_to_the_plan_then():
    """First for its observers, then until what its plan asks for can be there; without a roll."""
    record = uv.simulate(uv.load_scenario("girona500_real_loop", [
        "duration=1.2", "mpc.hover=0.2", "start.eta.3=0"]))
    moving = np.any(record.nominal_state[:, 10:] != record.nominal_state[0, 10:], axis=1)
    assert record.time[np.argmax(moving)] == pytest.approx(0.62)
    assert [(event.start, event.end) for event in events(record) if event.kind == "hovering"] == [
        (0.0, pytest.approx(0.2))]
    vehicle = np.linalg.norm(record.state[:, :3] - record.nominal_state[:, :3], axis=1)
    tip = np.linalg.norm(record.chi[:, :3] - record.chi_nominal[:, :3], axis=1)
    assert np.max(vehicle) < 5e-3
    assert np.max(tip) < 3e-3
    assert not record.input_limited.any()
