"""Tests of `uvms_drake.station.scenario.remarks`."""

import pytest

import uvms_drake as uv
from uvms_drake.station.scenario.scenario import remarks
from uvms_drake.station.scenario.scenario_file import shipped_scenarios


@pytest.mark.parametrize("name", list(shipped_scenarios()))
def test_nothing_is_in_vain_in_a_shipped_scenario(name):
    assert remarks(uv.load_scenario(name)) == []


@pytest.mark.parametrize(("override", "expected"), [
    ("faults=[{start: 3}, !LostState {start: 20}]",
     "faults[1].start = 20 s is after the end of the run: it never happens"),
    ("task.pose.0=7", "task.pose is 6.98 m off the surface: along its normal, the desired force "
     "determines the position"),
    ("mpc.hover=30", "mpc.hover = 30 s is not before the end of the run: the robot only hovers, "
     "and no tube is monitored without a certificate"),
    ("simulator.max_step_size=1",
     "simulator.max_step_size = 1 s is cut to 0.02 s by the log or the MPC"),
    ("sensing=[!ForceSensor {}, !Navigation {}]", "sensing[0] measures the force in the true "
     "attitude: parts that change the measured one come after it")])
def test_what_has_no_effect_is_said(override, expected):
    assert remarks(uv.load_scenario("girona500_ideal", [override])) == [expected]
