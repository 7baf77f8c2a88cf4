"""Tests of `uvms_drake.report.thrusters`: numbers and figure of a run with thrusters."""

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from support.synthetic import synthetic_record

from uvms_drake.actuation import Thrusters
from uvms_drake.report.figure_style import STYLE
from uvms_drake.report.figures import FIGURES, figures_of
from uvms_drake.report.summary import format_summary, summarise


@pytest.fixture(scope="module")
def record():
    """Forces of a sine of 80 N a second after the command; the third thruster is at its limit."""
    base = synthetic_record(4.0)
    scenario = replace(base.scenario, actuation=[Thrusters()])
    wave = np.sin(np.pi * base.time)[:, None] * np.ones(5)
    command = 0.5 * wave
    command[:, 2] = np.where(base.time < 1.0, 1.0, 0.0)
    return replace(base, scenario=scenario, signals={
        "thruster_command": command, "thruster_force": 80.0 * wave})


def test_the_summary_has_each_thrusters_forces_and_limits(record):
    rows = summarise(record)["thrusters"]
    assert list(rows) == ["surge_port", "surge_starboard", "heave_bow", "heave_stern", "sway"]
    row = rows["heave_bow"]
    assert row["least"] == pytest.approx(-80.0, rel=1e-2)
    assert row["largest"] == pytest.approx(80.0, rel=1e-2)
    assert row["rms"] == pytest.approx(80.0 / np.sqrt(2.0), rel=1e-2)
    assert (row["lower"], row["upper"]) == (-95.122, 104.659)
    assert row["at_limit"] == pytest.approx(0.25, abs=0.01)
    assert rows["sway"]["at_limit"] == 0.0


def test_the_table_has_a_line_for_each(record):
    rows = [line for line in format_summary(summarise(record)).splitlines() if " N rms" in line]
    assert [row.split(":")[0].split()[-1] for row in rows] == [
        "surge_port", "surge_starboard", "heave_bow", "heave_stern", "sway"]
    assert rows[0].startswith("thrusters     surge_port: -80 to 80 N of -95.12 to 104.7 N, 56.")
    assert rows[2].endswith(" N rms, at a limit 25 % of the time")


def test_a_run_with_an_ideal_wrench_has_none():
    ideal = synthetic_record(2.0)
    assert summarise(ideal)["thrusters"] == {}
    assert "thrusters" not in format_summary(summarise(ideal))
    assert "thrusters.png" not in figures_of(ideal.scenario)


def test_the_figure_shows_force_command_and_limits(record):
    assert "thrusters.png" in figures_of(record.scenario)
    with matplotlib.rc_context(STYLE):
        figure = FIGURES["thrusters.png"](record)
    assert [axis.get_ylabel() for axis in figure.axes] == [
        "surge port\n[N]", "surge starboard\n[N]", "heave bow\n[N]", "heave stern\n[N]",
        "sway\n[N]"]
    for axis in figure.axes:
        lines = {line.get_label(): line.get_ydata() for line in axis.get_lines()}
        np.testing.assert_array_equal(lines["real"], record.signals["thruster_force"][:, 0])
        assert set(lines) >= {"real", "commanded", "limit"}
