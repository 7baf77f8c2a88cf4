"""Tests of `uvms_drake.control.costs`: the task's cost, a shipped term and one of a script."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
from pydrake.solvers import SnoptSolver

import uvms_drake as uv
from uvms_drake.certificate.assumptions import assumed_conditions
from uvms_drake.control.costs.costs import OffsetCost
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.control.ocp.solvers import NonlinearSolver
from uvms_drake.control.plan.plan import Plan
from uvms_drake.control.plan.points import Slopes
from uvms_drake.station.scenario.scenario import dump_scenario


@dataclass
class Power(uv.CostTerm):
    """weight ‖τᵢζᵢ‖²: nonlinear in all that there is, and a script's own."""

    about: ClassVar = "input"

    weight: float = 1e-3

    def residual(self, at: uv.Points) -> np.ndarray:
        return np.sqrt(self.weight) * at.tau * at.zeta


class Slow(uv.CostTerm):
    """‖𝔭̇‖², of the end-effector."""

    about: ClassVar = "speed"

    def residual(self, at: uv.Points) -> np.ndarray:
        return 3.0 * (at.model.kinematics(at.config).J_chi[..., :3, :] @ at.zeta[..., None])[..., 0]


def with_terms(name: str, *terms: uv.CostTerm) -> tuple[uv.Scenario, Ocp, Plan]:
    """Returns a scenario with a short horizon, its problem, and a first guess."""
    scenario = uv.load_scenario(name, ["mpc.horizon=5"])
    scenario = replace(scenario, mpc=replace(scenario.mpc, terms=list(terms)))
    ocp = uv.make_ocp(scenario)
    return scenario, ocp, ocp.resting_plan(0.0, uv.start_state(scenario, ocp)[: ocp.state_size])


def moving(guess: Plan) -> Plan:
    rng = np.random.default_rng(0)
    return guess.redone(guess.start, 0.1 * rng.normal(size=guess.decision.shape))


CASES = [("girona500_ideal", uv.costs.LevelVehicle(4000.0)), ("girona500_ideal", Power()),
         ("girona500_ideal", Slow())]


@pytest.mark.parametrize(("name", "term"), CASES)
def test_a_term_adds_its_squares_to_the_cost(name, term):
    """Summed up interval by interval."""
    _, ocp, guess = with_terms(name, term)
    plan, bare = moving(guess), uv.make_ocp(uv.load_scenario(name, ["mpc.horizon=5"]))
    expected = 0.0
    for k, u in enumerate(ocp.inputs(plan)[0]):
        r = term.residual(uv.Points(ocp.model, plan.config[k], ocp.model.task_pose(plan.config[k]),
                                 plan.zeta[k], u))
        expected += ocp.time_step * (r @ r)
    assert expected > 1e-4
    assert ocp.evaluate(plan).cost - bare.evaluate(plan).cost == pytest.approx(expected)


@pytest.mark.parametrize(("name", "term"), CASES)
def test_the_program_has_the_slope_of_the_cost(name, term, derivative):
    _, ocp, guess = with_terms(name, term)
    plan = moving(guess)
    program, change = ocp.staged_program(plan), np.random.default_rng(1).normal(
        size=plan.decision.shape)
    x, slope = np.zeros(program.A.shape[1]), 0.0
    for k in range(len(change)):
        slope += program.g[k] @ np.concatenate([x, change[k]])
        x = program.A[k] @ x + program.B[k] @ change[k]
    slope += program.g_end @ x
    found = derivative(lambda s: ocp.evaluate(plan.redone(
        plan.start, plan.decision + s * change)).cost - 100.0 * ocp.evaluate(plan.redone(
            plan.start, plan.decision + s * change)).terminal_slack, 1e-4)
    assert found == pytest.approx(slope, rel=1e-6)


def test_the_closed_form_of_the_task_is_the_model_of_its_residual():
    _, ocp, guess = with_terms("girona500_ideal")
    plan = moving(guess)
    program, knots = ocp.staged_program(plan), ocp.points(plan).knots
    ends, *by_z = ocp.linearised_inputs(plan, knots, program.A, program.B)
    points, chain = ends.subset(slice(5), ends.u[:5]), [each[:5] for each in by_z]
    for found, expected in zip(
            uv.CostTerm.quadratic(ocp.task_cost, points, Slopes(*chain), 0.2),
            ocp.task_cost.quadratic(points, Slopes(*chain), 0.2), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("name", "term"), CASES[:1] + CASES[2:])
