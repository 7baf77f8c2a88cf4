"""Tests of `station.contact.mission_legs`: what is certified of the steps of a mission."""

from dataclasses import replace

import numpy as np
import pytest

from uvms_drake.control.limits import TubeRadii
from uvms_drake.mission.steps import Approach, Hold, Mission, Retreat, Slide
from uvms_drake.model.surface.law import TipErrors
from uvms_drake.model.surface.unknown_contact import UnknownContact
from uvms_drake.station.contact.mission_legs import legs_of
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.ultimate_bounds import tip_errors

CONTACT = UnknownContact(angle=0.15, stiffness=900.0, force_error=1.2, dissipation=0.8, delay=0.1)
TUBE = TubeRadii(e=0.01, z=0.1, position=0.002, depth=0.0012, orientation=0.01, joints=0.01,
                 nu1=0.01, nu2=0.01, qdot=0.1, tip_speed=0.03, depth_speed=0.02, roll=0.01,
                 pitch=0.01, u=np.full(10, 0.1))


def worst_of(rng, force, speed, short):
    """Returns the largest |F(t) − F| of drawn walls of the class and histories in the tube.

    Of each wall of slope κ along n and α across it, and whatever was learned of it: a reading of a
    time up to W ago, in error and with the damping of then; the target by it; the tip as far off
    its plan as it may be, at the reading and now.
    """
    n = 200_000
    kappa, learned = rng.uniform(0.0, CONTACT.stiffness, (2, n))
    alpha = CONTACT.walls.tilt
    kappa, learned = (np.where(rng.uniform(size=n) < 0.3, end, each) for end, each in (
        (CONTACT.stiffness, kappa), (0.0, learned)))
    ends = rng.choice([-1.0, 0.3, 1.0], (7, n))
    # On a slide plan and wall go apart by the difference of two inclinations, either way.
    rate = TUBE.depth_speed + alpha * (TUBE.tip_speed + 2.0 * speed)
    # Along n of a normal force 1: by tilt and by friction of any direction, then and now.
    beta, friction = CONTACT.angle * rng.choice([0.5, 1.0], n), CONTACT.friction
    then, now_along = np.cos(beta) + friction * np.sin(beta) * rng.choice([-1.0, 1.0], (2, n))
    size = TUBE.depth + alpha * TUBE.position
    off, later = size * ends[0], size * ends[6]
    most = 2.0 * size + 2.0 * alpha * speed * CONTACT.delay
    way = np.clip(later - off + rate * CONTACT.delay * ends[3], -most, most)
    # F̂ − F = κ̂(ε − ℓ); F(t) = φ(1 + cδ̇), and the reading is φ'(1 + cδ̇') + its error.
    read = force + learned * (off - short * ends[5])
    before = (read + CONTACT.force_error * ends[1]) / (
        then * (1.0 + CONTACT.dissipation * rate * ends[2]))
    static = np.maximum(before + kappa * way, 0.0)
    now = now_along * static * (1.0 + CONTACT.dissipation * rate * ends[4])
    return float(np.max(np.abs(now - force)))


@pytest.mark.parametrize("speed", [0.0, 0.04])
@pytest.mark.parametrize("short", [0.0, 0.002])
@pytest.mark.parametrize("delay", [0.0, 0.01, 0.11])
def test_no_wall_of_the_class_gives_more_and_some_nearly_as_much(speed, short, delay, monkeypatch):
    """With a short delay it is a small estimate of the stiffness that is worst."""
    monkeypatch.setitem(globals(), "CONTACT", replace(CONTACT, delay=delay))
    bound = CONTACT.band(10.0, tip_errors(TUBE), speed, short)
    worst = worst_of(np.random.default_rng(1), 10.0, speed, short)
    assert 0.85 * bound < worst <= bound * (1.0 + 1e-12)


def test_what_is_left_of_it_when_all_but_one_is_exact():
    off = tip_errors(TUBE)
    none = replace(CONTACT, force_error=1e-12, dissipation=0.0, angle=0.0,
                   friction=0.0)
    assert replace(none, delay=0.0).band(10.0, off, 0.02) == pytest.approx(1800.0 * 0.0012)
    assert replace(none, delay=9.0).band(10.0, off, 0.02) == pytest.approx(2700.0 * 0.0012)
    still = TipErrors(0.0, 0.0, 0.0, 0.0, 0.0)
    assert replace(CONTACT, angle=0.0).band(10.0, still, 0.02) == pytest.approx(1.2)
    assert replace(CONTACT, dissipation=50.0).band(10.0, off) == np.inf


def test_every_step_has_its_leg_and_the_one_that_is_void_says_so():
    mission = Mission(steps=[
        Approach(settle=0.5), Hold(seconds=4.0), Slide(along=np.array([0.3, -0.4]), speed=0.05),
        Retreat(timeout=20.0)]).checked()
    name = "mission.steps[2], tangential speed of a plan [m/s]"
    legs = legs_of(mission, CONTACT, TUBE, [
        Condition("mission.steps[1], largest force in the safe region [N]", 10.0, "<", 15.0,
                  theorem="t", about="mission.steps[1]"),
        Condition(name, 0.05, "<=", 0.04, theorem="t", about="mission.steps[2]")])
    assert [leg.kind for leg in legs] == ["Approach", "Hold", "Slide", "Retreat"]
    assert [(leg.least, leg.most) for leg in legs] == [
        (0.5, 60.0), (4.0, 60.0), (10.0, 60.0), (0.0, 20.0)]
    assert [leg.band is None for leg in legs] == [True, False, True, True]
    assert [leg.unmet != "" for leg in legs] == [False, False, True, False]
    assert legs[2].unmet.startswith(name)
