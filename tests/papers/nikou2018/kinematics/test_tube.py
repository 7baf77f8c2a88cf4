"""Tests of `kinematics.tube`, `velocity_radii` and of `certify` on the paper's simulation."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.quick import FEW, search_constants_less, search_less
from support.terminal_checks import check_penalty, check_terminal
from support.tiny_robots import tiny_robot

from uvms_drake.certificate.certificate import (
    Certificate,
    fingerprint,
    read_certificate,
    stale_reason,
    write_certificate,
)
from uvms_drake.certificate.certify import (
    assumed_conditions,
    certified_once,
    certify,
    declared_set,
)
from uvms_drake.certificate.table import format_certificate, verdict
from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.laws import Resolved
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.limits import make_limits, resolved_radii, tighten
from uvms_drake.control.ocp.ocp import TERMINAL_PENALTY
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.euler import wrap_angle
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.papers.nikou2018 import Transpose
from uvms_drake.papers.nikou2018.comparison import with_paper
from uvms_drake.papers.nikou2018.kinematics.laws import velocity_law
from uvms_drake.papers.nikou2018.kinematics.ocp import KinematicOcp
from uvms_drake.papers.nikou2018.kinematics.plan import KinematicPlan
from uvms_drake.papers.nikou2018.kinematics.tube import KINEMATIC, transpose_kinematic_tube
from uvms_drake.papers.nikou2018.kinematics.velocity_radii import (
    velocity_deviation,
    worst_errors,
)
from uvms_drake.station.motions.motions import make_ocp
from uvms_drake.station.problem import load_model, start_state
from uvms_drake.station.scenario.scenario import Scenario, load_scenario
from uvms_drake.tube.constants import estimate_constants
from uvms_drake.tube.law_tube import Basis
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.terminal_set import (
    TerminalLoop,
    boundary_samples,
    largest_radius,
    linear_radius,
)

pytestmark = pytest.mark.long

NAME = "paper_kinematic_certified"
STEP = 0.01
"""Of the Runge-Kutta method [s]."""


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario(NAME, FEW[:1])


@pytest.fixture(scope="module")
def certificate(scenario) -> Certificate:
    return certified_once(scenario)


@pytest.fixture(scope="module")
def ocp(scenario, certificate) -> KinematicOcp:
    """The problem with the certified tube and terminal set."""
    return make_ocp(certificate.applied_to(scenario))


@pytest.fixture(scope="module")
def nominal(scenario, certificate, ocp) -> ConstraintSet:
    """The states that the tube leaves to a plan."""
    tube = resolved_radii(certificate.tube)
    return replace(
        declared_set(scenario.limits, ocp.model),
        tip_pitch=scenario.limits.tip_pitch - tube.orientation,
        roll=scenario.limits.roll - tube.roll, pitch=scenario.limits.pitch - tube.pitch,
        nu1=scenario.limits.nu1 - tube.nu1, nu2=scenario.limits.nu2 - tube.nu2)


@pytest.fixture(scope="module")
def plan(scenario, certificate, ocp) -> KinematicPlan:
    """The first plan, as it is certified."""
    start = start_state(certificate.applied_to(scenario), ocp)[: ocp.state_size]
    solution = SequentialConvexSolver(ocp).solve(ocp.resting_plan(0.0, start), 50)
    assert solution.evaluation.violation < 1e-6
    assert solution.evaluation.terminal_slack < 1e-6
    return solution.plan


# The certificate


def test_the_papers_simulation_is_certified_with_the_printed_weights_and_speeds(
        certificate, scenario):
    assert certificate.certified, verdict(certificate)
    assert (certificate.motion, certificate.law) == ("kinematic", "resolved")
    assert certificate.d_bound == pytest.approx(0.2 * np.sqrt(6.0))
    assert (scenario.limits.nu1, scenario.limits.nu2, scenario.limits.qdot) == (2.0, 2.0, 2.0)
    assert set(scenario.mpc.weight_y[:6]) == set(scenario.mpc.weight_zeta) == {0.5}
    assert scenario.mpc.time_step == 0.1


def test_the_radii_of_the_tube_are_the_disturbance_over_the_gain(certificate):
    tube, radius = certificate.tube, certificate.d_bound / certificate.sigma
    assert tube.e == tube.position == tube.orientation == tube.pitch == pytest.approx(radius)
    assert (tube.joints, tube.qdot) == (0.0, 0.0)
    assert tube.z == pytest.approx(np.hypot(tube.nu1, tube.nu2))
    assert certificate.bounds == {"position": tube.e, "orientation": tube.e,
                                  "force": pytest.approx(tube.e)}


def test_the_declared_tube_is_the_certified_one_rounded_up(certificate, scenario):
    declared, certified = resolved_radii(scenario.tube), resolved_radii(certificate.tube)
    for name, value in vars(certified).items():
        # Where no limit needs it, it is left out.
        if value is not None and name not in (
                "u", "tau", "tip_speed", "depth", "depth_speed", "between_knots"):
            assert value <= getattr(declared, name) <= 1.5 * value, name


def test_the_constants_of_the_papers_law_show_that_it_has_no_tube(
        certificate, scenario, monkeypatch):
    assert (certificate.constants, certificate.paper) == ((), {})
    search_constants_less(monkeypatch)
    with_both = with_paper(certificate, scenario, load_model(scenario))
    assert tuple(constant.name for constant in with_both.constants) == KINEMATIC
    assert np.isinf(with_both.paper["corrected radius"])
    assert with_both.paper["printed radius"] < with_both.paper["radius of resolved"]
    assert with_both.paper["smallest σ"] > 10.0 * certificate.sigma


def test_it_is_the_same_after_json(certificate, scenario, tmp_path):
    write_certificate(certificate, tmp_path)
    again = read_certificate(tmp_path / "certificate.json")
    assert again.to_data() == certificate.to_data()
    assert json.loads((tmp_path / "certificate.json").read_text())["motion"] == "kinematic"
    assert stale_reason(again, scenario) is None
    assert stale_reason(again, load_scenario(NAME, ["ancillary.sigma=11"])) == "the scenario"
    applied = again.applied_to(scenario)
    limits = tighten(make_limits(applied.limits, *applied_joints(applied),
                                 check_surface(applied.surface), accelerations=False),
                     applied.tube)
    assert limits["nu1"].upper[0] == pytest.approx(2.0 - certificate.tube.nu1)


def applied_joints(scenario: Scenario) -> tuple[np.ndarray, np.ndarray]:
    model = make_ocp(scenario).model
    return model.q_lower, model.q_upper


def test_a_declared_radius_is_nothing_to_it_but_that_there_is_one(scenario):
    digests = [fingerprint(load_scenario(NAME, [override]))["inputs"] for override in (
        "mpc.terminal_radius=0.04", "mpc.terminal_radius=0.3", "mpc.terminal_set=false")]
    assert digests[0] == digests[1] != digests[2]


def test_the_table_names_everything(certificate):
    text = format_certificate(certificate)
    assert text.splitlines()[0] == (
        f"{NAME}: kinematic motion, law resolved, σ = {certificate.sigma:g} 1/s, w̃ = 0.4899 m/s, "
        "rad/s")
    for condition in certificate.conditions:
        assert (str(condition) if condition.is_count else condition.name) in text
    assert f"certified: all {len(certificate.conditions)} conditions hold; of the " in text


# The tube


def test_the_deviation_is_what_the_law_itself_leaves(ocp, nominal):
    model, rng, sigma = ocp.model, np.random.default_rng(1), 7.0
    for config, zeta in zip(*nominal.sample(model, 10, rng), strict=True):
        error = 0.05 * rng.normal(size=6)
        y = model.task_pose(config)
        y[:6] += error
        law = Resolved(sigma=sigma)
        real = velocity_law(law).velocity(
            law, model, model.configuration(y), np.concatenate([config, zeta]))
        np.testing.assert_allclose(
            velocity_deviation(model, config, zeta, error, sigma), (real - zeta)[:6], atol=1e-9)
        np.testing.assert_allclose(real[6:], zeta[6:], atol=1e-12)


def test_random_errors_and_states_leave_no_radius(certificate, ocp, nominal):
    """And the bounds are no larger than what they promise: errors are found that come close."""
    model, tube, rng = ocp.model, certificate.tube, np.random.default_rng(2)
    config, zeta = nominal.sample(model, 20_000, rng)
    error = rng.normal(size=(len(config), 6))
    error *= tube.e / np.linalg.norm(error, axis=1, keepdims=True)
    away = velocity_deviation(model, config, zeta, error, certificate.sigma)
    y = model.task_pose(config)
    y[:, :6] += error
    turned = np.abs(wrap_angle(model.configuration(y)[:, 3:5] - config[:, 3:5]))
    assert np.max(np.linalg.norm(away[:, :3], axis=1)) < tube.nu1
    assert np.max(np.linalg.norm(away[:, 3:], axis=1)) < tube.nu2
    assert 0.6 * tube.roll < np.max(turned[:, 0]) <= tube.roll
    assert 0.9 * tube.pitch < np.max(turned[:, 1]) <= tube.pitch


@pytest.mark.parametrize(("name", "block"), [("nu1", slice(0, 3)), ("nu2", slice(3, 6))])
def test_fresh_searches_come_close_to_the_radii_and_not_beyond(
        certificate, scenario, ocp, name, block):
    declared = declared_set(scenario.limits, ocp.model)
    wide = replace(declared, tip_pitch=declared.tip_pitch - certificate.tube.e)
    config, zeta = wide.sample(ocp.model, 3000, np.random.default_rng(3))
    reached, error = worst_errors(
        ocp.model, config, zeta, block, certificate.tube.e, certificate.sigma)
    np.testing.assert_allclose(np.linalg.norm(error, axis=1), certificate.tube.e, rtol=1e-9)
    radius = getattr(certificate.tube, name)
    assert 0.75 * radius < np.max(reached) < radius


def attacks(model: ContactModel, w_bound: float) -> dict:
    """Returns w(t, 𝔮, 𝔢) of 2-norm `w_bound` at most, by name."""
    lead = np.array([0.6, -0.2, 0.5, 0.3, -0.4, 0.2])
    lead /= np.linalg.norm(lead)

    def along_error(time, config, error):
        size = np.linalg.norm(error)
        return w_bound * (error / size if size > 1e-9 else lead)

    def into_velocity(time, config, error):
        """Up the direction in which 𝔢 costs most velocity ν₁ where the robot is."""
        J = model.task_jacobian(config)[:6, :6]
        direction = np.linalg.svd(np.linalg.inv(J)[:3])[2][0]
        return w_bound * direction * (1.0 if direction @ error >= 0.0 else -1.0)

    return {
        "constant": lambda time, config, error: w_bound * lead,
        "sinusoid": lambda time, config, error: np.full(6, w_bound / np.sqrt(6.0)) * np.sin(time),
        "along the error": along_error,
        "into the velocity": into_velocity,
    }


def closed_loop(model: ContactModel, plan: KinematicPlan, law: AncillaryLaw, attack
                ) -> SimpleNamespace:
    """Integrates 𝔮̇ = Γ(𝔮)(ζ + [J_v⁻¹w; 0]), which is χ̇ = Jζ + w and q̇ as commanded."""
    config = plan.config[0].copy()
    found: dict[str, list[np.ndarray]] = {"error": [], "zeta": [], "attitude": []}

    def rate(time: float, interval: int, config: np.ndarray) -> np.ndarray:
        # A knot belongs to the interval that the step is in.
        inside = min(max(time, interval * 0.1 + 1e-7), (interval + 1) * 0.1)
        state = np.concatenate(plan.at(inside))
        error = model.task_pose(config) - model.task_pose(state[: model.size])
        error[3:6] = wrap_angle(error[3:6])
        zeta = velocity_law(law).velocity(law, model, config, state)
        w = attack(time, config, error[:6])
        if inside == time:
            found["error"].append(error)
            found["zeta"].append(zeta - state[model.size:])
            found["attitude"].append(wrap_angle(config[3:5] - state[3:5]))
        zeta = zeta.copy()
        zeta[:6] += np.linalg.solve(model.task_jacobian(config)[:6, :6], w)
        return configuration_rate(config, zeta)

    steps = round((len(plan.config) - 1) * plan.time_step / STEP)
    for i in range(steps):
        time, interval = i * STEP, int(i * STEP / 0.1 + 1e-6)
        k1 = rate(time, interval, config)
        k2 = rate(time + 0.5 * STEP, interval, config + 0.5 * STEP * k1)
        k3 = rate(time + 0.5 * STEP, interval, config + 0.5 * STEP * k2)
        k4 = rate(time + STEP, interval, config + STEP * k3)
        config = config + STEP / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return SimpleNamespace(**{name: np.array(values) for name, values in found.items()})


@pytest.mark.parametrize("name", ["constant", "sinusoid", "along the error", "into the velocity"])
def test_no_disturbance_leaves_the_tube_in_closed_loop(certificate, ocp, plan, name):
    tube, slack = certificate.tube, 1.0 + 1e-4  # of the integrator
    run = closed_loop(ocp.model, plan, Resolved(sigma=certificate.sigma),
                      attacks(ocp.model, certificate.d_bound)[name])
    reached = np.max(np.linalg.norm(run.error[:, :6], axis=1))
    assert reached <= tube.e * slack
    if name != "sinusoid":
        assert reached > (0.99 if name != "into the velocity" else 0.5) * tube.e
    assert np.max(np.abs(run.error[:, 6:])) < 1e-6
    assert np.max(np.linalg.norm(run.zeta[:, :3], axis=1)) <= tube.nu1
    assert np.max(np.linalg.norm(run.zeta[:, 3:6], axis=1)) <= tube.nu2
    assert np.max(np.abs(run.zeta[:, 6:])) < 1e-5
    assert np.all(np.max(np.abs(run.attitude), axis=0) <= [tube.roll, tube.pitch])


def test_without_an_arm_the_papers_law_has_a_tube_and_keeps_it(scenario):
    """χ determines 𝔮 then; with slow limits σJ̲ exceeds L_c."""
    model = tiny_robot([], [], (0.5, 0.0, 0.2))
    declared = ConstraintSet(
        q_lower=np.zeros(0), q_upper=np.zeros(0), roll=0.5, pitch=0.5, tip_pitch=0.6, nu1=0.3,
        nu2=0.2, qdot=0.1)
    law = Transpose(sigma=12.0)
    constants = estimate_constants(model, declared, KINEMATIC, samples=300)
    tube, conditions, *_ = transpose_kinematic_tube(
        law, Basis(
            model, declared, constants, 0.05, np.ones(6), np.zeros(0), scenario.certificate))
    assert all(item.holds for item in conditions), conditions
    value = {name: constant.value for name, constant in constants.items()}
    assert tube.e == pytest.approx(0.05 / (12.0 * value["J_min"] - value["L_c_chi"]))
    zeta = np.tile([0.2, 0.1, 0.0, 0.05, 0.1, -0.1], (10, 1))
    plan = KinematicPlan.from_velocities(0.0, 0.1, np.zeros(6), zeta)
    for attack in attacks(model, 0.05).values():
        run = closed_loop(model, plan, law, attack)
        assert np.max(np.linalg.norm(run.error, axis=1)) <= tube.e
        assert np.max(np.linalg.norm(run.zeta, axis=1)) <= tube.z
        assert np.all(np.max(np.abs(run.attitude), axis=0) <= [tube.roll, tube.pitch])
    # An error along the weakest direction of J, which then turns into the strongest, against w.
    fastest = 12.0 * value["J_max"] ** 2 * 0.05 / (12.0 * value["J_min"]) + 0.05
    assert tube.tip_speed is not None and fastest <= tube.tip_speed
    assert tube.tip_speed == pytest.approx(
        12.0 * (value["J_max"] ** 2 + value["J_min"]) * tube.e)


# The terminal set


@pytest.fixture(scope="module")
def wide() -> KinematicOcp:
    """A task further inside the limits, where the nonlinear map decides how large F is."""
    return make_ocp(load_scenario(NAME, [
        "task.posture=[0, 0.9, 0.278, 1.0471975512]",
        "mpc.weight_y=[0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 5, 5, 5, 5]"]))


@pytest.fixture(scope="module")
def found(wide):
    return largest_radius(wide)


def rolled_out(ocp: KinematicOcp, xi: np.ndarray, intervals: int) -> KinematicPlan:
    """Returns the plan of the terminal controller from ξ (6+n,)."""
    config = ocp.model.configuration(ocp.y_des + xi)
    plan = KinematicPlan.from_velocities(0.0, ocp.time_step, config, (ocp.terminal.gain @ xi)[None])
    for _ in range(intervals - 1):
        y = ocp.unwrapped(ocp.model.task_pose(plan.config))
        zeta = np.concatenate([plan.zeta, (ocp.terminal.gain @ ocp.errors(plan, y)[-1])[None]])
        plan = plan.redone(config, zeta)
    return plan


def test_the_certified_terminal_set_passes_a_fresh_check(certificate, ocp):
    check = check_terminal(ocp, certificate.terminal.radius, samples=10_000, seed=77)
    assert check.holds, check.failures
    assert check.margins["decrease at rest"] == pytest.approx(1.0, abs=1e-6)


def test_from_its_boundary_the_terminal_controller_keeps_every_limit_and_pays_its_own_way(
        wide, found):
    """As the problem itself values plans of 30 intervals: cost within V(ξ₀), back in F always."""
    radius, check = found
    P, rng = wide.terminal.P, np.random.default_rng(5)
    states = radius * boundary_samples(P, 60, rng)
    for xi in [*states, *(state for state in check.worst.values())]:
        plan = rolled_out(wide, xi, 30)
        errors = wide.unwrapped(wide.model.task_pose(plan.config)) - wide.y_des
        V = np.sum((errors @ P) * errors, axis=1)
        assert np.all(np.diff(V) < 0.0)
        assert np.sqrt(V[-1]) < 0.2 * np.sqrt(V[0])
        problem = KinematicOcp.__new__(KinematicOcp)
        problem.__dict__.update(vars(wide), horizon=30)
        evaluation = problem.evaluate(plan)
        assert evaluation.violation <= 1e-9
        cost = evaluation.cost - TERMINAL_PENALTY * evaluation.terminal_slack
        assert cost <= V[0] * (1.0 + 1e-9)


def test_a_wider_set_is_refused_for_a_limit_that_the_problem_finds_broken_too(wide, found):
    radius, check = found
    assert check.holds and check.limiting in ("pitch", "roll", "decrease")
    assert radius < linear_radius(TerminalLoop(wide))
    wider = check_terminal(wide, 1.3 * radius)
    assert not wider.holds
    config = wide.model.configuration(wide.y_des + wider.worst["pitch"])
    assert abs(config[4]) > wide.limits["pitch"].upper[0]


def test_the_margins_are_those_of_a_plan_of_one_interval(wide):
    loop, P = TerminalLoop(wide), wide.terminal.P
    for xi in 0.5 * boundary_samples(P, 5, np.random.default_rng(6)):
        plan = rolled_out(wide, xi, 1)
        after = wide.unwrapped(wide.model.task_pose(plan.config[1])) - wide.y_des
        stage = wide.time_step * (xi @ wide.Q @ xi + plan.zeta[0] @ wide.R @ plan.zeta[0])
        expected = [(xi @ P @ xi - after @ P @ after) / stage - 1.0,
                    *(1.0 - np.abs(plan.config[0, 3:5]) / [
                        wide.limits[name].upper[0] for name in ("roll", "pitch")])]
        np.testing.assert_allclose(loop.margins(xi), expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("name", "block"), [
    ("nu1", slice(0, 3)), ("nu2", slice(3, 6)), ("qdot", slice(6, 10))])
def test_the_speeds_in_the_set_have_a_closed_form(wide, name, block):
    """By brute force over the support points of many rows of the gain."""
    P, gain = wide.terminal.P, wide.terminal.gain[block]
    rows = np.random.default_rng(7).normal(size=(5000, len(gain))) @ gain
    reached = np.max(np.linalg.norm(
        boundary_samples(P, 1, np.random.default_rng(8), rows) @ gain.T, axis=1))
    assert TerminalLoop(wide).closed_form_limits()[name][1] == pytest.approx(reached, rel=2e-3)


def test_the_penalty_of_the_paper_fails_whatever_the_controller(wide):
    """P = ½I: off the task no velocity lowers ½‖ξ‖² by as much as it costs (E7)."""
    check = check_penalty(wide, 0.5 * np.eye(10))
    assert {"decrease", "decrease at rest"} <= set(check.failures)
    assert check.margins["decrease at rest"] < -0.2


def test_without_inflation_there_is_no_terminal_set(wide):
    bare = KinematicOcp.__new__(KinematicOcp)
    bare.__dict__.update(vars(wide), terminal=replace(wide.terminal, P=0.5 * wide.terminal.P))
    radius, check = largest_radius(bare, samples=500)
    assert radius == 0.0
    assert "decrease" in check.failures


def test_a_singular_penalty_is_refused_in_one_line():
    ocp = make_ocp(load_scenario("paper_kinematic"))
    with pytest.raises(InvalidParameter, match="smallest eigenvalue of P"):
        largest_radius(ocp)


# What voids it


def test_the_papers_own_numbers_have_no_certificate_and_every_reason_is_named(monkeypatch):
    search_less(monkeypatch)
    void = certify(load_scenario("paper_kinematic", FEW))
    broken = [item for item in void.conditions if not item.holds]
    assert [item.name.split(",")[0] for item in broken] == [
        "σJ̲", "n", "mpc.terminal_weight", "mpc.terminal_set", "joints of weight zero"]
    assert broken[0].left == pytest.approx(3.084 * 0.41 / 1.1, rel=0.02)
    assert broken[0].right > 20.0
    assert broken[1].left == 4.0
    assert np.isinf(void.tube.e) and void.terminal is None
    assert "what would help" in verdict(void)
    assert Certificate.from_data(void.to_data()).to_data() == void.to_data()


@pytest.mark.parametrize(("overrides", "begins"), [
    (["mpc.weight_y=[0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0, 0, 0, 0]"], "joints of weight zero"),
    (["ancillary.sigma=3.084"], "tube in limits."),
    (["ancillary.sigma=0.4"], "tube in limits.nu1"),  # w̃/σ beyond the tip's pitch
    (["mpc.horizon=7"], "first plan, distance"),
])
def test_what_voids_a_certificate_is_named_with_what_would_help(overrides, begins, monkeypatch):
    search_less(monkeypatch)
    void = certify(load_scenario(NAME, [*FEW, *overrides]))
    assert not void.certified
    assert void.failed.name.startswith(begins)
    assert "what would help" in verdict(void)


@pytest.mark.parametrize("water", ["current=[0.1, 0, 0]", "waves=[{}]"])
def test_water_that_moves_is_bad_input_where_there_is_none(water):
    with pytest.raises(InvalidParameter, match=water.partition("=")[0]):
        certify(load_scenario(NAME, [*FEW, water]))


@pytest.mark.parametrize(("override", "begins"), [
    ("mpc.initial_state=measured", "mpc.initial_state"),
    ("mpc.terminal_weight=[1, 1, 1, 1, 1, 1, 1, 1, 1, 1]", "mpc.terminal_weight"),
    ("mpc.terminal_set=false", "mpc.terminal_set"),
])
def test_options_that_break_the_theory_are_conditions(override, begins):
    (broken,) = [item for item in assumed_conditions(
        load_scenario(NAME, [override])) if not item.holds]
    assert broken.name.startswith(begins)
