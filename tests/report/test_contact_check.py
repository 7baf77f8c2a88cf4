"""Tests of `uvms_drake.report.contact_check`: bands of the force, walls outside of their class."""

from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import synthetic_sensed_record

from uvms_drake.control.limits.radii import HoldRadii
from uvms_drake.model.surface.unknown_contact import HoldForces, UnknownContact
from uvms_drake.report.contact_check import departures, force_bands, has_stood, summarise_bands
from uvms_drake.report.summary import broken, format_summary, summarise
from uvms_drake.tube.ultimate_bounds import hold_band, tip_errors

HOLD = HoldRadii(time=0.5, depth=3e-4, position=4e-4, advance=0.01, standing=0.0025, reading=1.5,
                 age=0.03)
STANDS = 2.0  # s, from when on the plan does


@pytest.fixture(scope="module")
def record():
    """A plan that stands from 2 s on, in contact from 1 s on, 1 mm short by 800 N/m."""
    base = synthetic_sensed_record(4.0)
    time, nominal = base.time, base.nominal_state.copy()
    nominal[:, 10:] = np.where(time[:, None] < STANDS, 0.05, 0.0)
    nominal[:, 10] += np.where(np.isclose(time, 3.0), 0.05, 0.0)  # It moves once more.
    force = np.zeros((len(time), 6))
    force[:, 0] = 20.0 + np.where(time < STANDS, 6.0, 0.4)
    target = base.chi_nominal[:, :3] + [0.001, 0.0, 0.0]
    return replace(
        base, nominal_state=nominal, force=force, certified=np.array(True),
        scenario=replace(base.scenario, tube=replace(base.scenario.tube, hold=HOLD)),
        signals=base.signals | {"target": target, "touched": (time >= 1.0)[:, None].astype(float),
                                  "stiffness_used": np.full((len(time), 1), 800.0)})


def test_a_plan_has_stood_once_all_of_its_speeds_were_small_for_the_time(record):
    stood, time = has_stood(record), record.time
    expected = ((time > STANDS + 0.49) & (time < 2.99)) | (time > 3.49)
    assert np.count_nonzero(stood != expected) <= 2
    without = replace(record, scenario=replace(
        record.scenario, tube=replace(record.scenario.tube, hold=None)))
    assert not np.any(has_stood(without))


def test_each_instant_in_contact_has_its_band(record):
    found, contact = force_bands(record), record.scenario.contact
    assert np.all(np.isnan(found.bound[record.time < 0.99]))
    assert found.bound[found.holds] == pytest.approx(hold_band(contact, 20.0, HOLD, 0.0008))
    moving = (record.time >= 1.0) & ~found.holds
    assert found.bound[moving] == pytest.approx(
        contact.band(20.0, tip_errors(record.scenario.tube), 0.0, 0.0008))
    assert found.error[found.holds] == pytest.approx(0.4)


def test_the_summary_has_both_phases_and_a_band_that_is_left_breaks_the_guarantee(record):
    bands = summarise_bands(record)["force_bands"]
    least = hold_band(record.scenario.contact, 20.0, HOLD, 0.0008)
    assert bands["hold"]["worst_ratio"] == pytest.approx(0.4 / least)
    assert bands["motion"]["worst_error"] == pytest.approx(6.0)
    assert bands["hold"]["exits"] == bands["motion"]["exits"] == 0
    (line,) = (line for line in format_summary(summarise(record)).splitlines()
               if " in a hold (" in line)
    assert f"which is {least:.3g} N at least" in line
    outside = record.force.copy()
    outside[-1, 0] = 20.0 + 1.01 * least
    left = summarise(replace(record, force=outside))
    assert left["contact"]["force_bands"]["hold"]["exits"] == 1
    assert "the force band in a hold" in broken(left)


def test_a_run_without_a_certificate_has_no_bands(record):
    assert summarise_bands(replace(record, certified=np.array(False))) == {}


# The class of the wall.

SPECIFIED = UnknownContact(direction=np.array([1.0, 0.0, 0.0]), stiffness=1000.0, angle=0.1,
                     dissipation=1.0, friction=0.4, force_rate=40.0, force_ripple=2.0,
                     clearance=0.05)
TIME = np.arange(0.0, 10.0, 0.02)
PLACE = 0.08


def motion(back=0.0):
    """A tip that goes in, maybe to and fro, and slides to and fro while it presses."""
    x = 0.1 * (1.0 - np.exp(-TIME)) + back * np.sin(2.0 * TIME) * (np.pi < TIME)
    tip = np.stack([x, 0.02 * np.sin(TIME), 0.01 * np.cos(TIME)], axis=1)
    return tip, np.gradient(tip, TIME, axis=0)


def observed(specified=SPECIFIED, *, kappa=1000.0, angle=0.1, mu=0.4, damping=1.0, place=PLACE,
             pull=0.0, back=0.0, hidden=None, stood=None):
    """Departures of a plane at an angle, with friction against the motion of the tip."""
    into = np.array([np.cos(angle), np.sin(angle), 0.0])
    tip, v = motion(back)

    def static(places):
        return kappa * np.maximum((places - place * np.eye(3)[0]) @ into, 0.0)

    along = v - (v @ into)[:, None] * into
    rubbed = along / np.maximum(np.linalg.norm(along, axis=1), 0.02)[:, None]
    rate = v @ into
    hidden = damping if hidden is None else hidden  # Of a tip that goes back.
    normal = static(tip) * np.maximum(1.0 + np.where(rate > 0.0, damping, hidden) * rate, 0.0)
    force = normal[:, None] * (into + mu * rubbed)
    return departures(specified, TIME, tip, v, force - pull * into, static, stood)


def test_a_wall_at_all_bounds_of_its_class_is_of_it():
    assert observed() == {}


@pytest.mark.parametrize(("key", "changed"), [
    ("stiffness", {"kappa": 1100.0}), ("angle and friction", {"mu": 0.6}),
    ("angle and friction", {"angle": 0.3}), ("clearance", {"place": 0.03}),
    ("dissipation", {"damping": 4.0, "mu": 0.4}), ("angle and friction", {"pull": 30.0})])
def test_what_is_not_of_the_class_is_named(key, changed):
    found = observed(replace(SPECIFIED, force_rate=1e6), **changed)
    assert key in found
    if key == "stiffness":
        assert found == {"stiffness": (1000.0, pytest.approx(1100.0, rel=0.05))}
    if key == "clearance":
        assert found[key].observed == pytest.approx(0.03, abs=1e-3)


def test_friction_that_is_too_fast_for_a_hold_is_named_where_the_plan_stands():
    slow = replace(SPECIFIED, hold=HoldForces(force_rate=0.5, force_ripple=0.01))
    never, always = np.zeros(len(TIME), dtype=bool), np.ones(len(TIME), dtype=bool)
    assert observed(slow) == observed(slow, stood=never) == {}
    assert set(observed(slow, stood=always)) == {"hold.force_ripple"}
    assert observed(SPECIFIED, stood=always) == {}


def test_damping_that_hides_the_force_from_a_tip_that_goes_back_is_named():
    specified = replace(SPECIFIED, friction=0.0, force_rate=1e6)
    assert observed(specified, mu=0.0, back=0.005) == {}
    assert observed(specified, mu=0.0, back=0.005, hidden=5.0)["dissipation"].observed > 4.0


def test_a_force_that_turns_faster_than_told_is_named():
    assert set(observed(replace(SPECIFIED, force_rate=1.0, force_ripple=0.5))) == {"force_ripple"}
