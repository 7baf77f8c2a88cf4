"""Tests of the page on the BlueROV2's press: stability by the filter across the normal."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from uvms_drake.certificate.coupled.loop_at_task import loop_parts, press_configuration
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import load_scenario

RESULTS = Path(__file__).parents[3] / "examples" / "results"


@pytest.fixture(scope="module")
def page():
    """The module of the page."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(RESULTS)
        import bluerov2_real_loop
        yield bluerov2_real_loop
        for name in ("bluerov2_real_loop", "make_all"):
            sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def model(page):
    return load_model(load_scenario(page.NAME))


def decays(page, model, options):
    """Returns the slowest decay at the last drawn posture without slip and with it [1/s]."""
    scenario = load_scenario(page.NAME, list(options))
    walls = scenario.contact.linear_walls(scenario.task.force)
    config = page.postures(scenario, model, press_configuration(scenario.task, model))[-1]
    parts = loop_parts(scenario, model)
    return tuple(page.slowest(page.loops_at(parts, config, of_kind)) for of_kind in (
        [wall for wall in walls if wall.slope == 0.0], [wall for wall in walls if wall.slope]))


def test_a_slipping_tip_alone_makes_the_loop_unstable_at_a_drawn_posture(page, model):
    sticking, slipping = decays(page, model, (*page.FASTER, *page.FAST_FILTER))
    assert sticking > 0.2 and slipping < 0.0


def test_a_slower_filter_across_the_normal_is_enough(page, model):
    _, slipping = decays(page, model, page.FASTER)
    assert slipping > 0.1


def test_the_scenario_is_stable_with_a_margin_of_the_delay(page, model):
    scenario = load_scenario(page.NAME)
    parts, config = loop_parts(scenario, model), press_configuration(scenario.task, model)
    later = page.delayed(parts)
    assert later[1].dead_time > 1.5 * parts.actuation[1].dead_time
    walls = scenario.contact.linear_walls(scenario.task.force)
    loops = page.loops_at(replace(parts, actuation=later), config, walls)
    assert page.slowest(loops) > 0.0
