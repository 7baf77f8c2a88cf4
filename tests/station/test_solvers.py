"""Solvers of the MPC by name: the same optimum and closed loop, and errors for bad names."""

import numpy as np
import pytest
from pydrake.solvers import SnoptSolver, SolverOptions
from support.runs import simulated

import uvms_drake as uv
from uvms_drake.command.main import main
from uvms_drake.control.convex.staged_solver import DrakeConvexSolver
from uvms_drake.control.mpc.planner import KEPT, SOLVED
from uvms_drake.control.ocp.ocp import SOLVERS, Ocp
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.control.ocp.solvers import CONVEX, NONLINEAR, NonlinearSolver
from uvms_drake.control.plan.plan import Plan

NEAR = ("surface.geometry.point.0=-0.25",)
"""The unknown wall 5 cm from the tip."""


# Names --------------------------------------------------------------------------------------------


def test_every_name_has_a_solver_or_says_why_not(short_ocp):
    assert set(SOLVERS) == {"structured", *CONVEX, *NONLINEAR}
    made = {}
    for name in SOLVERS:
        try:
            made[name] = uv.make_solver(short_ocp, name)
        except uv.InvalidParameter as error:
            assert str(error).startswith(f"solver = '{name}': must be ")
            assert "\n" not in str(error)
    assert {"structured", "clarabel", "scs", "snopt", "ipopt"} <= set(made)
    assert type(made["clarabel"]) is type(made["structured"]) is SequentialConvexSolver
    assert type(made["snopt"]) is NonlinearSolver
    assert all(solver.ocp is short_ocp for solver in made.values())


def test_a_solver_for_linear_constraints_is_for_a_problem_without_norms(short_ocp):
    with pytest.raises(uv.InvalidParameter, match=r"able to solve the problem.*LorentzCone"):
        uv.make_solver(short_ocp, "osqp")
    scenario = uv.load_scenario("girona500_ideal", ["mpc.horizon=5", "mpc.terminal_set=false"])
    ocp = uv.make_ocp(scenario)
    ocp.limits = {name: limit for name, limit in ocp.limits.items()
                  if name not in ("nu1", "nu2", "qdot")}
    config = ocp.model.configuration(ocp.y_des - 0.05 * np.eye(10)[0])
    guess = ocp.resting_plan(0.0, np.concatenate([config, np.zeros(10)]))
    one, other = (uv.make_solver(ocp, name).solve(guess, 1) for name in ("structured", "osqp"))
    assert other.evaluation.cost == pytest.approx(one.evaluation.cost, rel=1e-3)


def test_one_s_own_constraints_need_a_solver_of_the_whole_program(short_ocp):
    with pytest.raises(uv.InvalidParameter, match="one of ipopt, nlopt, snopt"):
        uv.make_solver(short_ocp, "structured", extend=print)


def test_a_nonlinear_solver_starts_from_the_plan_of_another(short_ocp):
    """A program has several local optima; a run is to stay at those of `structured`."""
    asked = []

    class First(SequentialConvexSolver):
        def of(self, ocp):
            return First(ocp)

        def solve(self, guess, iterations, tolerance=1e-6):
            asked.append(iterations)
            return super().solve(guess, iterations, tolerance)

    config = short_ocp.model.configuration(short_ocp.y_des - 0.05 * np.eye(10)[0])
    guess = short_ocp.resting_plan(0.0, np.concatenate([config, np.zeros(10)]))
    solver = NonlinearSolver(short_ocp, SnoptSolver(), first=First(short_ocp)).of(short_ocp)
    plan = solver.solve(guess, 7).plan
    assert asked == [7]
    assert solver.solve(short_ocp.continued(plan), 1).converged
    assert asked == [7, 1]
    # With constraints of one's own only a guess that is not sound is left for it.
    own = NonlinearSolver(short_ocp, SnoptSolver(), extend=lambda program: None,
                          first=First(short_ocp))
    assert not short_ocp.is_sound(short_ocp.evaluate(guess))
    plan = own.solve(guess, 7).plan
    assert own.solve(short_ocp.continued(plan), 1).converged
    assert asked == [7, 1, 7]


def test_a_solver_that_does_not_better_the_first_plan_keeps_it(short_ocp):
    """A solver without iterations has no success; alone, it has no plan either."""
    config = short_ocp.model.configuration(short_ocp.y_des - 0.05 * np.eye(10)[0])
    guess = short_ocp.resting_plan(0.0, np.concatenate([config, np.zeros(10)]))
    options = SolverOptions()
    options.SetOption(SnoptSolver.id(), "Major iterations limit", 0)
    first = SequentialConvexSolver(short_ocp)
    kept = NonlinearSolver(short_ocp, SnoptSolver(), options, first=first).solve(guess, 1)
    assert not kept.converged
    assert kept.evaluation.cost == first.solve(guess, 1).evaluation.cost
    assert NonlinearSolver(short_ocp, SnoptSolver(), options).solve(guess).plan is None


