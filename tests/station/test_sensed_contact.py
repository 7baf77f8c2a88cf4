"""Tests of `station.contact.sensed_contact`."""

from dataclasses import replace

import numpy as np
import pytest
from support.unknown_wall import close_to_the_wall

import uvms_drake as uv
from uvms_drake.certificate.certificate import from_data, to_data
from uvms_drake.certificate.run_verdict import BROKEN, verdict_of
from uvms_drake.command.run import print_outcome
from uvms_drake.control.limits import TubeRadii
from uvms_drake.station.contact.bounds import (
    largest_force,
    safe_depth_margin,
    sensed_contact,
)
from uvms_drake.station.contact.tube_in_contact import in_contact
from uvms_drake.station.problem import true_surface
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.law_tube import LawTube

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("overrides", [
    ("surface.geometry.point.0=0.01",),
    pytest.param(
        ("surface.geometry.point.0=-0.005", "surface.law.stiffness=1000.0", "surface.friction=0.4",
         "sensing.0.tare=0.2",  # It touches after 0.28 s, far nearer than declared.
         "simulator.max_step_size=0.005"), marks=pytest.mark.long),
])
def test_it_presses_with_the_desired_force_wherever_the_wall_is_and_however_stiff(overrides):
    scenario = close_to_the_wall(*overrides)
    record = uv.simulate(scenario)
    contact = sensed_contact(scenario)
    static = true_surface(scenario).static_force(record.chi)
    assert static.max() <= contact.force
    assert np.all(record.mpc_status == 0.0)
    assert record.mpc_violation.max() <= 1e-6
    assert record.mpc_terminal_slack.max() <= 1e-6
    last = record.time >= 5.0
    assert np.abs(record.force[last, :3] @ contact.direction - 20.0).max() < 1.5
    depth = record.chi[:, 0]
    assert np.all(depth <= record.signals["safe_depth"][:, 0] + 2.0 * safe_depth_margin(scenario))
    assert set(uv.summarise(record)["contact"]["out_of_class"]) <= {"clearance"}  # It is near here.


def test_nothing_is_promised_of_a_wall_that_is_not_of_the_class(capsys, tmp_path):
    record = uv.simulate(close_to_the_wall(
        "surface.law.stiffness=4000.0", "duration=2.5", "supervisor=null"))
    summary = uv.summarise(replace(record, certified=True))
    seen = summary["contact"]["out_of_class"]["stiffness"]
    assert seen == {"specified": 1000.0, "observed": pytest.approx(4000.0, rel=0.05)}
    summary["constraints"] = {}
    summary["verdict"] = verdict_of(summary)
    assert print_outcome(summary, tmp_path, []) == BROKEN
    assert "NO GUARANTEE for this wall" in capsys.readouterr().out.splitlines()[-1]


@pytest.mark.parametrize("overrides", [
    ["sensing.0.tare=0.9"],
    ["sensing.0.noise=[0, 0, 0, 0, 0, 0]", "sensing.0.drift=[0, 0, 0, 0, 0, 0]"],
    ["sensing.0.rate=20"]])
def test_a_sensor_that_is_slow_or_silent_or_tares_for_long_is_trusted(overrides):
    """Off the wall: of such sensors, readings that repeat are no sign that they froze."""
    record = uv.simulate(uv.load_scenario("girona500_contact", ["duration=1.2", *overrides]))
    assert record.signals["force_lost"].max() == 0.0


def test_a_force_that_is_asked_for_while_it_runs_is_accepted_as_far_as_the_class_allows():
    scenario = close_to_the_wall()
    contact = sensed_contact(scenario)
    most = largest_force(scenario)
    assert 20.0 < most < contact.force
    station = uv.make_station(scenario)
    context = station.CreateDefaultContext()
    for asked, accepted in ((12.0, 12.0), (100.0, most), (-3.0, 0.0)):
        station.GetInputPort("desired_force").FixValue(context, contact.wrench(asked))
        found = station.GetOutputPort("desired_force").Eval(context)
        assert found == pytest.approx(contact.wrench(accepted))


def test_a_place_that_is_said_while_it_runs_is_where_it_presses():
    station = uv.make_station(close_to_the_wall())
    context = station.CreateDefaultContext()
    target = station.GetOutputPort("target").Eval(context)
    place = [9.0, target[1] + 0.02, target[2] - 0.01]
    station.GetInputPort("place").FixValue(context, place)
    assert station.GetOutputPort("target").Eval(context) == pytest.approx([target[0], *place[1:]])


def test_the_controller_is_told_nothing_of_the_surface():
    """Its model is the same for any surface of the world."""
    models = [uv.load_model(uv.load_scenario("girona500_contact", [f"surface.law.stiffness={k}"]))
              for k in (100.0, 900.0)]
    assert repr(models[0].surface) == repr(models[1].surface)
    assert not models[0].surface.force(np.ones(6), np.ones(6)).any()


QUICK = ["certificate.constant_samples=200", "certificate.tube_samples=40",
         "certificate.terminal_samples=200"]


@pytest.mark.long
def test_it_is_certified_for_every_wall_of_the_class(few_searches):
    """The budget's parts add up to the radii, and the force is bounded by what was explored."""
    certificate = uv.certify(uv.load_scenario("girona500_contact", QUICK))
    assert certificate.certified, certificate.failed
    tube = certificate.tube
    for name, parts in certificate.budget.items():
        assert sum(parts.values()) == pytest.approx(getattr(tube, name))
    assert tube.depth < tube.position < 0.0021
    assert {"contact_speed_n", "tool_angle"} < {
        item.name.removeprefix("tube in limits.") for item in certificate.conditions}
    again = from_data(to_data(certificate))
    assert again.budget == certificate.budget


@pytest.mark.parametrize(("override", "broken"), [
    ("contact.force_error=3.0", "contact.force_error"),
    ("sensing.0.range=[60, 60, 60, 40, 40, 30]", "sensing, largest force within the range"),
    pytest.param("contact.clearance=0.04", "contact.clearance", marks=pytest.mark.long),
    pytest.param("contact.stiffness=8000.0", "safe region, margin", marks=pytest.mark.long),
    pytest.param("contact.speed=0.02", "contact.speed, excess between", marks=pytest.mark.long),
    ("faults=[!LostForce {start: 1.0, duration: 1.0}]", "faults"),
])
def test_what_voids_the_certificate_is_named(few_searches, override, broken):
    certificate = uv.certify(uv.load_scenario("girona500_contact", [*QUICK, override]))
    assert certificate.failed.name.startswith(broken), certificate.failed


def test_in_a_gap_of_the_sensor_nothing_is_taken_for_safe():
    """The tip goes on within what was felt before; the front waits."""
    scenario = close_to_the_wall(
        "duration=1.4", "faults=[!LostForce {start: 0.8, duration: 0.6}]")
    record = uv.simulate(scenario)
    safe, y = record.signals["safe_depth"][:, 0], record.chi[:, 1:3]
    gap = (record.time > 0.83) & (record.time < 1.39)
    slope = sensed_contact(scenario).walls.tilt
    aside = np.sum(np.abs(y[gap] - y[gap][0]), axis=1)
    assert np.ptp(safe[gap]) <= 1.2 * slope * np.max(aside)
    assert safe[record.time < 0.8][-1] > safe[0]


def test_a_law_without_a_tube_has_none_in_contact():
    none = LawTube(TubeRadii(), (Condition("why", 1.0, "<=", 0.0, theorem="t"),))
    scenario = uv.load_scenario("girona500_tip_first")
    assert in_contact(none, scenario, None) is none
