"""Errata: confirmed, in the table and in the README; right by another way; correct values pass."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from support import dh
from support.random_systems import integrate

import uvms_drake as uv
from uvms_drake.model.uvms_model import configuration_rate_matrix
from uvms_drake.papers.nikou2018.errata import (
    Erratum,
    all_errata,
    choices,
    errata_markdown,
    paper,
    proof,
    simulation,
)
from uvms_drake.papers.nikou2018.kinematics import simulate
from uvms_drake.papers.nikou2018.transpose import LemmaConstants
from uvms_drake.plant.disturbance import ConstantDisturbance


@pytest.fixture(scope="module")
def errata() -> list[Erratum]:
    return all_errata()


@pytest.mark.long
def test_every_erratum_is_there_and_confirmed(errata):
    assert [item.number for item in errata] == [f"E{i}" for i in range(1, 15)]
    assert all(item.wrong is True for item in errata)
    assert all(item.title and item.printed and item.consequence for item in errata)


def cells_of(row: str) -> list[str]:
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]]


@pytest.mark.long
def test_the_table_of_the_page_is_the_output(errata):
    """Word for word, and number for number but for rounding."""
    path = Path(__file__).parents[4] / "uvms_drake/papers/nikou2018/errata/errata.md"
    readme = path.read_text(encoding="utf-8")
    written = [line for line in readme.splitlines() if re.match(r"\| E\d+ \|", line)]
    computed = errata_markdown(errata).splitlines()[2:]
    assert len(written) == len(computed) == len(errata)
    number = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e[+-]\d+)?")
    for here, there in zip(written, computed, strict=True):
        assert cells_of(number.sub("#", here)) == cells_of(number.sub("#", there))
        for one, other in zip(number.findall(here), number.findall(there), strict=True):
            assert float(one) == pytest.approx(float(other), rel=0.1, abs=1e-3), here[:60]


@pytest.mark.long
def test_the_choices_show_what_the_errata_state(tmp_path):
    """E9: the nominal motion jumps at every sample; E5: the paper's law leaves the joints alone."""
    choices.draw_choices(tmp_path, overrides=["duration=0.6"])
    assert all((tmp_path / name).stat().st_size > 10_000 for name in choices.FIGURES)
    (nominal, measured), (resolved, transpose) = (
        [simulate(uv.load_scenario("paper_kinematic", [each])) for each in choices.CHOICES[name]]
        for name in ("initial_state.png", "law.png"))
    jumps = [np.max(np.linalg.norm(np.diff(run.chi_nominal, axis=0), axis=1)[300:])
             for run in (nominal, measured)]
    assert jumps[1] > 2.0 * jumps[0]
    late = nominal.time > 4.5
    errors = choices.panels_of([nominal, measured])[choices.TASK_ERROR]
    assert np.max(errors[1][late]) > 1.4 * np.max(errors[0][late])
    drift = [np.max(np.abs((run.config - run.nominal_config)[:, 6:]))
             for run in (resolved, transpose)]
    assert drift[0] < 1e-6
    assert drift[1] > 0.2


SCALAR = LemmaConstants(J_min=1.44, J_max=1.2, J_dot=0.3, L_c=0.4, L_1=0.7, L_2=0.9)


@pytest.mark.long
def test_e1_the_plant_accelerates_by_f_plus_u_if_tau_is_m_u():
    rng = np.random.default_rng(3)
    state, u = rng.uniform(-0.2, 0.2, 20), rng.uniform(-0.2, 0.2, 10)
    uvms = uv.make_uvms_plant("girona500_arm5e", surface=uv.BilateralSpring(),
                           disturbance=ConstantDisturbance(bound=0.0))
    M = paper.robot().mass_matrix(paper.robot().kinematics(state[:10]))
    expected = paper.robot().drift(state[:10], state[10:]) + u
    errors = []
    for tau in (M @ u, u):
        simulator = Simulator(uvms)
        context = simulator.get_mutable_context()
        uv.set_state(uvms, context, state)
        uvms.GetInputPort("tau").FixValue(context, tau)
        uvms.GetInputPort("current").FixValue(context, np.zeros(3))
        simulator.AdvanceTo(1e-5)
        rate = (uvms.GetOutputPort("state").Eval(context)[10:] - state[10:]) / 1e-5
        errors.append(np.linalg.norm(rate - expected) / np.linalg.norm(u))
    assert errors[0] < 1e-2 < 1.0 < errors[1]


@pytest.mark.long
def test_e3_a_scalar_system_needs_what_is_derived_by_hand():
    """𝔢J𝔯 and −σ²𝔯J³𝔢 cannot both be largest; all other terms of the corrected Λ₁ are attained."""
    sigma, J = 2.0, np.array([[1.2]])
    needed = proof.needed_lambda(SCALAR, J, sigma)
    by_hand = 0.9 * (1.0 + 2.4) + 2.0 * (0.4 * 1.2 + 0.3) + abs(1.2 - 4.0 * 1.2**3)
    assert by_hand * (1.0 - 1e-4) < needed <= by_hand  # As ‖𝔯‖/‖𝔢‖ → ∞.
    assert needed < proof.quadratic_form(SCALAR, sigma).corrected
    assert proof.lost_terms(SCALAR, J, sigma).wrong


