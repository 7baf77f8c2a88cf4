"""Tests of `uvms_drake.errata.choices`: what the figures show is what the errata say."""

import numpy as np
import pytest

from uvms_drake.errata.choices import CHOICES, draw_choice, draw_choices, option_name
from uvms_drake.station.scenario import dump_scenario, load_scenario
from uvms_drake.station.simulation import simulate


def both(name: str, *overrides: str):
    choice = CHOICES[name]
    return choice, [simulate(load_scenario(
        choice.scenario, [f"{choice.key}={option}", *overrides])) for option in choice.options]


def test_a_plan_from_the_measured_state_loses_the_tube():
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


def test_the_paper_s_law_leaves_the_joints_to_themselves():
    """E5: `resolved` keeps q at its nominal value exactly, `transpose` does not."""
    _, (resolved, transpose) = both("law.png")
    drift = [np.max(np.abs((record.config - record.nominal_config)[:, 6:]))
             for record in (resolved, transpose)]
    assert drift[0] < 1e-6
    assert drift[1] > 0.2


def test_a_cost_about_zero_input_ends_beside_the_task():
    """E6: with the equilibrium's input, the scenario's own, `test_paper` has it within 0.01."""
    choice = CHOICES["input_reference.png"]
    assert choice.scenario == "paper_dynamic_resolved"
    own, zero = (load_scenario(choice.scenario, [f"{choice.key}={option}"])
                 for option in choice.options)
    assert dump_scenario(own) == dump_scenario(load_scenario(choice.scenario))
    record = simulate(zero)
    assert np.linalg.norm(record.chi[-1] - record.chi_des) > 0.3


def test_the_figures_are_drawn(tmp_path):
    paths = draw_choices(tmp_path, overrides=["duration=0.6"])
    assert [path.name for path in paths] == list(CHOICES)
    assert all(path.stat().st_size > 10_000 for path in paths)


@pytest.mark.parametrize("name", CHOICES)
def test_both_options_are_in_the_legend(name):
    choice, records = both(name, "duration=0.6")
    figure = draw_choice(choice, records)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        option_name(option) for option in choice.options]
    assert all(axis.get_ylabel() for axis in figure.axes)