@pytest.mark.parametrize(("name", "reason"), [
    ("newton", "must be one of structured, clarabel"), ("osqp", "must be able to solve"),
    ("gurobi", "in this build of Drake")])
def test_a_bad_name_is_one_line(name, reason, capsys, tmp_path):
    code = main(["run", "girona500_ideal", "--uncertified", "--set", f"mpc.solver={name}",
                 "--set", "duration=0.1", "--output", str(tmp_path / "out")])
    out, err = capsys.readouterr()
    assert (code, out) == (2, "")
    (line,) = (line for line in err.splitlines() if line.startswith("uvms-drake: error: "))
    assert f"mpc.solver = '{name}'" in line and reason in line


# Optima -------------------------------------------------------------------------------------------


def met(name: str, overrides: list[str], monkeypatch) -> list[tuple[Ocp, Plan]]:
    """Returns the problems and guesses of all samples of a run after the first."""
    found: list[tuple[Ocp, Plan]] = []
    solve = SequentialConvexSolver.solve

    def recording(self, guess, *args):
        found.append((self.ocp, guess))
        return solve(self, guess, *args)

    with monkeypatch.context() as patch:
        patch.setattr(SequentialConvexSolver, "solve", recording)
        uv.simulate(uv.load_scenario(name, overrides))
    return found[1:]


def same_optimum(ocp: Ocp, guess: Plan, *, cold: bool = True) -> bool:
    """Compares the optimum of the whole problem, and of the convex program about the guess.

    SNOPT starts from the guess if it is `cold`, and else from the optimum, which it may not better:
    it does not come to an end from every guess of an unknown wall. Returns whether it converged.
    """
    found = SequentialConvexSolver(ocp).solve(guess, 300, 1e-12)
    fast = found.evaluation
    whole = NonlinearSolver(ocp, SnoptSolver()).solve(guess if cold else found.plan)
    if whole.converged:
        assert fast.cost == pytest.approx(whole.evaluation.cost, rel=1e-6)
        assert whole.evaluation.violation <= ocp.tolerance
    program = ocp.staged_program(guess)
    structured, clarabel = SequentialConvexSolver(ocp), uv.make_solver(ocp, "clarabel")
    one, other = (solver.solve(guess, 1).evaluation.cost for solver in (structured, clarabel))
    assert one == pytest.approx(other, rel=1e-6)
    assert DrakeConvexSolver(CONVEX["clarabel"]())(program).cone_programs == 1
    return whole.converged


@pytest.mark.long
def test_ten_states_of_a_run_have_the_same_optimum(monkeypatch):
    states = met("girona500_ideal", ["duration=4", "mpc.horizon=6"], monkeypatch)
    assert len(states) > 18
    assert all(same_optimum(ocp, guess) for ocp, guess in states[:20:2])


@pytest.mark.long
@pytest.mark.parametrize(("name", "overrides"), [
    ("girona500_ideal", []), ("girona500_contact", [*NEAR])])
def test_fifty_states_of_two_runs_have_the_same_optimum(name, overrides, monkeypatch):
    states = met(name, ["duration=6", *overrides], monkeypatch)
    converged = [same_optimum(ocp, guess, cold=name == "girona500_ideal")
                 for ocp, guess in states[:25]]
    assert np.count_nonzero(converged) >= 23


# Closed loops -------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("name", "solver", "seconds", "overrides"), [
    ("girona500_ideal", "clarabel", 4.0, ()),
    pytest.param("girona500_ideal", "snopt", 2.6, ("mpc.horizon=5", "mpc.iterations=20"),
                 marks=pytest.mark.long),
    pytest.param("girona500_contact", "clarabel", 3.6, NEAR, marks=pytest.mark.long),
    pytest.param("girona500_ideal", "snopt", 6.0, (), marks=pytest.mark.long),
    pytest.param("girona500_contact", "snopt", 3.6, NEAR, marks=pytest.mark.long)])
def test_the_closed_loop_does_not_depend_on_the_solver(name, solver, seconds, overrides):
    """To 1e-3 of the desired force.

    Where the horizon is short, one iteration a sample is not converged, as a nonlinear solver is.
    """
    one, other = (simulated(name, seconds, f"mpc.solver={each}", *overrides)
                  for each in ("structured", solver))
    desired = np.max(np.abs(one.desired_force))
    assert np.max(np.abs(one.force)) > 0.5 * desired, "it presses"
    assert np.max(np.abs(one.force - other.force)) < 1e-3 * desired
    assert set(np.unique(other.mpc_status)) <= {SOLVED, KEPT}