@pytest.mark.long
def test_e3_the_robots_states_need_nearly_the_corrected_lambda():
    constants, J = paper.robot_constants()
    assert constants.J_max == pytest.approx(np.linalg.norm(J, 2))
    sigma = 2.0 * constants.L_c / constants.J_min
    form = proof.quadratic_form(constants, sigma)
    needed = proof.needed_lambda(constants, J, sigma)
    assert 2.0 * form.Lambda_1 < needed <= form.corrected
    assert needed > 0.98 * form.corrected


def test_e4_the_attained_velocity_is_the_largest_of_the_ball():
    J = paper.robot_constants()[1]
    for sigma in (0.05, 1.0, 5.0):
        attained = proof.attained_velocity(J, sigma)
        # ‖[−σJᵀ I]‖ is the largest ‖𝔷‖ over the ball.
        largest = np.linalg.norm(np.hstack([-sigma * J.T, np.eye(10)]), 2)
        assert attained == pytest.approx(largest, rel=1e-12)
        assert attained == pytest.approx(math.hypot(1.0, sigma * np.linalg.norm(J, 2)), rel=1e-12)
    assert proof.velocity_tube(J, 1.0).wrong
    assert not proof.velocity_tube(J / 10.0, 0.1).wrong  # 2/J̄ is large enough there.


def test_e5_the_end_effector_is_at_one_pose_by_the_papers_table():
    config = paper.configuration(paper.CHI_START, np.array([paper.Q_START, paper.Q_START_OTHER]))
    for item in config:
        np.testing.assert_allclose(dh.chi(item), paper.CHI_START, atol=1e-9)


def test_e12_the_corner_moves_as_an_integration_says():
    s, k, sigma, z = 2.2, 158.0, 1.0, 2.4
    rate, peak = proof.corner_motion(s, k, sigma, z)
    assert rate == pytest.approx(s * z)
    states = [x[0] for _, x in integrate(
        lambda t, x: np.array([s * x[1], -k * (x[1] + sigma * s * x[0])]), np.array([1.0, z]),
        0.2, 1e-4)]
    assert peak == pytest.approx(max(states), rel=1e-6)
    assert peak > 1.0


@pytest.mark.long
def test_e12_the_ball_is_kept_and_a_product_without_a_corner_too():
    J = paper.robot_constants()[1]
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


def test_e14_a_regular_configuration_is_not_flagged():
    assert proof.configuration_set().wrong
    # T(𝔬) is about 1/cos(pitch): √2/0.01 there, since roll and yaw both turn.
    steep = float(re.search(r"‖J‖ = ([\d.]+)", proof.configuration_set().computed)[1])
    assert steep == pytest.approx(math.sqrt(2.0) / 0.01, rel=0.05)


@pytest.mark.long
def test_e8_the_printed_numbers():
    text = simulation.simulation_numbers().computed
    assert "reaches 0.49" in text  # 0.2√6
    assert "σ > 5.55" in text  # 2√2/0.5095
    assert "gives 0.0455" in text  # 0.2/(3.084·0.5095 + 2√2)
    assert "makes the tube infinite" in text
    assert 0.2 * math.sqrt(6.0) == pytest.approx(0.4899, abs=1e-4)
    assert 0.2 / (3.084 * 0.5095 + 2.0 * math.sqrt(2.0)) == pytest.approx(0.0455, abs=5e-5)


@pytest.mark.long
def test_e8_the_smallest_eigenvalue_by_the_papers_table():
    """No sample is below the estimate, and J there is that of finite differences of the table."""
    found = paper.estimated_J_min()
    assert found == pytest.approx(0.411, abs=2e-3)
    rng = np.random.default_rng(5)
    edge = np.array([np.pi, paper.PITCH_LIMIT])
    config = np.zeros((5000, 10))
    config[:, 3:5] = rng.uniform(-edge, edge, (5000, 2))
    config[:, 6:] = rng.uniform(dh.LOWER, dh.UPPER, (5000, 4))
    values = paper.smallest_eigenvalue(config)
    assert found < np.min(values) < 0.5095
    worst = config[np.argmin(values)]
    Gamma = configuration_rate_matrix(worst)
    J = np.array([(dh.chi(worst + 1e-6 * step) - dh.chi(worst - 1e-6 * step)) / 2e-6
                  for step in Gamma.T]).T
    assert np.linalg.eigvalsh(J @ J.T)[0] == pytest.approx(np.min(values), rel=1e-5)


@pytest.mark.long
def test_e8_the_jacobian_grows_as_the_end_effector_points_up_or_down():
    grown = simulation.norm_at_tip_pitch(-1.56) / simulation.norm_at_tip_pitch(-1.4)
    assert grown == pytest.approx(math.cos(1.4) / math.cos(1.56), rel=0.02)


