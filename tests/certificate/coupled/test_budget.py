"""Tests of `certificate.coupled.budget`: conditions of a scenario, and where there is a budget."""

import pytest

from uvms_drake.certificate.coupled.budget import (
    conditions_of,
    coupled_budget,
    has_coupled_budget,
)
from uvms_drake.station.command_path import command_path_of
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import load_scenario


@pytest.mark.parametrize(("name", "has"), [
    ("girona500_real_loop", True), ("girona500_sampled", False), ("girona500_tip_first", False)])
def test_thrusters_behind_a_clock_have_a_budget(name, has):
    scenario = load_scenario(name)
    assert has_coupled_budget(
        scenario.ancillary, scenario.contact.linear_walls(scenario.task.force),
        command_path_of(scenario.actuation, load_model(scenario))) is has


@pytest.mark.slow
@pytest.mark.long
def test_the_gains_of_the_real_loop_have_a_margin_that_twice_the_tips_have_not():
    """The former gains 20 and 10 of the tip are within 1.3 of instability."""
    margins = {}
    for k, sigma in ((12.0, 6.0), (20.0, 10.0)):
        scenario = load_scenario("girona500_real_loop", [
            f"ancillary.tip.k={k}", f"ancillary.tip.sigma={sigma}"])
        budget = coupled_budget(scenario, load_model(scenario))
        margins[k] = {each.loop: each.margin for each in budget.stability}["tip gains"]
        assert any(not each.holds and "tip gains" in each.name
                   for each in conditions_of(budget)) is (k == 20.0)
        # Noise alone is a third of the worst case, and within the limits of the roll.
        roll = budget.rows.index("roll")
        assert budget.by_chance[roll] < budget.left["roll"] < budget.worst[roll] * 5.0
    assert 1.1 < margins[20.0] < 1.3 and margins[12.0] > 1.9
