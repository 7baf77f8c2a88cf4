"""Tests of `papers.nikou2018.errata.proof`: right by another way, correct values pass."""

import math
import re

import numpy as np
import pytest
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from support import dh, tiny_robots
from support.random_systems import integrate

from uvms_drake.model.surface.spring import BilateralSpring
from uvms_drake.papers.nikou2018.errata import proof
from uvms_drake.papers.nikou2018.errata.paper import (
    CHI_DES,
    CHI_START,
    Q_DES,
    Q_START,
    Q_START_OTHER,
    configuration,
    robot,
    robot_constants,
)
from uvms_drake.papers.nikou2018.transpose import LemmaConstants
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state

pytestmark = pytest.mark.long

SCALAR = LemmaConstants(J_min=1.44, J_max=1.2, J_dot=0.3, L_c=0.4, L_1=0.7, L_2=0.9)


def test_e1_the_plant_accelerates_by_f_plus_u_if_tau_is_m_u():
    rng = np.random.default_rng(3)
    state, u = rng.uniform(-0.2, 0.2, 20), rng.uniform(-0.2, 0.2, 10)
    uvms = make_uvms_plant("girona500_arm5e", surface=BilateralSpring(),
                           disturbance=ConstantDisturbance(bound=0.0))
    M = robot().mass_matrix(robot().kinematics(state[:10]))
    expected = robot().drift(state[:10], state[10:]) + u
    errors = []
    for tau in (M @ u, u):
        simulator = Simulator(uvms)
        context = simulator.get_mutable_context()
        set_state(uvms, context, state)
        uvms.GetInputPort("tau").FixValue(context, tau)
        uvms.GetInputPort("current").FixValue(context, np.zeros(3))
        simulator.AdvanceTo(1e-5)
        rate = (uvms.GetOutputPort("state").Eval(context)[10:] - state[10:]) / 1e-5
        errors.append(np.linalg.norm(rate - expected) / np.linalg.norm(u))
    assert errors[0] < 1e-2 < 1.0 < errors[1]


def test_e1_a_robot_whose_mass_matrix_is_the_identity_is_not_flagged(monkeypatch):
    unit = SpatialInertia(mass=1.0, p_PScm_E=np.zeros(3), G_SP_E=UnitInertia(1.0, 1.0, 1.0))
    monkeypatch.setattr(tiny_robots, "INERTIA", unit)
    model = tiny_robots.tiny_robot([], [], (0.3, 0.0, 0.0))
    np.testing.assert_allclose(model.mass_matrix(model.kinematics(np.zeros(6))), np.eye(6))
    assert not proof.acceleration_input(model).wrong


def test_e2_the_printed_law_type_checks_without_an_arm_only():
    with pytest.raises(ValueError, match="mismatch"):
        np.ones((10, 6)) @ np.ones(10)
    assert "10×6 times 10" in proof.law_shapes(4).computed
    assert [proof.law_shapes(n).wrong for n in (0, 1, 4, 7)] == [False, True, True, True]


def test_e13_the_terminal_controller_type_checks_when_both_are_mended():
    for n in (0, 4):
        assert proof.terminal_shapes(n).wrong
        assert proof.terminal_shapes(n, gain_columns=12 + n).wrong
        assert proof.terminal_shapes(n, quadratic=True).wrong
        assert not proof.terminal_shapes(n, gain_columns=12 + n, quadratic=True).wrong


def test_e3_a_scalar_system_needs_what_is_derived_by_hand():
    """𝔢J𝔯 and −σ²𝔯J³𝔢 cannot both be largest; all other terms of the corrected Λ₁ are attained."""
    sigma, J = 2.0, np.array([[1.2]])
    needed = proof.needed_lambda(SCALAR, J, sigma)
    by_hand = 0.9 * (1.0 + 2.4) + 2.0 * (0.4 * 1.2 + 0.3) + abs(1.2 - 4.0 * 1.2**3)
    assert by_hand * (1.0 - 1e-4) < needed <= by_hand  # As ‖𝔯‖/‖𝔢‖ → ∞.
    assert needed < proof.quadratic_form(SCALAR, sigma).corrected
    assert proof.lost_terms(SCALAR, J, sigma).wrong
    assert not proof.lost_terms(SCALAR, J, sigma, claimed=by_hand * (1.0 + 1e-9)).wrong