@pytest.mark.long
def test_e10_the_papers_poses_by_the_papers_table():
    assert dh.chi(np.zeros(10))[4] == pytest.approx(-np.pi / 2)
    level = [([-2.057, 1.017, -1.184, 0.0, 0.0, np.pi / 12], paper.Q_START, paper.CHI_START),
             ([-0.972, 0.0, 0.058, 0.0, 0.0, 0.0], paper.Q_DES, paper.CHI_DES)]
    for eta, q, chi in level:
        np.testing.assert_allclose(dh.chi(np.concatenate([eta, q])), chi, atol=1e-3)


def test_e9_the_deviation_of_one_sample_is_the_jump():
    sigma, w = 3.084, 0.2
    (jump, off), (own_jump, own_off) = simulation.hold(True), simulation.hold(False)
    assert jump == pytest.approx(w / sigma * (1.0 - math.exp(-0.1 * sigma)), rel=1e-9)
    assert own_jump == 0.0
    assert own_off == pytest.approx(
        w / sigma * (1.0 - math.exp(-sigma * 0.1 * simulation.HOLDING)), rel=1e-6)
    assert off > 2.0 * w / sigma


@pytest.mark.long
def test_e11_plans_from_elsewhere_end_no_closer():
    """The smallest ε from the level vehicle is a local optimum; four random starts find it too."""
    mpc = simulation.printed_mpc(1e-3)
    radius, _, violation = simulation.reach(paper.Q_START, simulation.TINY)
    assert violation < 1e-6
    start = paper.configuration(paper.CHI_START, paper.Q_START)
    rng = np.random.default_rng(0)
    for _ in range(4):
        plan = mpc.solve(mpc.plan(start, 0.5 * rng.normal(size=(7, 10))), 40)
        end = dh.chi(plan.config[-1]) - paper.CHI_DES
        assert math.sqrt(0.5) * np.linalg.norm(end) == pytest.approx(radius, rel=0.02)


@pytest.mark.long
def test_e11_the_other_configuration_arrives_within_the_printed_limits():
    mpc = simulation.printed_mpc(simulation.TINY)
    plan = mpc.solve(mpc.resting(paper.configuration(paper.CHI_START, paper.Q_START_OTHER)), 50)
    np.testing.assert_allclose(dh.chi(plan.config[0]), paper.CHI_START, atol=1e-9)
    assert np.linalg.norm(dh.chi(plan.config[-1]) - paper.CHI_DES) < 1e-3
    assert len(plan.zeta) == 7
    for part in (slice(0, 3), slice(3, 6), slice(6, 10)):
        assert np.max(np.linalg.norm(plan.zeta[:, part], axis=1)) < 2.0 + 1e-6
    assert all(paper.is_allowed(config) for config in plan.config)
    # It is farther than a point that moves at 2 m/s gets.
    assert np.linalg.norm(paper.CHI_START[:3] - paper.CHI_DES[:3]) > 2.0 * 0.7


@pytest.mark.long
def test_e6_the_loop_rests_near_the_least_stage_cost_and_the_hold_input_is_not_flagged():
    """A long horizon settled where the stage cost of a rest is least; this one is 3 s."""
    errors, force, _, speed = simulation.settled(0.0)
    assert speed < 1e-4
    ocp = uv.make_ocp(uv.load_scenario("girona500_bilateral"))
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
    assert np.linalg.norm(errors[-1, :3]) == pytest.approx(
        np.linalg.norm((y - ocp.y_des)[:3]), rel=0.25)
    K = model.surface.stiffness
    assert np.linalg.norm(force) == pytest.approx(
        np.linalg.norm((K @ (y - ocp.y_des)[:6])[:3]), rel=0.25)


def test_e7_gains_exist_from_an_eigenvalue_of_one_on():
    c = np.linspace(0.0, 5.0, 50_001)[1:]
    for J_min in (0.2, 0.5095, 0.99, 1.01, 1.3, 2.0):
        fits = c[c >= 0.5 + 0.5 * c**2 / J_min]
        gains = simulation.decrease_gains(J_min)
        assert (gains is None) == (len(fits) == 0)
        if gains is not None:
            np.testing.assert_allclose(gains, (fits[0], fits[-1]), atol=2e-4)


@pytest.mark.long
def test_e7_no_velocity_does_better_and_no_allowed_posture():
    best, q = paper.best_posture()
    assert paper.is_allowed(paper.configuration(paper.CHI_DES, q))
    rng = np.random.default_rng(7)
    others = paper.configuration(paper.CHI_DES, rng.uniform(
        paper.robot().q_lower, paper.robot().q_upper, (5000, 4)))
    others = others[np.abs(others[:, 4]) <= paper.PITCH_LIMIT]
    assert np.max(paper.smallest_eigenvalue(others)) < best < 1.0
    J = paper.robot().kinematics(paper.configuration(paper.CHI_DES, q)).J_chi
    e = np.linalg.eigh(J @ J.T).eigenvectors[:, 0]
    zeta = -J.T @ e + rng.normal(size=(1000, 10)) * rng.choice([0.0, 1e-2, 1.0], (1000, 1))
    rate = zeta @ J.T @ e + 0.5 + 0.5 * np.sum(zeta**2, axis=1)
    assert np.min(rate) == pytest.approx(simulation.least_increase(J), rel=1e-9)
    assert simulation.least_increase(J) > 0.0