def test_fast_solver_and_reference_agree(name, term):
    _, ocp, guess = with_terms(name, term)
    bare = uv.make_ocp(uv.load_scenario(name, ["mpc.horizon=5"]))
    one = SequentialConvexSolver(ocp).solve(guess, 100, 1e-12)
    other = NonlinearSolver(ocp, SnoptSolver()).solve(guess)
    assert other.converged
    assert one.evaluation.cost == pytest.approx(other.evaluation.cost, rel=1e-4)
    without = SequentialConvexSolver(bare).solve(guess, 100, 1e-12).plan
    assert one.evaluation.cost < ocp.evaluate(without).cost - 1e-4, "it does something"


def test_with_a_term_of_ones_own_there_is_no_certificate():
    scenario, *_ = with_terms("girona500_ideal", uv.costs.LevelVehicle(), Power())
    assert [item.name for item in assumed_conditions(scenario) if not item.holds] == [
        "mpc.terms[0], LevelVehicle, which the terminal set leaves out",
        "mpc.terms[1], Power, which the terminal set leaves out"]


def test_a_scenario_with_a_term_runs_and_is_the_same_after_yaml(tmp_path):
    scenario = uv.load_scenario("girona500_ideal", [
        "duration=0.4", "mpc.terms=[!LevelVehicle {weight: 200}]"])
    path = tmp_path / "again.yaml"
    path.write_text(dump_scenario(scenario))
    assert uv.load_scenario(str(path)).mpc.terms == [uv.costs.LevelVehicle(200.0)]
    assert np.all(uv.simulate(scenario).mpc_status == 0.0)


@pytest.mark.parametrize(("about", "residual", "why"), [
    ("pose", lambda at: at.zeta[..., 7:8], r"about = 'pose' must be 'speed' if it reads"),
    ("speed", lambda at: at.zeta[..., 7], r"must be an array \(\.\.\., m\)"),
    ("velocity", lambda at: at.zeta, r"about = 'velocity': must be one of pose, speed, input")])
def test_a_term_with_a_usual_mistake_says_it(about, residual, why):
    class Mistaken(uv.CostTerm):
        def residual(self, at: uv.Points) -> np.ndarray:
            return residual(at)

    Mistaken.about = about
    with pytest.raises(TypeError, match=rf"^mpc\.terms\[0\]: .*{why}"):
        with_terms("girona500_ideal", Mistaken())


# Offset cost --------------------------------------------------------------------------------------


COST = OffsetCost(slope=60.0, width=0.01)


def test_the_quadratic_touches_the_cost_and_is_never_below_it(derivative):
    rng = np.random.default_rng(0)
    for size in (0.0, 1e-3, 0.1, 3.0):
        e = size * rng.normal(size=3)
        H, g = COST.quadratic(e)
        for b in 0.3 * rng.normal(size=(50, 3)):
            model = COST.value(e) + g @ b + 0.5 * b @ H @ b
            assert COST.value(e + b) <= model + 1e-12
        slopes = [derivative(lambda s, d=d, e=e: COST.value(e + s * d), 1e-5) for d in np.eye(3)]
        np.testing.assert_allclose(g, slopes, rtol=1e-6, atol=1e-7)
        assert np.linalg.norm(g) <= COST.slope


def test_against_a_gradient_its_minimum_moves_as_derived():
    """The minimum of V_o(e) − fᵀe, found by its own majorants."""
    for pull in (6.0, 30.0, 54.0):
        f, e = pull * np.array([0.6, 0.0, 0.8]), np.zeros(3)
        for _ in range(2000):
            H, g = COST.quadratic(e)
            e = e + np.linalg.solve(H, f - g)
        assert np.linalg.norm(e) == pytest.approx(
            COST.width * pull / np.sqrt(COST.slope**2 - pull**2), rel=1e-6)
