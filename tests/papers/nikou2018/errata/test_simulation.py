"""Tests of `papers.nikou2018.errata.simulation`: right by another computation."""

import math

import numpy as np
import pytest
from support import dh

from uvms_drake.model.uvms_model import configuration_rate_matrix
from uvms_drake.papers.nikou2018.errata import simulation
from uvms_drake.papers.nikou2018.errata.paper import (
    CHI_DES,
    CHI_START,
    PITCH_LIMIT,
    Q_DES,
    Q_START,
    Q_START_OTHER,
    configuration,
    estimated_J_min,
    is_allowed,
    smallest_eigenvalue,
)

pytestmark = pytest.mark.long


def test_e8_the_printed_numbers(errata):
    text = errata[7].computed
    assert "reaches 0.49" in text  # 0.2√6
    assert "σ > 5.55" in text  # 2√2/0.5095
    assert "gives 0.0455" in text  # 0.2/(3.084·0.5095 + 2√2)
    assert "makes the tube infinite" in text
    assert 0.2 * math.sqrt(6.0) == pytest.approx(0.4899, abs=1e-4)
    assert 0.2 / (3.084 * 0.5095 + 2.0 * math.sqrt(2.0)) == pytest.approx(0.0455, abs=5e-5)


def test_e8_consistent_numbers_are_not_flagged_and_each_wrong_one_is():
    good = simulation.TubeNumbers(amplitude=0.2 / math.sqrt(6.0), w_bound=0.2, sigma=5.0,
                                  J_min=0.41, L_c=1.0, radius=0.2 / (5.0 * 0.41 - 1.0))
    assert not simulation.simulation_numbers(good).wrong
    for change in ({"amplitude": 0.2}, {"sigma": 2.0}, {"radius": 0.0656}, {"J_min": 0.5095}):
        assert simulation.simulation_numbers(good._replace(**change)).wrong


def test_e8_the_smallest_eigenvalue_by_the_papers_table():
    """No sample is below the estimate, and J there is that of finite differences of the table."""
    found = estimated_J_min()
    assert found == pytest.approx(0.411, abs=2e-3)
    rng = np.random.default_rng(5)
    edge = np.array([np.pi, PITCH_LIMIT])
    config = np.zeros((5000, 10))
    config[:, 3:5] = rng.uniform(-edge, edge, (5000, 2))
    config[:, 6:] = rng.uniform(dh.LOWER, dh.UPPER, (5000, 4))
    values = smallest_eigenvalue(config)
    assert found < np.min(values) < 0.5095
    worst = config[np.argmin(values)]
    Gamma = configuration_rate_matrix(worst)
    J = np.array([(dh.chi(worst + 1e-6 * step) - dh.chi(worst - 1e-6 * step)) / 2e-6
                  for step in Gamma.T]).T
    assert np.linalg.eigvalsh(J @ J.T)[0] == pytest.approx(np.min(values), rel=1e-5)


def test_e8_the_jacobian_grows_as_the_end_effector_points_up_or_down():
    grown = simulation.norm_at_tip_pitch(-1.56) / simulation.norm_at_tip_pitch(-1.4)
    assert grown == pytest.approx(math.cos(1.4) / math.cos(1.56), rel=0.02)


def test_e10_the_papers_poses_by_the_papers_table():
    assert dh.chi(np.zeros(10))[4] == pytest.approx(-np.pi / 2)
    level = [([-2.057, 1.017, -1.184, 0.0, 0.0, np.pi / 12], Q_START, CHI_START),
             ([-0.972, 0.0, 0.058, 0.0, 0.0, 0.0], Q_DES, CHI_DES)]
    for eta, q, chi in level:
        np.testing.assert_allclose(dh.chi(np.concatenate([eta, q])), chi, atol=1e-3)
    assert not simulation.initial_configuration(Q_START, Q_START).wrong
    assert not simulation.initial_configuration(Q_START, Q_START + [2.0, 0.0, 0.0, 0.0]).wrong


def test_e9_the_deviation_of_one_sample_is_the_jump():
    sigma, w = 3.084, 0.2
    measured, nominal = simulation.hold(True), simulation.hold(False)
    assert measured.jump == pytest.approx(w / sigma * (1.0 - math.exp(-0.1 * sigma)), rel=1e-9)
    assert nominal.jump == 0.0
    assert nominal.deviation == pytest.approx(
        w / sigma * (1.0 - math.exp(-sigma * 0.1 * simulation.HOLDING)), rel=1e-6)
    assert measured.deviation > 2.0 * w / sigma
    assert not simulation.initial_state(measured=False).wrong


def test_e11_plans_from_elsewhere_end_no_closer():
    """The smallest ε from the level vehicle is a local optimum; four random starts find it too."""
    mpc = simulation.printed_mpc(1e-3)
    found = simulation.reach(Q_START, simulation.TINY)
    assert found.violation < 1e-6
    start = configuration(CHI_START, Q_START)
    rng = np.random.default_rng(0)
    for _ in range(4):
        plan = mpc.solve(mpc.plan(start, 0.5 * rng.normal(size=(7, 10))), 40)
        end = dh.chi(plan.config[-1]) - CHI_DES
        assert math.sqrt(0.5) * np.linalg.norm(end) == pytest.approx(found.radius, rel=0.02)


def test_e11_the_other_configuration_arrives_within_the_printed_limits():
    mpc = simulation.printed_mpc(simulation.TINY)
    plan = mpc.solve(mpc.resting(configuration(CHI_START, Q_START_OTHER)), 50)
    np.testing.assert_allclose(dh.chi(plan.config[0]), CHI_START, atol=1e-9)
    assert np.linalg.norm(dh.chi(plan.config[-1]) - CHI_DES) < 1e-3
    assert len(plan.zeta) == 7
    for part in (slice(0, 3), slice(3, 6), slice(6, 10)):
        assert np.max(np.linalg.norm(plan.zeta[:, part], axis=1)) < 2.0 + 1e-6
    assert all(is_allowed(config) for config in plan.config)
    # It is farther than a point that moves at 2 m/s gets.
    assert np.linalg.norm(CHI_START[:3] - CHI_DES[:3]) > 2.0 * 0.7
    assert not simulation.first_horizon(Q_START, Q_START).wrong
    assert not simulation.first_horizon(Q_START_OTHER, Q_START_OTHER).wrong
