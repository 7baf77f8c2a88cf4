"""Tests of `uvms_drake.campaign.contact_metrics`: synthetic runs and their metrics."""

from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import synthetic_record

from uvms_drake.campaign.contact_metrics import (
    PRESS_METRICS,
    contact_metrics,
    format_walls,
    press_metrics,
    summarise_walls,
)
from uvms_drake.campaign.figures import WALLS_FILE, make_campaign_figures
from uvms_drake.campaign.run import run_one
from uvms_drake.campaign.summary import (
    all_well,
    format_campaign,
    summarise_campaign,
    summarise_times,
)
from uvms_drake.model.surface import ShapedSurface
from uvms_drake.model.surface.contact_laws import Linear
from uvms_drake.model.surface.geometry import Plane
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.tube.contact.sensor_error import ripple

pytestmark = pytest.mark.long

STIFFNESS, TILT = 500.0, 0.05
LARGEST = 45.0
"""contact.force of the scenario [N]."""


def pressing(depth, *, stiffness=STIFFNESS, tilt=TILT, lateral=0.0):
    """A record of 20 s in which the tip is that deep (T,) in a plane, at rest at every sample."""
    scenario = load_scenario("girona500_contact", ["duration=20", "log_period=0.02"])
    into = np.array([np.cos(tilt), 0.0, np.sin(tilt)])
    wall = ShapedSurface(Plane(np.zeros(3), -into), Linear(stiffness, 0.001), 0.0, 0.0)
    scenario = replace(scenario, surface=wall,
                       task=replace(scenario.task, pose=[0.0, lateral, 0.0, 0.0, 0.0, 0.0]))
    chi = np.zeros((len(depth), 6))
    chi[:, :3] = depth[:, None] * into + [0.0, lateral, 0.0]
    chi[0, :3] = [-0.2, lateral, 0.0]
    force = stiffness * np.maximum(depth - 0.0005, 0.0)
    forces = np.concatenate([force[:, None] * into, np.zeros((len(depth), 3))], axis=1)
    return synthetic_record(scenario=scenario, chi=chi, force=forces,
                            desired_force=np.tile(scenario.task.force, (len(depth), 1)),
                            penetration=np.maximum(depth, 0.0))


def wall_metrics(record):
    return press_metrics(record, record.scenario.contact.declared_wall())


def depths(*stretches):
    """Depths (1001,) for 20 s: constant from each of the given times on."""
    time = np.arange(1001) * 0.02
    return np.select([time >= start - 1e-9 for start, _ in reversed(stretches)],
                     [np.full(1001, depth) for _, depth in reversed(stretches)])


def deep(force, stiffness=STIFFNESS):
    """Depth at which the wall gives a force along its normal."""
    return force / stiffness + 0.0005


def test_times_and_forces_are_those_of_the_run():
    wall = wall_metrics(pressing(depths((0.0, -0.1), (4.0, deep(10.0)), (7.0, deep(20.5)),
                                        (15.0, deep(20.2)))))
    assert wall["static"] == pytest.approx(20.5 / LARGEST)
    fastest = 0.13 + np.tan(0.0873) * np.hypot(0.15, 0.15)  # Along and across n, in m/s.
    assert wall["peak"] == pytest.approx(20.5 / (LARGEST * (1.0 + 1.0 * fastest)))
    assert wall["first_touch_s"] == pytest.approx(4.0)
    assert wall["settled_s"] == pytest.approx(3.0)
    assert wall["error"] == pytest.approx(abs(20.2 * np.cos(TILT) - 20.0))
    assert wall["losses"] == 0
    assert wall["in_class"]
    assert wall["angle"] == pytest.approx(TILT)
    assert wall["stiffness"] == pytest.approx(STIFFNESS)


def test_a_wall_that_is_left_is_told():
    wall = wall_metrics(pressing(depths(
        (0.0, -0.1), (3.0, deep(5.0)), (4.0, -0.01), (5.0, deep(20.0)),
                                   (8.0, -0.01), (9.0, deep(20.0)), (19.0, -0.01))))
    assert wall["losses"] == 2
    assert wall["settled_s"] is None
    never = wall_metrics(pressing(np.full(1001, -0.1)))
    assert never["first_touch_s"] is never["settled_s"] is None
    assert never["static"] == never["losses"] == 0


@pytest.mark.parametrize(("settings", "force"), [
    ({"stiffness": 1100.0}, 20.0), ({"tilt": 0.1}, 20.0), ({"stiffness": 50.0}, 20.0)])
def test_what_is_not_in_the_class_or_not_shown_to_be_is_told(settings, force):
    """Too stiff, too tilted, or touched outside of the proven ball, half a metre away."""
    stiffness = settings.get("stiffness", STIFFNESS)
    record = pressing(depths((0.0, -0.1), (4.0, deep(force, stiffness))), **settings)
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
    sideways = pressing(depths((0.0, -0.1), (4.0, deep(20.0))))
    sideways.force[500:, 1] += 5.0
    assert not wall_metrics(sideways)["in_class"]


def test_a_wall_that_is_pressed_too_hard_stays_in_the_class():
    """For any depth after that: membership is proven up to the largest force."""
    wall = wall_metrics(pressing(depths((0.0, -0.1), (4.0, 1.0))))
    assert wall["in_class"]
    assert wall["static"] > 10.0


@pytest.fixture
def results():
    """Metrics of three runs; the second presses too hard."""
    walls = [wall_metrics(pressing(depths((0.0, -0.1), (4.0, deep(force)))))
             for force in (20, 46, 19)]
    return [{"index": i, "mpc_failures": 0, "wall": wall} for i, wall in enumerate(walls)]


def test_the_runs_that_broke_a_promise_are_named(results):
    walls = summarise_walls(results)
    assert walls["broken"] == {"static": [1], "peak": [], "no_plan": []}
    assert walls["distributions"]["static"]["worst"] == 1
    assert walls["settled"] == 2
    assert walls["settled_soon"] == 2
    assert walls["kinds"]["shape: Plane"]["runs"] == 3
    assert "1 (runs 1) at rest" in "\n".join(format_walls(walls))
    results[0]["mpc_failures"] = 2
    results[1]["wall"]["in_class"] = False
    walls = summarise_walls(results)
    assert walls["broken"] == {"static": [], "peak": [], "no_plan": [0]}
    assert walls["not_in_class"] == [1]


def test_a_campaign_with_felt_walls_says_how_they_were_pressed(campaign, results, tmp_path):
    run = run_one(campaign, 0)
    carried = [run["result"] | each for each in results]
    times = summarise_times([run["wall"]])
    summary = summarise_campaign(campaign, carried)
    assert not all_well(summary)
    assert summary["worst"][0]["index"] == 1
    table = format_campaign(summary, times, "DIR")
    assert all(text in table for text in PRESS_METRICS.values())
    assert WALLS_FILE in {path.name for path in make_campaign_figures(summary, times, tmp_path)}
    without = summarise_campaign(campaign, [carried[0], carried[2]])
    assert all_well(without)
    known = summarise_campaign(campaign, [run["result"]])
    assert "walls" not in known
    assert not any(text in format_campaign(known, times, "DIR") for text in PRESS_METRICS.values())


def test_a_felt_contact_is_judged_by_its_kind():
    record = pressing(depths((0.0, -0.1), (4.0, deep(20.0))))
    metrics = contact_metrics(record)
    assert metrics["wall"] == wall_metrics(record)
    assert metrics["force_error"] == pytest.approx(20.0 * (1.0 - np.cos(TILT)))
    assert metrics["settling_time_s"] == pytest.approx(4.0)
