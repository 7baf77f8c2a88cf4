"""`errata`: every number is right by another computation, and right statements are not flagged."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from support import dh, tiny_robots
from support.random_systems import integrate

from uvms_drake.errata import Erratum, all_errata, errata_markdown, errata_table, lemma, simulation
from uvms_drake.errata.paper import (
    CHI_DES,
    CHI_START,
    PITCH_LIMIT,
    Q_DES,
    Q_START,
    Q_START_OTHER,
    best_posture,
    configuration,
    estimated_J_min,
    is_allowed,
    numbers,
    robot,
    robot_constants,
    smallest_eigenvalue,
)
from uvms_drake.model.surface.spring import BilateralSpring
from uvms_drake.model.uvms_model import configuration_rate_matrix
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state
from uvms_drake.tube.conditions import LemmaConstants, paper_conditions

PRINTED = re.compile(r"[-−]?\d+(?:\.\d+)?")


@pytest.fixture(scope="module")
def errata():
    return all_errata()


# The table ---------------------------------------------------------------------------------------


def test_every_erratum_is_there_and_confirmed(errata):
    assert [item.number for item in errata] == [f"E{i}" for i in range(1, 15)]
    assert all(item.wrong is True for item in errata)
    for item in errata:
        assert PRINTED.search(item.computed), item.number
        assert item.title and item.printed and item.consequence


def test_the_table_has_all_of_it(errata):
    text = errata_table(errata)
    assert text.startswith("14 of 14 errata confirmed")
    assert max(map(len, text.splitlines())) <= 100
    flat = " ".join(text.split())
    for item in errata:
        for part in (f"{item.number} {item.title}", item.printed, item.computed, item.consequence):
            assert " ".join(part.split()) in flat


def test_the_markdown_is_a_table(errata):
    odd = Erratum("E0", "t", "a, b", "|x| ≤ 1", "c", "d", wrong=False)
    lines = errata_markdown([*errata, odd]).splitlines()
    assert len(lines) == len(errata) + 3
    cells = [re.split(r"(?<!\\)\|", line) for line in lines]
    assert {len(row) for row in cells} == {8}
    assert all(row[0] == row[-1] == "" for row in cells)
    assert set(cells[1][1:-1]) == {" --- "}
    assert [row[1].strip() for row in cells[2:-1]] == [item.number for item in errata]
    assert [cell.strip() for cell in cells[-1][1:-1]] == [
        "E0", "**t** (`a`, `b`)", "\\|x\\| ≤ 1", "c", "d", "not confirmed"]


def test_a_vector_is_written_without_negative_zeros():
    assert numbers(np.array([-1e-9, -1.5, 2.0004])) == "(0, −1.5, 2)"


# Input and law -----------------------------------------------------------------------------------


def test_e1_the_plant_accelerates_by_f_plus_u_if_tau_is_m_u():
    rng = np.random.default_rng(3)
    state, u = rng.uniform(-0.2, 0.2, 20), rng.uniform(-0.2, 0.2, 10)
    uvms = make_uvms_plant(model="girona500_arm5e", surface=BilateralSpring(),
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
    assert not lemma.acceleration_input(model).wrong


def test_e2_the_printed_law_type_checks_without_an_arm_only():
    with pytest.raises(ValueError, match="mismatch"):
        np.ones((10, 6)) @ np.ones(10)
    assert "10×6 times 10" in lemma.law_shapes(4).computed
    assert [lemma.law_shapes(n).wrong for n in (0, 1, 4, 7)] == [False, True, True, True]


def test_e13_the_terminal_controller_type_checks_when_both_are_mended():
    for n in (0, 4):
        assert lemma.terminal_shapes(n).wrong
        assert lemma.terminal_shapes(n, gain_columns=12 + n).wrong
        assert lemma.terminal_shapes(n, quadratic=True).wrong
        assert not lemma.terminal_shapes(n, gain_columns=12 + n, quadratic=True).wrong


# The proof ---------------------------------------------------------------------------------------

SCALAR = LemmaConstants(J_min=1.44, J_max=1.2, J_dot=0.3, L_c=0.4, L_1=0.7, L_2=0.9)


def test_e3_a_scalar_system_needs_what_is_derived_by_hand():
    """𝔢J𝔯 and −σ²𝔯J³𝔢 cannot both be largest; all other terms of the corrected Λ₁ are attained."""
    sigma, J = 2.0, np.array([[1.2]])
    needed = lemma.needed_lambda(SCALAR, J, sigma)
    by_hand = 0.9 * (1.0 + 2.4) + 2.0 * (0.4 * 1.2 + 0.3) + abs(1.2 - 4.0 * 1.2**3)
    assert by_hand * (1.0 - 1e-4) < needed <= by_hand  # As ‖𝔯‖/‖𝔢‖ → ∞.
    assert needed < paper_conditions(SCALAR, 1.0, sigma, 0.0).corrected.Lambda_1
    assert lemma.lost_terms(SCALAR, J, sigma).wrong
    assert not lemma.lost_terms(SCALAR, J, sigma, claimed=by_hand * (1.0 + 1e-9)).wrong


def test_e3_the_robots_states_need_nearly_the_corrected_lambda():
    constants, J = robot_constants()
    assert constants.J_max == pytest.approx(np.linalg.norm(J, 2))
    sigma = 2.0 * constants.L_c / constants.J_min
    tubes = paper_conditions(constants, 1.0, sigma, 0.0)
    needed = lemma.needed_lambda(constants, J, sigma)
    assert 2.0 * tubes.printed.Lambda_1 < needed <= tubes.corrected.Lambda_1
    assert needed > 0.98 * tubes.corrected.Lambda_1
    assert not lemma.lost_terms(constants, J, sigma, claimed=tubes.corrected.Lambda_1).wrong


def test_e4_the_attained_velocity_is_the_largest_of_the_ball():
    J = robot_constants()[1]
    for sigma in (0.05, 1.0, 5.0):
        attained = lemma.attained_velocity(J, sigma)
        # ‖[−σJᵀ I]‖ is the largest ‖𝔷‖ over the ball.
        largest = np.linalg.norm(np.hstack([-sigma * J.T, np.eye(10)]), 2)
        assert attained == pytest.approx(largest, rel=1e-12)
        assert attained == pytest.approx(math.hypot(1.0, sigma * np.linalg.norm(J, 2)), rel=1e-12)
    assert lemma.velocity_tube(J, 1.0).wrong
    assert not lemma.velocity_tube(J / 10.0, 0.1).wrong  # 2/J̄ is large enough there.


def test_e5_the_end_effector_is_at_one_pose_by_the_papers_table():
    config = configuration(CHI_START, np.array([Q_START, Q_START_OTHER]))
    for item in config:
        np.testing.assert_allclose(dh.chi(item), CHI_START, atol=1e-9)
    assert not lemma.self_motion(Q_START, Q_START).wrong


def test_e12_the_corner_moves_as_an_integration_says():
    s, k, sigma, z = 2.2, 158.0, 1.0, 2.4
    rate, peak = lemma.corner_motion(s, k, sigma, z)
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
    rate = lemma.ball_rate(J, k, sigma)
    assert rate < 0.0
    for _ in range(200):
        e, r = rng.normal(size=6), rng.normal(size=10) * rng.choice([0.1, 1.0, 10.0])
        z = r - sigma * J.T @ e
        e_dot = J @ z
        growth = e @ e_dot + r @ (-k * r + sigma * J.T @ e_dot)
        assert growth <= rate * (e @ e + r @ r) + 1e-9
    assert lemma.invariant_sets(J).wrong
    assert not lemma.invariant_sets(J, z_radius=0.0).wrong


def test_e14_a_regular_configuration_is_not_flagged():
    assert lemma.configuration_set().wrong
    assert not lemma.configuration_set(configuration(CHI_DES, Q_DES)).wrong
    # T(𝔬) is about 1/cos(pitch): √2/0.01 there, since roll and yaw both turn.
    steep = float(re.search(r"‖J‖ = ([\d.]+)", lemma.configuration_set().computed)[1])
    assert steep == pytest.approx(math.sqrt(2.0) / 0.01, rel=0.05)


# The cost ----------------------------------------------------------------------------------------


def test_e6_the_loop_rests_near_the_least_stage_cost_and_the_hold_input_is_not_flagged():
    """A long horizon rests where the stage cost of a rest is least; this one is 3 s."""
    ocp, surface = simulation.spring_ocp()
    at = simulation.rest_point(ocp, surface, np.zeros(10))
    assert at.speed < 1e-4
    model, size, y = ocp.model, 10, ocp.y_des.copy()
    weight_y, weight_u = np.sqrt(np.diag(ocp.Q)[:size]), np.sqrt(np.diag(ocp.R))
    for _ in range(20):  # Gauss and Newton
        config = model.configuration(y)
        f, by_config, _ = model.drift_derivatives(config[None], np.zeros((1, size)))
        f_y = by_config[0] @ configuration_rate_matrix(config) @ np.linalg.inv(
            model.task_jacobian(config))
        A = np.concatenate([np.diag(weight_y), weight_u[:, None] * f_y])
        b = np.concatenate([weight_y * (y - ocp.y_des), weight_u * f[0]])
        y = y - np.linalg.lstsq(A, b, rcond=None)[0]
    assert at.tip == pytest.approx(np.linalg.norm((y - ocp.y_des)[:3]), rel=0.25)
    K = model.surface.stiffness
    assert at.force == pytest.approx(np.linalg.norm((K @ (y - ocp.y_des)[:6])[:3]), rel=0.25)
    assert not simulation.hold_input(fraction=1.0).wrong


def test_e7_gains_exist_from_an_eigenvalue_of_one_on():
    c = np.linspace(0.0, 5.0, 50_001)[1:]
    for J_min in (0.2, 0.5095, 0.99, 1.01, 1.3, 2.0):
        fits = c[c >= 0.5 + 0.5 * c**2 / J_min]
        gains = simulation.decrease_gains(J_min)
        assert (gains is None) == (len(fits) == 0)
        if gains is not None:
            np.testing.assert_allclose(gains, (fits[0], fits[-1]), atol=2e-4)
    assert not simulation.terminal_penalty(J_min=1.2).wrong


def test_e7_no_velocity_does_better_than_the_least_increase():
    _, q = best_posture()
    J = robot().kinematics(configuration(CHI_DES, q)).J_chi
    least = simulation.least_increase(J)
    assert least > 0.0
    e = np.linalg.eigh(J @ J.T).eigenvectors[:, 0]
    rng = np.random.default_rng(0)
    zeta = -J.T @ e + rng.normal(size=(1000, 10)) * rng.choice([0.0, 1e-2, 1.0], (1000, 1))
    rate = zeta @ J.T @ e + 0.5 + 0.5 * np.sum(zeta**2, axis=1)
    assert np.min(rate) == pytest.approx(least, rel=1e-9)


def test_e7_the_best_posture_is_allowed_and_no_random_one_is_better():
    best, q = best_posture()
    assert is_allowed(configuration(CHI_DES, q))
    rng = np.random.default_rng(7)
    others = configuration(CHI_DES, rng.uniform(robot().q_lower, robot().q_upper, (5000, 4)))
    others = others[np.abs(others[:, 4]) <= PITCH_LIMIT]
    assert np.max(smallest_eigenvalue(others)) < best < 1.0


# The numbers -------------------------------------------------------------------------------------


def test_e8_the_printed_numbers(errata):
    text = errata[7].computed
    assert "reaches 0.49" in text  # 0.2√6
    assert "σ > 5.55" in text  # 2√2/0.5095
    assert "gives 0.0455" in text  # 0.2/(3.084·0.5095 + 2√2)
    assert "void" in text
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


# The kinematic MPC -------------------------------------------------------------------------------


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
    ocp = simulation.kinematic_ocp(1e-3)
    solver = simulation.SequentialConvexSolver(ocp)
    found = simulation.reach(Q_START, simulation.TINY)
    assert found.violation < 1e-6
    rest = ocp.resting_plan(0.0, configuration(CHI_START, Q_START))
    rng = np.random.default_rng(0)
    for _ in range(4):
        guess = rest.redone(rest.start, 0.5 * rng.normal(size=rest.decision.shape))
        plan = solver.solve(guess, 40).plan
        end = dh.chi(plan.config[-1]) - CHI_DES
        assert math.sqrt(0.5) * np.linalg.norm(end) == pytest.approx(found.radius, rel=0.02)


def test_e11_the_other_configuration_arrives_within_the_printed_limits():
    ocp = simulation.kinematic_ocp(simulation.TINY)
    start = configuration(CHI_START, Q_START_OTHER)
    plan = simulation.SequentialConvexSolver(ocp).solve(ocp.resting_plan(0.0, start), 50).plan
    np.testing.assert_allclose(dh.chi(plan.config[0]), CHI_START, atol=1e-9)
    assert np.linalg.norm(dh.chi(plan.config[-1]) - CHI_DES) < 1e-3
    assert (len(plan.zeta), plan.time_step) == (7, 0.1)
    for part in (slice(0, 3), slice(3, 6), slice(6, 10)):
        assert np.max(np.linalg.norm(plan.zeta[:, part], axis=1)) < 2.0 + 1e-6
    assert all(is_allowed(config) for config in plan.config)
    # It is farther than a point that moves at 2 m/s gets.
    assert np.linalg.norm(CHI_START[:3] - CHI_DES[:3]) > 2.0 * 0.7
    assert not simulation.first_horizon(Q_START, Q_START).wrong
    assert not simulation.first_horizon(Q_START_OTHER, Q_START_OTHER).wrong


# README -------------------------------------------------------------------------------------------


def cells_of(row: str) -> list[str]:
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]]


def test_the_table_of_the_readme_is_the_output(errata):
    """Word for word, and number for number but for what another linear algebra library changes."""
    path = Path(__file__).parents[2] / "uvms_drake" / "errata" / "README.md"
    readme = path.read_text(encoding="utf-8")
    written = [line for line in readme.splitlines() if re.match(r"\| E\d+ \|", line)]
    computed = errata_markdown(errata).splitlines()[2:]
    assert len(written) == len(computed) == len(errata)
    number = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e[+-]\d+)?")
    for here, there in zip(written, computed, strict=True):
        assert cells_of(number.sub("#", here)) == cells_of(number.sub("#", there))
        for one, other in zip(number.findall(here), number.findall(there), strict=True):
            assert float(one) == pytest.approx(float(other), rel=0.1, abs=1e-3), here[:60]
