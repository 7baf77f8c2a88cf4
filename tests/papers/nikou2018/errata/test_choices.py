"""Tests of `papers.nikou2018.errata.choices`: the figures show the statements of the errata."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from uvms_drake.papers.nikou2018.errata import choices
from uvms_drake.papers.nikou2018.errata.choices import (
    CHOICES,
    draw_choice,
    draw_choices,
    option_name,
)
from uvms_drake.station.problem import make_ocp
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario, load_scenario
from uvms_drake.station.simulation import simulate

pytestmark = pytest.mark.long


@pytest.fixture(scope="module", autouse=True)
def once() -> Iterator[Callable[[Scenario], Record]]:
    """Simulates a scenario that several tests look at once."""
    known: dict[str, Record] = {}

    def simulated(scenario: Scenario) -> Record:
        text = dump_scenario(scenario)
        if text not in known:
            known[text] = simulate(scenario)
        return known[text]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(choices, "simulate", simulated)
        yield simulated


@pytest.fixture(scope="module")
def both(once):
    """Simulates both options of a choice, which comes first."""
    def simulated(name: str, *overrides: str):
        choice = CHOICES[name]
        return choice, [once(load_scenario(choice.scenario, [
            f"{choice.key}={option}", *overrides])) for option in choice.options]

    return simulated


def test_a_plan_from_the_measured_state_loses_the_tube(both):
    """E9: the nominal motion jumps at every sample, and the error at the task is larger."""
    _, (nominal, measured) = both("initial_state.png")
    sample = np.isclose(np.mod(nominal.time + 1e-9, 0.1), 0.0, atol=1e-6)
    jumps = [np.max(np.linalg.norm(np.diff(record.chi_nominal, axis=0), axis=1)[sample[1:]][30:])
             for record in (nominal, measured)]
    assert jumps[1] > 2.0 * jumps[0]
    late = nominal.time > 4.5
    error = [np.max(np.linalg.norm((record.chi - record.chi_des)[late], axis=1))
             for record in (nominal, measured)]
    assert error[1] > 1.4 * error[0]


def test_the_paper_s_law_leaves_the_joints_to_themselves(both):
    """E5: `resolved` keeps q at its nominal value exactly, `transpose` does not."""
    _, (resolved, transpose) = both("law.png")
    drift = [np.max(np.abs((record.config - record.nominal_config)[:, 6:]))
             for record in (resolved, transpose)]
    assert drift[0] < 1e-6
    assert drift[1] > 0.2


def test_a_cost_about_zero_input_leaves_the_task():
    """E6: started at the task, where the scenario's own cost, about the equilibrium's, stays."""
    choice, ends = CHOICES["input_reference.png"], []
    for option in choice.options:
        scenario = load_scenario(choice.scenario, [f"{choice.key}={option}", "duration=4.2"])
        ocp = make_ocp(scenario)
        eta, q = np.split(ocp.model.configuration(ocp.y_des), [6])
        record = simulate(replace(scenario, start=replace(scenario.start, eta=eta, q=q)))
        ends.append(np.linalg.norm(record.chi[-1] - record.chi_des))
    assert ends[0] < 0.01
    assert ends[1] > 0.3


def test_the_figures_are_drawn(tmp_path):
    paths = draw_choices(tmp_path, overrides=["duration=0.6"])
    assert [path.name for path in paths] == list(CHOICES)
    assert all(path.stat().st_size > 10_000 for path in paths)


@pytest.mark.parametrize("name", CHOICES)
def test_both_options_are_in_the_legend(both, name):
    choice, records = both(name, "duration=0.6")
    figure = draw_choice(choice, records)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        option_name(option) for option in choice.options]
    assert all(axis.get_ylabel() for axis in figure.axes)
