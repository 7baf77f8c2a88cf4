"""Tests of `certificate.coupled.budget`: conditions of a scenario, and where there is a budget."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from uvms_drake.certificate.coupled import budget as budget_module
from uvms_drake.certificate.coupled.budget import (
    conditions_of,
    coupled_budget,
    has_coupled_budget,
)
from uvms_drake.certificate.coupled.loop_at_task import loop_parts, press_configuration
from uvms_drake.certificate.coupled.table import coupled_rows
from uvms_drake.control.feedback.disturbance_observer import prediction
from uvms_drake.control.laws.law import pair_of
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.station.command_path import command_path_of
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.tube.coupled.budget import Source
from uvms_drake.tube.coupled.coupled_loop import coupled_loop, operating_point


@pytest.mark.parametrize(("name", "has"), [
    ("girona500_real_loop", True), ("girona500_sampled", False), ("girona500_tip_first", False)])
def test_thrusters_behind_a_clock_have_a_budget(name, has):
    scenario = load_scenario(name)
    assert has_coupled_budget(
        scenario.ancillary, scenario.contact.linear_walls(scenario.task.force),
        command_path_of(scenario.actuation, load_model(scenario))) is has


@pytest.mark.slow
def test_plan_and_start_are_sources_of_both_stages(monkeypatch):
    """A dropped one is seen: of the plan what is declared, of the start what is left of it."""
    monkeypatch.setattr(budget_module, "sources_of", lambda *args, **options: ())
    monkeypatch.setattr(budget_module, "stability", lambda *args: ())
    monkeypatch.setattr(budget_module, "STABLE_AT", 2)
    scenario = load_scenario("girona500_real_loop")
    budget = coupled_budget(scenario, load_model(scenario))
    declared = scenario.certificate.plans
    for stage, plan in zip(budget.stages, (declared.approach, declared.press), strict=True):
        found = {each.name: each for each in stage.sources}
        assert set(found) == {"plan", "start"}
        np.testing.assert_array_equal(found["plan"].worst, plan.rows())
        np.testing.assert_allclose(budget.by_chance(stage), stage.worst)
        # A roll of 75 mrad that decays at 0.0485 1/s, from the end of a hover of 4 s on.
        roll = found["start"].worst[budget.rows.index("roll")]
        assert roll == pytest.approx(0.075 * np.exp(-0.0485 * 4.0), rel=0.05)
        assert 0.0 < found["start"].worst[budget.rows.index("tip y")] < 1e-3
    assert budget.planned and budget.own == ("roll", "roll rate")
    plain = replace(scenario, certificate=replace(scenario.certificate, plans=None))
    unplanned = coupled_budget(plain, load_model(plain))
    assert not unplanned.planned
    assert any(not each.holds and "count no plan" in each.name for each in conditions_of(unplanned))


def wrong_thrusters(error=0.1):
    scenario = load_scenario("girona500_real_loop", [
        f"actuation.1.error=[{error}]", "model_error.mass=1.0", "current=[0.0, 0.0, 0.0]"])
    model = load_model(scenario)
    return scenario, model, loop_parts(scenario, model)


def _free(scenario):
    return scenario.contact.linear_walls(scenario.task.force)[0]


def test_observers_have_to_find_errors_of_the_thrusters_of_any_signs():
    """δ̂ at rest, by the forces that commands of all patterns of signs exert."""
    scenario, model, parts = wrong_thrusters()
    free, config = _free(scenario), press_configuration(scenario.task, model)
    ((_, largest),) = budget_module._largest_starts(parts, config, free).items()
    at = operating_point(parts, config, free)
    _, c, G = prediction(model, parts.law.observed(model), pair_of(
        model, at.state, at.state)._replace(contact=np.zeros(6)))
    known = parts.actuation[1].known(model)
    forces, exact = Allocation.to(known).forces(at.tau[:6]), G @ at.tau + c
    by_each = G[:, :6] @ known.B
    patterns = [np.abs(exact + by_each @ (forces / (1.0 + 0.1 * np.array(signs)) - forces))
                for signs in product((1.0, -1.0), repeat=5)]
    assert np.all(largest >= np.max(patterns, axis=0) - 1e-9)
    np.testing.assert_allclose(largest, np.abs(exact) + np.sum(
        np.abs(by_each * forces), axis=1) * (1.0 / 0.9 - 1.0), atol=1e-9)
    assert np.max(largest) > np.max(np.abs(exact)) + 0.01
    plain = loop_parts(load_scenario("girona500_real_loop"), model)
    assert budget_module._other_thrusters(plain, None) == []


@pytest.mark.slow
def test_other_signs_of_the_thrusters_errors_are_a_line_of_the_budget(monkeypatch):
    """A sum that is the decay of the loop grows by that of the loop which decays most."""
    def decays(systems, *args, **options):
        return (Source("noise", np.full(26, max(system.decay[0] for system, _ in systems)),
                       np.zeros(26), random=False),)

    monkeypatch.setattr(budget_module, "sources_of", decays)
    monkeypatch.setattr(budget_module, "_largest_starts", lambda *args: {})
    monkeypatch.setattr(budget_module, "stability", lambda *args: ())
    monkeypatch.setattr(budget_module, "STABLE_AT", 2)
    scenario, model, parts = wrong_thrusters()
    budget = coupled_budget(scenario, model)
    free, config = _free(scenario), press_configuration(scenario.task, model)

    def decay(error):
        other = replace(parts, actuation=[
            parts.actuation[0], replace(parts.actuation[1], error=np.array([error]))])
        return coupled_loop(other, operating_point(other, config, free), free).system.decay[0]

    approach = budget.stages[0]
    (found,) = (each for each in approach.sources if each.name == "thrusters off by other signs")
    assert np.all(found.worst >= max(decay(-0.1) - decay(0.1), 0.0) - 1e-12)
    assert found.counted and not found.random
    assert any("thrusters off by other signs" in line for line in coupled_rows(budget))
    assert budget.decay <= decay(-0.1) + 1e-12


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
        conditions = conditions_of(budget)
        assert any(not each.holds and "tip gains" in each.name for each in conditions) is (
            k == 20.0)
        # With its own gains the budget fits its declared tube and its limits.
        assert all(each.holds for each in conditions) is (k == 12.0)
        assert 2e-3 < budget.row("depth") < budget.left["depth"] < budget.stages[1].worst[0]
        assert {each.name for each in budget.stages[0].sources} == {
            each.name for each in budget.stages[1].sources} >= {
                "plan", "start", "velocity from fix to fix", "noise of position"}
    assert 1.1 < margins[20.0] < 1.3 and margins[12.0] > 1.9
