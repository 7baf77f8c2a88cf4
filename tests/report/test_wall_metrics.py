"""Tests of `uvms_drake.report.metrics.wall_metrics`: synthetic runs and their metrics."""

from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import synthetic_record

from uvms_drake.campaign.run import outcome
from uvms_drake.model.surface import ShapedSurface
from uvms_drake.model.surface.contact_laws import Linear
from uvms_drake.model.surface.geometry import Plane
from uvms_drake.report.metrics import wall_metrics
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.tube.contact.sensor_error import ripple

STIFFNESS, TILT = 500.0, 0.05
LARGEST = 45.0
"""contact.force of the scenario [N]."""


def pressing(*stretches, stiffness=STIFFNESS, tilt=TILT):
    """A record of 20 s in which the tip is that deep in a plane from each of the times on."""
    scenario = load_scenario("girona500_contact", ["duration=20", "log_period=0.02"])
    into = np.array([np.cos(tilt), 0.0, np.sin(tilt)])
    wall = ShapedSurface(Plane(np.zeros(3), -into), Linear(stiffness, 0.001), 0.0, 0.0)
    scenario = replace(scenario, surface=wall, task=replace(scenario.task, pose=np.zeros(6)))
    begins, depths = map(np.array, zip((0.0, -0.1), *stretches, strict=True))
    depth = depths[np.searchsorted(begins, np.arange(1001) * 0.02 + 1e-9) - 1]
    chi = np.zeros((1001, 6))
    chi[:, :3] = depth[:, None] * into
    chi[0, :3] = [-0.2, 0.0, 0.0]
    force = np.zeros((1001, 6))
    force[:, :3] = stiffness * np.maximum(depth - 0.0005, 0.0)[:, None] * into
    return synthetic_record(scenario=scenario, chi=chi, force=force,
                            desired_force=np.tile(scenario.task.force, (1001, 1)),
                            penetration=np.maximum(depth, 0.0))


def deep(force, stiffness=STIFFNESS):
    """Depth at which the wall gives a force along its normal."""
    return force / stiffness + 0.0005


def test_times_and_forces_are_those_of_the_run():
    record = pressing((4.0, deep(10.0)), (7.0, deep(20.5)), (15.0, deep(20.2)))
    wall = wall_metrics(record)
    assert wall["static"] == pytest.approx(20.5 / LARGEST)
    fastest = 0.13 + np.tan(0.0873) * np.hypot(0.15, 0.15)  # Along and across n, in m/s.
    assert wall["peak"] == pytest.approx(20.5 / (LARGEST * (1.0 + 1.0 * fastest)))
    assert wall["first_touch_s"] == pytest.approx(4.0)
    assert wall["settled_s"] == pytest.approx(3.0)
    assert wall["error"] == pytest.approx(abs(20.2 * np.cos(TILT) - 20.0))
    assert wall["losses"] == 0 and wall["in_class"]
    assert wall["angle"] == pytest.approx(TILT)
    assert wall["stiffness"] == pytest.approx(STIFFNESS)
    # A campaign judges the run by them, not by the tilted wall's force across n.
    result = outcome(record)
    assert result["force_error"] == wall["final_error"]
    assert result["settling_time_s"] == pytest.approx(7.0)


def test_a_wall_that_is_left_is_told():
    wall = wall_metrics(pressing((3.0, deep(5.0)), (4.0, -0.01), (5.0, deep(20.0)), (8.0, -0.01),
                                 (9.0, deep(20.0)), (19.0, -0.01)))
    assert wall["losses"] == 2
    assert wall["settled_s"] is None
    never = wall_metrics(pressing((1.0, -0.1)))
    assert never["first_touch_s"] is never["settled_s"] is None
    assert never["static"] == never["losses"] == 0


@pytest.mark.parametrize("settings", [{"stiffness": 1100.0}, {"tilt": 0.1}, {"stiffness": 50.0}])
def test_a_wall_out_of_the_class_or_not_shown_to_be_of_it_is_told(settings):
    """Too stiff, too tilted, or touched outside of the proven ball, half a metre away."""
    stiffness = settings.get("stiffness", STIFFNESS)
    record = pressing((4.0, deep(20.0, stiffness)), **settings)
    if stiffness == 50.0:
        record.chi[500:, 1] += 2.0
    assert not wall_metrics(record)["in_class"]


def test_a_force_that_changes_too_fast_is_none_of_the_class():
    """A ramp of 40 N/s with a square wave of 2 N either way is; a faster one is not."""
    time = np.arange(200) * 0.02
    force = np.zeros((200, 3))
    for rate, size, slow in ((40.0, 2.0, True), (44.0, 2.0, False), (40.0, 2.6, False)):
        force[:, 1] = rate * time
        force[:, 2] = size * (-1.0) ** np.arange(200)
        assert (ripple(time, force, 41.0) <= 2.01) == slow
    sideways = pressing((4.0, deep(20.0)))
    sideways.force[500:, 1] += 5.0
    assert not wall_metrics(sideways)["in_class"]


def test_a_wall_that_is_pressed_too_hard_stays_in_the_class():
    """For any depth after that: membership is proven up to the largest force."""
    wall = wall_metrics(pressing((4.0, 1.0)))
    assert wall["in_class"] and wall["static"] > 10.0


def test_a_known_surface_has_none():
    assert wall_metrics(synthetic_record()) == {}
