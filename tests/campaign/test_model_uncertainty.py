"""Tests of `uvms_drake.campaign.model_uncertainty`."""

from dataclasses import replace

import numpy as np
import pytest
from support.campaigns import CLOSE
from support.true_model import model_with_error

from uvms_drake.campaign.campaign import make_campaign
from uvms_drake.campaign.model_uncertainty import SHARE, as_declared
from uvms_drake.campaign.run import run_one
from uvms_drake.campaign.summary import (
    all_well,
    format_campaign,
    summarise_campaign,
    summarise_times,
)
from uvms_drake.model.surface.law import check_surface
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.simulation import simulate

pytestmark = pytest.mark.long


def test_what_an_error_of_the_model_induces_is_what_the_plant_does():
    """Held against differences of its velocity, and M⁻¹(τ − n) − M̂⁻¹(τ − n̂) by both models."""
    scenario = load_scenario("girona500_ideal", [
        "duration=0.4", CLOSE[1], "model_error.added_mass=1.2", "model_error.drag=0.8",
        "model_error.buoyancy_lever=1.1", "model_error.mass=1.02", "simulator.max_step_size=0.002",
        "log_period=0.002"])
    record = simulate(scenario)

    def acceleration(error):
        model = model_with_error(scenario.model, check_surface(scenario.surface), error)
        kinematics = model.kinematics(record.config)
        bias = model.inverse_dynamics(kinematics, record.zeta, np.zeros_like(record.zeta))
        return np.linalg.solve(
            model.mass_matrix(kinematics), (record.tau - bias)[..., None])[..., 0]

    believed = acceleration(None)
    induced = acceleration(scenario.model_error) - believed
    assert np.max(np.linalg.norm(induced, axis=1)) > 0.02
    np.testing.assert_allclose(
        record.effective_disturbance, record.disturbance + induced, atol=1e-8)
    true = np.gradient(record.zeta, record.time, axis=0)
    smooth = slice(1, 90)  # A plan ends at 0.2 s.
    np.testing.assert_allclose(
        true[smooth], (believed + record.effective_disturbance)[smooth], atol=2e-3)


def test_what_is_unknown_is_as_large_as_the_bound_covers(campaign):
    """Predicted before a run, measured in it, and large enough to matter."""
    off = replace(campaign, model_error=0.2)
    results = [run_one(off, index)["result"] for index in range(8)]
    summary = summarise_campaign(off, results)
    assert all_well(summary), summary["counts"]
    shared = [result for result in results if any(result["unknown"].values())]
    assert 2 <= len(shared) <= 6
    assert all(result["worst_disturbance"] <= 1.0 for result in shared)
    assert all(result["induced"] <= SHARE for result in shared)
    assert max(result["induced"] for result in shared) > 0.2
    assert all(result["induced"] < 1e-6 for result in results if result not in shared)
    assert "largest errors: " in format_campaign(summary, summarise_times([]), "DIR")


def test_without_a_bound_what_is_declared_is_drawn_up_to_its_size():
    """Errors of either sign and currents of any direction; exact values stay exact, all count."""
    scenario = load_scenario("girona500_real_loop", ["model_error.payload.mass=0.2"])
    drawn = [as_declared(scenario.unknowns, np.random.default_rng(seed)) for seed in range(200)]
    masses = np.array([each.error.mass for each in drawn])
    assert np.all(np.abs(masses - 1.0) <= 0.1 + 1e-12)
    assert np.min(masses) < 0.92 and np.max(masses) > 1.08
    currents = [each.current for each in drawn]
    speeds = np.linalg.norm(currents, axis=1)
    assert np.all(speeds <= 0.1 + 1e-12)
    assert 0.2 < np.mean(speeds > 0.1 - 1e-9) < 0.3 + 0.05
    assert np.all(np.abs(np.mean(currents, axis=0)) < 0.02)
    payloads = [each.error.payload.mass for each in drawn]
    assert 0.0 <= min(payloads) < 0.02 < 0.18 < max(payloads) <= 0.2
    for each in drawn:
        assert each.error.drag == each.error.added_mass == 1.0
        assert each.waves == []


def test_without_a_bound_every_run_counts():
    """There is nothing that d̃ would have to cover."""
    scenario = load_scenario("girona500_real_loop", ["duration=0.3"])
    result = run_one(make_campaign(scenario, 3, None), 0)["result"]
    assert result["error"] is None
    assert result["inside"] and result["worst_disturbance"] is None
    assert 0.0 < abs(result["unknown"]["mass"]) < 0.1
    assert 0.0 < result["unknown"]["current"] <= 0.1 + 1e-12
    counts = summarise_campaign(make_campaign(scenario, 3, None), [result])["counts"]
    assert (counts["counted"], counts["not_covered"]) == (1, 0)
