"""Arrival of the nominal closed loop at an unknown wall, within the duration or not."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.unknown_wall import close_to_the_wall

import uvms_drake as uv
from uvms_drake.certificate.arrival import Arrival, arrival_of, arrives
from uvms_drake.certificate.certificate import fingerprint
from uvms_drake.control.limits.radii import HoldRadii
from uvms_drake.station.contact.bounds import sensed_contact

MAIN = "girona500_contact"
NEAR = ("surface.geometry.point.0=0.01", "contact.clearance=0.02")
STANDS = HoldRadii(time=1.0)


def arrival(scenario):
    start = np.concatenate([scenario.start.config, np.zeros(10)])
    return arrival_of(scenario, uv.load_model(scenario), start)


def test_a_tip_that_creeps_is_not_there_in_time_and_the_duration_that_would_do_is_named():
    """The tube takes 71 of 80 mm/s, and leaves 9 to the plan: the wall is 25 mm off."""
    scenario = close_to_the_wall("duration=2.0", "contact.speed=0.08", *NEAR)
    found = arrival(scenario)
    assert found.speed == pytest.approx(0.009, abs=1e-3)
    assert found.touch > 2.0
    late = arrives(scenario, found)
    assert not late.holds
    key, value = late.advice.removeprefix("--set ").split("=")
    assert (key, float(value)) == ("duration", math.ceil(found.target))
    assert arrives(replace(scenario, duration=float(value)), found).holds
    # It has to be there, too, before the steps of a mission take their time.
    inspection = uv.load_scenario("girona500_inspection")
    rest = sum(step.least_time for step in inspection.mission.steps[1:])
    for touch, holds in ((inspection.duration - rest - 1.0, True),
                         (inspection.duration - rest + 1.0, False)):
        assert arrives(inspection, Arrival(0.1, touch, touch, math.inf)).holds == holds
    assert arrives(scenario, Arrival(0.1, math.inf, math.inf, math.inf)).advice == ""


@pytest.mark.long
def test_a_run_touches_and_is_in_a_hold_when_the_nominal_loop_is():
    scenario = close_to_the_wall("duration=7.0", *NEAR)
    scenario = replace(scenario, tube=replace(scenario.tube, hold=STANDS))
    found, record = arrival(scenario), uv.simulate(scenario, certified=True)
    touched = record.signals["touched"][:, 0] > 0.0
    assert found.touch == pytest.approx(record.time[np.argmax(touched)], abs=0.2)
    assert found.touch < found.target < found.hold < scenario.duration
    assert found.hold >= found.target + STANDS.time - 0.5
    n = sensed_contact(scenario).direction
    late = record.time > found.target + 1.0
    assert np.max(np.abs(record.force[late, :3] @ n - 20.0)) < 3.0
    # It depends on nothing that a certificate does not depend on.
    other = replace(
        scenario, seed=scenario.seed + 5, duration=scenario.duration + 1.0,
        **{key: getattr(uv.load_scenario(MAIN, [
            "simulator.integration_scheme=implicit_euler",
            "faults=[!LostForce {start: 0.5, duration: 1.0}]"]), key)
           for key in ("simulator", "faults")})
    assert arrival(other) == found
    # Nothing moves before the end of the hover.
    late = arrival(replace(scenario, mpc=replace(scenario.mpc, hover=6.0)))
    assert late == Arrival(found.speed, *(6.0 + each for each in (
        found.touch, found.target, found.hold)))
    assert not arrives(scenario, late).holds


def test_the_hover_is_an_input_of_the_certificate_of_a_declared_wall():
    """It is a part of the time within which the task is to be reached."""
    for name, counts in ((MAIN, True), ("girona500_ideal", False)):
        first, other = (fingerprint(uv.load_scenario(name, [f"mpc.hover={hover}"]))
                        for hover in (0.0, 29.0))
        assert (first != other) == counts
