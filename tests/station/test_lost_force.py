"""A force sensor that fails while the robot presses by what it feels: the whole closed loop."""

import numpy as np
import pytest
from support.unknown_wall import close_to_the_wall

import uvms_drake as uv
from uvms_drake.report.events import events
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.problem import true_surface

WALL = "surface.geometry.point.0=0.01"


@pytest.mark.long
@pytest.mark.parametrize(("fault", "start", "end"), [
    ("!LostForce {start: 3.0, duration: 1.0}", 3.0, 4.0),
    ("!FrozenForce {start: 1.0, duration: 1.5}", 1.0, 2.5),
])
def test_it_retreats_presses_no_harder_and_goes_on_by_itself(fault, start, end):
    """While it presses, and before it touches."""
    scenario = close_to_the_wall(
        WALL, "duration=8.5", "log_period=0.01", f"faults=[{fault}]")
    record = uv.simulate(scenario)
    contact, felt = sensed_contact(scenario), record.signals["force_last_valid"]
    static = true_surface(scenario).static_force(record.chi)
    assert static.max() <= contact.force
    assert np.all(record.mpc_status == 0.0)
    assert max(record.mpc_violation.max(), record.mpc_terminal_slack.max()) <= 1e-6
    lost = record.signals["force_lost"][:, 0] > 0.0
    assert start < record.time[lost][0] < start + 0.9
    assert not np.any(lost[record.time > end + 0.05])
    assert np.mean(np.any(felt[lost], axis=1)) < 0.1, "but for samples at which it comes back"
    retreats = [event for event in events(record) if event.kind == "force_lost"]
    assert record.time[lost][0] == retreats[0].start
    assert retreats[-1].end is not None
    assert static[-1] > 4.0, "it is back on its way to the desired force"


def test_who_feels_nothing_any_more_has_no_force_in_the_law_and_goes_back():
    """Soon after the tare, off the wall; and the front stays where it was."""
    scenario = close_to_the_wall(
        "duration=1.2", "log_period=0.01", "faults=[!FrozenForce {start: 0.6, duration: 9}]")
    record = uv.simulate(scenario)
    lost = record.signals["force_lost"][:, 0] > 0.0
    x = record.chi[:, 0]
    at = np.argmax(lost)
    assert record.time[at] == pytest.approx(0.6 + 0.01 * (4 + 10), abs=0.021)
    assert np.all(lost[at:])
    assert not np.any(record.signals["force_last_valid"][lost])
    held = record.signals["force_last_valid"][(record.time > 0.61) & ~lost]
    assert np.all(held == held[0]) and np.all(held[0] != 0.0)
    y, tilt = record.chi[lost, 1:3], sensed_contact(scenario).walls.tilt
    aside = np.max(np.sum(np.abs(y - y[0]), axis=1))  # The front is a pyramid.
    assert np.ptp(record.signals["safe_depth"][lost]) <= 1.2 * tilt * aside
    target = record.signals["target"][lost, 0]
    assert np.ptp(target) == 0.0
    a_sample = scenario.mpc.time_step * np.max(np.gradient(x, record.time))
    assert target[0] == pytest.approx(x[at] - 0.05, abs=a_sample)
    assert record.nominal_zeta[-1, 0] < 0.0 < np.max(record.nominal_zeta[:, 0])