def test_e3_the_robots_states_need_nearly_the_corrected_lambda():
    constants, J = robot_constants()
    assert constants.J_max == pytest.approx(np.linalg.norm(J, 2))
    sigma = 2.0 * constants.L_c / constants.J_min
    form = proof.quadratic_form(constants, sigma)
    needed = proof.needed_lambda(constants, J, sigma)
    assert 2.0 * form.Lambda_1 < needed <= form.corrected
    assert needed > 0.98 * form.corrected
    assert not proof.lost_terms(constants, J, sigma, claimed=form.corrected).wrong


def test_e4_the_attained_velocity_is_the_largest_of_the_ball():
    J = robot_constants()[1]
    for sigma in (0.05, 1.0, 5.0):
        attained = proof.attained_velocity(J, sigma)
        # ‖[−σJᵀ I]‖ is the largest ‖𝔷‖ over the ball.
        largest = np.linalg.norm(np.hstack([-sigma * J.T, np.eye(10)]), 2)
        assert attained == pytest.approx(largest, rel=1e-12)
        assert attained == pytest.approx(math.hypot(1.0, sigma * np.linalg.norm(J, 2)), rel=1e-12)
    assert proof.velocity_tube(J, 1.0).wrong
    assert not proof.velocity_tube(J / 10.0, 0.1).wrong  # 2/J̄ is large enough there.


def test_e5_the_end_effector_is_at_one_pose_by_the_papers_table():
    config = configuration(CHI_START, np.array([Q_START, Q_START_OTHER]))
    for item in config:
        np.testing.assert_allclose(dh.chi(item), CHI_START, atol=1e-9)
    assert not proof.self_motion(Q_START, Q_START).wrong


def test_e12_the_corner_moves_as_an_integration_says():
    s, k, sigma, z = 2.2, 158.0, 1.0, 2.4
    rate, peak = proof.corner_motion(s, k, sigma, z)
    assert rate == pytest.approx(s * z)
    states = [x[0] for _, x in integrate(
        lambda t, x: np.array([s * x[1], -k * (x[1] + sigma * s * x[0])]), np.array([1.0, z]),
        0.2, 1e-4)]
    assert peak == pytest.approx(max(states), rel=1e-6)
    assert peak > 1.0


def test_e12_the_ball_is_kept_and_a_product_without_a_corner_too():
    J = robot_constants()[1]
    rng = np.random.default_rng(0)
    k, sigma = 158.0, 1.0
    rate = proof.ball_rate(J, k, sigma)
    assert rate < 0.0
    for _ in range(200):
        e, r = rng.normal(size=6), rng.normal(size=10) * rng.choice([0.1, 1.0, 10.0])
        z = r - sigma * J.T @ e
        e_dot = J @ z
        growth = e @ e_dot + r @ (-k * r + sigma * J.T @ e_dot)
        assert growth <= rate * (e @ e + r @ r) + 1e-9
    assert proof.invariant_sets(J).wrong
    assert not proof.invariant_sets(J, z_radius=0.0).wrong


def test_e14_a_regular_configuration_is_not_flagged():
    assert proof.configuration_set().wrong
    assert not proof.configuration_set(configuration(CHI_DES, Q_DES)).wrong
    # T(𝔬) is about 1/cos(pitch): √2/0.01 there, since roll and yaw both turn.
    steep = float(re.search(r"‖J‖ = ([\d.]+)", proof.configuration_set().computed)[1])
    assert steep == pytest.approx(math.sqrt(2.0) / 0.01, rel=0.05)
