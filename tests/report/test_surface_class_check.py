"""Tests of `uvms_drake.report.surface_class_check`: walls outside of their class."""

from dataclasses import replace

import numpy as np
import pytest

from uvms_drake.model.surface.unknown_contact import HoldForces, UnknownContact
from uvms_drake.report.surface_class_check import departures

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
