"""Tests of `uvms_drake.control.mpc.nominal_mpc`, in a Diagram of its own with a constant state."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from support.limits import with_limits
from support.tracking import DIRECTION, POSITION, at_rest, tracking_ocp

import uvms_drake as uv
from uvms_drake.control.mpc.nominal_mpc import NominalMpc
from uvms_drake.control.mpc.planner import (
    DROPPED,
    FAILED,
    HOVERED,
    KEPT,
    MPC_REPORT,
    SOLVED,
    TIMED_OUT,
    Planner,
    Sample,
    Targets,
)
from uvms_drake.control.ocp.ocp import FEASIBLE
from uvms_drake.control.ocp.scp import SequentialConvexSolver, Solution
from uvms_drake.control.ocp.tracking_ocp import TrackingOcp, TrackingTarget
from uvms_drake.loop.planner_process import PlannerProcess, begun_again

H = 0.2  # s


class FailingSolver:
    """Solves as the real one does, but for the calls whose numbers are in `failures`."""

    def __init__(self, ocp, failures=()):
        self.ocp = ocp
        self.calls = 0
        self._real = SequentialConvexSolver(ocp)
        self._failures = failures

    def solve(self, guess, iterations):
        self.calls += 1
        if self.calls - 1 in self._failures:
            return Solution(None, None, iterations, converged=False)
        return self._real.solve(guess, iterations)

    def of(self, ocp):
        """Returns itself: the problems of these tests do not differ."""
        return self


class AlteringSolver(FailingSolver):
    """Says of the plans that it finds, but for the first ones, what is given."""

    def __init__(self, ocp, exempt: int = 0, **said: float):
        super().__init__(ocp)
        self._exempt, self._said = exempt, said

    def solve(self, guess, iterations):
        solution = super().solve(guess, iterations)
        return solution if self.calls <= self._exempt else replace(
            solution, evaluation=replace(solution.evaluation, **self._said))


class Setup:
    """A planner alone, with a measured state that does not follow the plan."""

    def __init__(self, solver, state: np.ndarray, iterations: int = 2, targets=None, committed=0,
                 undriven=(), **given):
        solver.ocp = copy.copy(solver.ocp)
        solver.ocp.iterations = iterations
        builder = DiagramBuilder()
        self.source = builder.AddNamedSystem("measurement", ConstantVectorSource(state))
        self.mpc = NominalMpc.AddToBuilder(
            builder, solver, targets=targets, committed=committed, undriven=undriven,
            state=self.source.get_output_port())
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.ocp = solver.ocp
        self.give(**given)

    def go(self, time: float) -> None:
        self.simulator.AdvanceTo(time)

    def read(self, name: str, context=None):
        context = context or self.simulator.get_context()
        return self.mpc.GetOutputPort(name).Eval(self.mpc.GetMyContextFromRoot(context))

    def report(self) -> dict[str, float]:
        return dict(zip(MPC_REPORT, self.read("report"), strict=True))

    def give(self, **given) -> None:
        """Sets input ports from now on."""
        context = self.mpc.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        for name, value in given.items():
            self.mpc.GetInputPort(name).FixValue(context, np.atleast_1d(value))

    def jump(self, state: np.ndarray) -> None:
        context = self.source.GetMyMutableContextFromRoot(
            self.simulator.get_mutable_context())
        self.source.get_mutable_source_value(context).set_value(state)


@pytest.fixture
def start(start_plans) -> np.ndarray:
    """A measured state (𝔮, ζ) 0.05 m off the wall, in motion."""
    guess = start_plans["before"][0]
    return np.concatenate([guess.config[0], guess.zeta[0]])


def test_the_first_plan_is_converged_and_later_ones_take_the_iterations_asked_for(
        short_ocp, start):
    solver = SequentialConvexSolver(short_ocp)
    setup = Setup(solver, start, iterations=1)
    setup.simulator.Initialize()
    guess = short_ocp.resting_plan(0.0, start)
    expected = solver.solve(guess, 100)
    assert setup.report()["cost"] == pytest.approx(expected.evaluation.cost, rel=1e-6)
    setup.go(H + 0.01)
    expected = solver.solve(short_ocp.continued(expected.plan), 1)
    assert setup.report()["iterations"] == 1
    np.testing.assert_allclose(setup.read("plan").zeta_dot, expected.plan.zeta_dot, atol=1e-9)


def test_every_plan_starts_where_the_last_one_went_wherever_the_robot_is(short_ocp, start):
    """The tube is about the nominal trajectory: a jump of the measurement does not matter."""
    followed = []
    for offset in (0.0, 0.1):
        setup = Setup(SequentialConvexSolver(short_ocp), start)
        setup.go(0.05)
        setup.jump(start + offset)
        plan = setup.read("plan")
        for k in range(1, 5):
            setup.go(k * H + 1e-6)
            predicted = np.concatenate(plan.at(k * H)[:2])
            plan = setup.read("plan")
            np.testing.assert_allclose(
                np.concatenate([plan.config[0], plan.zeta[0]]), predicted, atol=1e-12)
        followed.append(setup.read("nominal_state"))
    np.testing.assert_array_equal(followed[0], followed[1])
    assert np.linalg.norm(followed[0] - start) > 0.02, "the plan does go somewhere"


def test_between_samples_the_outputs_are_a_motion_under_the_nominal_input(short_ocp, start):
    """ζ̄̇ = f(𝔮̄, ζ̄) + ū, and the nominal state moves by 𝔮̄̇ = Γζ̄ and ζ̄̇; nothing is held."""
    setup = Setup(SequentialConvexSolver(short_ocp), start)
    states, times = [], 0.5 + np.array([-1e-3, 0.0, 1e-3])
    for time in times:
        setup.go(time)
        states.append(setup.read("nominal_state"))
        if time == 0.5:
            zeta_dot, u = setup.read("nominal_acceleration"), setup.read("nominal_input")
    config, zeta = np.split(states[1], 2)
    f = short_ocp.model.drift(config, zeta)
    np.testing.assert_allclose(f + u, zeta_dot, rtol=1e-9, atol=1e-12)
    rate = (states[2] - states[0]) / 2e-3
    np.testing.assert_allclose(rate[:10], uv.configuration_rate(config, zeta), atol=1e-6)
    np.testing.assert_allclose(rate[10:], zeta_dot, atol=1e-9)
    assert np.linalg.norm(zeta_dot) > 0.01


@pytest.mark.parametrize(("slack", "status"), [(10.0 * FEASIBLE, KEPT), (0.1 * FEASIBLE, SOLVED)])
def test_a_plan_that_is_kept_because_it_is_sounder_is_no_failure(
        short_ocp, caplog, slack, status):
    """It is within the terminal set and the new one, which may cost less, is not."""
    at_rest = np.concatenate([short_ocp.model.configuration(short_ocp.y_des), np.zeros(10)])
    solver = AlteringSolver(short_ocp, exempt=1, terminal_slack=slack)
    setup = Setup(solver, at_rest)
    setup.simulator.Initialize()
    plan = setup.read("plan")
    assert short_ocp.evaluate(plan).terminal_slack == 0.0
    for k in (1, 2, 3):
        setup.go((k + 0.5) * H)
        plan = short_ocp.continued(plan)
        report = setup.report()
        assert report["status"] == status
        assert report["iterations"] > 0.0
        if status == KEPT:
            np.testing.assert_array_equal(setup.read("plan").zeta_dot, plan.zeta_dot)
            assert report["terminal_slack"] == short_ocp.evaluate(plan).terminal_slack
    assert solver.calls == 4
    assert not caplog.records


def test_a_dropped_sample_leaves_plan_and_report_and_the_next_one_starts_where_it_went(
        short_ocp, start):
    solver = FailingSolver(short_ocp)
    setup = Setup(solver, start)
    setup.go(1.5 * H)
    plan, report = setup.read("plan"), setup.report()
    setup.give(fault=DROPPED)
    for k in (2, 3):
        setup.go((k + 0.5) * H)
        assert setup.read("plan").start_time == plan.start_time
        np.testing.assert_array_equal(setup.read("plan").zeta_dot, plan.zeta_dot)
        np.testing.assert_array_equal(
            setup.read("nominal_state"), np.concatenate(plan.at((k + 0.5) * H)[:2]))
        now = setup.report()
        assert (now["status"], now["time"]) == (DROPPED, pytest.approx(k * H))
        assert {**now, "status": 0.0, "time": report["time"]} == report
    assert solver.calls == 2
    setup.give(fault=SOLVED)
    setup.go(4.5 * H)
    assert (setup.report()["status"], solver.calls) == (SOLVED, 3)
    np.testing.assert_allclose(
        setup.read("plan").start, np.concatenate(plan.at(4 * H)[:2]), atol=1e-12)


@pytest.mark.parametrize(("cause", "status", "calls"), [
    ("solver", FAILED, 5), ("deadline", TIMED_OUT, 3), (FAILED, FAILED, 1),
    (TIMED_OUT, TIMED_OUT, 1)])
def test_without_a_new_plan_the_last_one_is_continued_and_no_new_force_accepted(
        short_ocp, start, cause, status, calls):
    """The first plan is exempt; the next one that is made recovers, and takes the force."""
    force, other = np.full(6, 20.0), np.full(6, 21.0)
    solver = FailingSolver(  # At each sample: to the new force, and to the old one.
        short_ocp, {1, 2, 3, 4} if cause == "solver" else ())
    setup = Setup(solver, start, targets=Targets(force, lambda force: copy.copy(short_ocp)),
                  desired_force=other)
    if cause == "deadline":
        setup.ocp.deadline = 1e-9
    elif cause != "solver":
        setup.give(fault=cause)
    setup.simulator.Initialize()
    assert setup.report()["status"] == SOLVED
    plan = setup.read("plan")
    for k in (1, 2):
        setup.go((k + 0.5) * H)
        plan = short_ocp.continued(plan)
        taken, report, evaluation = setup.read("plan"), setup.report(), short_ocp.evaluate(plan)
        for name in ("config", "zeta", "zeta_dot"):
            np.testing.assert_array_equal(getattr(taken, name), getattr(plan, name))
        assert (report["status"], report["refused"]) == (status, 1.0)
        assert report["time"] == pytest.approx(k * H)
        assert (report["cost"], report["violation"]) == (evaluation.cost, evaluation.violation)
        np.testing.assert_array_equal(setup.read("accepted_force"), force)
    assert solver.calls == calls
    setup.ocp.deadline = None
    setup.give(fault=SOLVED)
    setup.go(3.5 * H)
    report = setup.report()
    assert (report["status"], report["refused"]) == (SOLVED, 0.0)
    assert report["cost"] <= short_ocp.evaluate(short_ocp.continued(plan)).merit
    np.testing.assert_array_equal(setup.read("accepted_force"), other)


def test_a_plan_from_the_measured_state_starts_at_the_nominal_one_while_it_is_lost(
        short_ocp, start):
    ocp = copy.copy(short_ocp)
    ocp.starts_at_measured = True
    setup = Setup(SequentialConvexSolver(ocp), start)
    setup.go(0.5 * H)
    plan = setup.read("plan")
    setup.jump(np.full_like(start, np.nan))
    setup.go(1.5 * H)
    assert setup.report()["status"] == SOLVED
    np.testing.assert_allclose(
        setup.read("plan").start, np.concatenate(plan.at(H)[:2]), atol=1e-12)
    setup.jump(start)
    setup.go(2.5 * H)
    np.testing.assert_array_equal(setup.read("plan").start, start)


@pytest.mark.parametrize("violation", [None, 1.01 * FEASIBLE, 1.0])
def test_without_a_first_plan_within_the_limits_the_run_fails_with_one_line(
        short_ocp, start, violation):
    setup = Setup(FailingSolver(short_ocp, {0}) if violation is None else AlteringSolver(
        short_ocp, violation=violation), start)
    with pytest.raises(uv.RunFailed, match=r"no solution at the start") as caught:
        setup.simulator.Initialize()
    assert "\n" not in str(caught.value)


def test_a_start_from_where_the_limits_cannot_be_kept_is_refused(short_ocp, start):
    """The solver returns a plan, for it softens limits; it is not followed."""
    weak = with_limits(short_ocp, u=1e-3 * short_ocp.limits["u"].upper)
    solver = FailingSolver(weak)
    with pytest.raises(uv.RunFailed, match=r"at rest, limits\.u_q2 is exceeded"):
        Setup(solver, start).simulator.Initialize()
    assert solver.calls == 1


@pytest.mark.parametrize("in_advance", [False, True])
def test_a_cloned_context_continues_identically(short_ocp, start, in_advance):
    """All that changes in time is in the Context, at a sampling instant and between two."""
    for pause in (0.5, 2 * H, *([H] * in_advance)):
        solver = FailingSolver(short_ocp)
        setup = Setup(solver, start, committed=int(in_advance))
        setup.ocp.in_advance = in_advance
        setup.go(pause)
        clone = setup.simulator.get_context().Clone()
        at_pause = solver.calls
        setup.go(1.1)
        at_end = solver.calls
        other = Simulator(setup.diagram, clone)
        other.Initialize()
        other.AdvanceTo(1.1)
        for port in ("nominal_state", "nominal_input", "report"):
            np.testing.assert_array_equal(
                setup.read(port, other.get_context()), setup.read(port))
        assert solver.calls - at_end == at_end - at_pause >= 3


def test_previewed_forces_are_those_of_the_later_plan(short_ocp, start):
    """Of every plan, also after a sample that failed or was dropped; the first one coasts there."""
    n, delay = 2, 7  # Intervals, and quarters of them.
    setup = Setup(FailingSolver(short_ocp), start, committed=n)
    asked, later, came = [], [], []
    for step in range(36):
        setup.give(fault={2: FAILED, 4: DROPPED}.get((step + 2) // 4, SOLVED))
        setup.go((0.25 * step + 0.125) * H)
        time, plan = setup.simulator.get_context().get_time(), setup.read("plan")
        assert len(plan.zeta_dot) == n + short_ocp.horizon
        for many, quarters in ((asked, delay), (later, delay + 4)):
            many.append(np.concatenate(plan.at(time + 0.25 * quarters * H)))
        came.append(np.append(setup.read("nominal_state"), setup.read("nominal_acceleration")))
    asked, later, came = map(np.array, (asked, later, came))
    np.testing.assert_allclose(came[delay:], asked[:-delay], rtol=0.0, atol=1e-12)
    assert np.max(np.abs(came[delay + 4:] - later[: -delay - 4])) > 1e-3  # That is free.
    coasting = slice(4 * n)
    np.testing.assert_array_equal(came[coasting, 10:], np.tile(np.pad(start[10:], (0, 10)), (8, 1)))
    assert setup.report()["violation"] < 1e-4


def test_before_its_first_instant_has_passed_the_first_plan_can_be_made_anew(short_ocp, start):
    setup = Setup(SequentialConvexSolver(short_ocp), start)
    setup.simulator.Initialize()
    moved = start + 0.001
    setup.jump(moved)
    setup.simulator.Initialize()
    np.testing.assert_array_equal(setup.read("nominal_state"), moved)
    setup.go(0.05)
    followed = setup.read("nominal_state")
    setup.jump(start)
    setup.simulator.Initialize()
    np.testing.assert_array_equal(setup.read("nominal_state"), followed)


def test_a_context_whose_time_was_set_to_another_starts_again(short_ocp, start):
    """Back to the start, or further on than its plan goes without another sample."""
    for time in (0.0, 4 * H):
        setup = Setup(SequentialConvexSolver(short_ocp), start)
        setup.go(1.5 * H)
        assert np.linalg.norm(setup.read("nominal_state") - start) > 1e-3
        setup.simulator.get_mutable_context().SetTime(time)
        setup.simulator.Initialize()
        np.testing.assert_array_equal(setup.read("nominal_state"), start)
        assert setup.read("plan").start_time == time
        assert setup.report()["time"] == time


def test_it_hovers_until_it_is_to_begin_and_then_plans_as_at_a_start(short_ocp, start):
    """At the place measured first, whatever is measured then, and with the same plan."""
    at_rest = start * np.repeat([1.0, 0.0], 10)
    hovering, plain = FailingSolver(short_ocp), FailingSolver(short_ocp)
    setup = Setup(hovering, at_rest)
    setup.ocp.hover = 2.0 * H - 0.5 * H  # That is from the second sample on.
    setup.go(0.5 * H)
    setup.jump(at_rest + 0.001)
    setup.give(fault=FAILED)
    setup.go(1.5 * H)
    np.testing.assert_array_equal(setup.read("nominal_state"), at_rest)
    np.testing.assert_array_equal(setup.read("nominal_acceleration"), np.zeros(10))
    assert setup.report() == {**dict.fromkeys(MPC_REPORT, 0.0), "time": H, "status": HOVERED}
    assert hovering.calls == 0
    setup.give(fault=SOLVED)
    setup.go(3.5 * H)
    other = Setup(plain, at_rest)
    other.simulator.get_mutable_context().SetTime(2.0 * H)
    other.go(3.5 * H)
    assert hovering.calls == plain.calls == 2
    assert setup.report() == other.report()
    np.testing.assert_array_equal(setup.read("nominal_state"), other.read("nominal_state"))


def test_what_nothing_drives_hovers_where_the_task_has_it(short_ocp, start):
    """Not where it swings to; the tip is kept."""
    at_rest = start * np.repeat([1.0, 0.0], 10)
    at_rest[3] += 0.05
    setup = Setup(FailingSolver(short_ocp), at_rest, undriven=[3])
    setup.ocp.hover = 2.0 * H
    setup.go(0.5 * H)
    config, model = setup.read("nominal_state")[:10], setup.ocp.model
    assert config[3] == pytest.approx(model.configuration(setup.ocp.y_des)[3], abs=1e-12)
    np.testing.assert_array_equal(config[4:], at_rest[4:10])
    np.testing.assert_allclose(
        model.task_pose(config)[:3], model.task_pose(at_rest[:10])[:3], atol=1e-12)
    assert np.linalg.norm(config[:3] - at_rest[:3]) > 1e-3


class Late:
    """Computer whose plan comes as soon as it is asked for, however long that takes."""

    def __init__(self, planner):
        self.planner, self.begun = planner, None

    def start(self, sample, memory):
        self.begun = sample, memory

    def result(self):
        begun, self.begun = self.begun, None
        return begun and self.planner.again(*begun)


def test_a_plan_from_before_a_retreat_is_not_taken_after_it(short_ocp, start):
    """The computer is not asked meanwhile; its next plan begins where the robot rested."""
    at_rest = start * np.repeat([1.0, 0.0], 10)
    setup = Setup(FailingSolver(short_ocp), at_rest, committed=1)
    setup.ocp.in_advance = True
    setup.mpc.computer = Late(setup.mpc.planner)
    setup.give(retreat=np.zeros(22))
    setup.go(1.5 * H)
    away = at_rest - np.append(0.05, np.zeros(19))
    setup.jump(away)
    setup.give(retreat=np.append(1.0, np.zeros(21)))
    setup.go(2.5 * H)
    np.testing.assert_array_equal(setup.read("nominal_state"), away)
    setup.give(retreat=np.zeros(22))
    setup.go(3.5 * H)
    np.testing.assert_allclose(setup.read("nominal_state"), away, atol=1e-9)
    setup.go(4.0 * H)
    before = setup.read("nominal_state")
    setup.go(4.01 * H)
    assert setup.report()["status"] == SOLVED  # The plan of 3 H has come.
    assert np.max(np.abs(setup.read("nominal_state") - before)[:10]) < 0.002


def test_a_plan_begins_at_its_sample_however_often_it_was_continued(short_ocp, start):
    """After half an hour the sum of as many intervals is off by more than a knot may be."""
    planner = Planner(FailingSolver(short_ocp))
    memory = planner.first(Sample(0.0, 0.0, {}, measured=start))
    assert memory.plan.start_time == 0.0
    drifted = replace(memory, plan=replace(memory.plan, start_time=4e-10))
    now = Sample(H, 0.0, {})
    for later in (planner.again(now, drifted), planner.between(now, drifted)):
        assert later.plan.start_time == H
        later.plan.at(H)


def hovering(short_ocp, state):
    """Returns a planner of plans in advance that hovers until H, and its memory at the start."""
    ocp = copy.copy(short_ocp)
    ocp.hover, ocp.in_advance = H, True
    planner = Planner(FailingSolver(ocp), committed=1)
    return planner, planner.first(Sample(0.0, 0.0, {}, measured=state))


def test_a_rest_without_a_first_plan_goes_on_however_often_that_fails(short_ocp, start):
    """As after a retreat to where no plan begins: a later one may not start from a rest of no plan.

    It is a failed sample each time, and as soon as there is a plan it is a first one.
    """
    at_rest = start * np.repeat([1.0, 0.0], 10)
    solver = FailingSolver(short_ocp, failures=[1, 2, 3])
    setup = Setup(solver, at_rest, committed=1)
    setup.give(retreat=np.zeros(22))
    setup.go(0.5 * H)
    setup.give(retreat=np.append(1.0, np.zeros(21)))
    setup.go(1.5 * H)
    setup.give(retreat=np.zeros(22))
    for k in (2, 3, 4):
        setup.go((k + 0.5) * H)
        np.testing.assert_array_equal(setup.read("nominal_state"), at_rest)
        assert (setup.report()["status"], setup.report()["time"]) == (FAILED, k * H)
    setup.go(5.5 * H)
    assert setup.report()["status"] == SOLVED and solver.calls == 5
    assert setup.report()["terminal_slack"] <= 1e-6


@pytest.mark.parametrize("samples", [3, 40])
def test_a_rest_stays_one_while_its_first_plan_is_computed(short_ocp, start, samples):
    """However long: after the horizon the plan would otherwise be the terminal controller's."""
    at_rest = start * np.repeat([1.0, 0.0], 10)
    planner, memory = hovering(short_ocp, at_rest)
    for k in range(1, samples):
        now = Sample(k * H, 0.0, {})
        memory = planner.between(now, planner.taken(now, memory))
        assert memory.at_rest
        np.testing.assert_array_equal(
            np.concatenate(memory.plan.at((k + 0.5) * H)), np.append(at_rest, np.zeros(10)))
    late = planner.again(Sample(H, 0.0, {}), hovering(short_ocp, at_rest)[1])
    assert begun_again(late, Sample(samples * H, 0.0, {}), memory) is not None


def test_samples_that_are_passed_over_for_hours_leave_the_plan_on_its_grid(short_ocp, start):
    planner = Planner(FailingSolver(short_ocp))
    memory = planner.first(Sample(0.0, 0.0, {}, measured=start))
    for k in range(1, 5000):
        memory = planner.pass_over(Sample(k * H, 0.0, {}), memory, DROPPED)
    steps = memory.plan.start_time / H
    assert abs(steps - round(steps)) < 1e-10


def test_a_first_plan_that_is_late_is_begun_again_where_the_robot_still_rests(short_ocp, start):
    """Computed once more it would be as late again."""
    at_rest = start * np.repeat([1.0, 0.0], 10)
    planner, rests = hovering(short_ocp, at_rest)
    late = planner.again(Sample(H, 0.0, {}), rests)
    assert (rests.report[1], late.report[1]) == (HOVERED, SOLVED)
    now = Sample(3.0 * H, 0.0, {})
    begun = begun_again(late, now, planner.between(now, rests))
    np.testing.assert_array_equal(begun.plan.at(3.5 * H), late.plan.at(1.5 * H))
    next_one = planner.between(now, rests)
    taken = planner.taken(Sample(4.0 * H, 0.0, {}), replace(next_one, coming=begun))
    assert taken.report[1] == SOLVED and taken.plan.start_time == 3.0 * H
    elsewhere = planner.resting(now, rests, at_rest + 0.01)
    assert begun_again(late, now, elsewhere) is None
    assert begun_again(rests, now, rests) is None and begun_again(late, now, late) is None


class Pipe:
    """A pipe whose other end answers when it is told to."""

    def __init__(self):
        self.sent, self.answer = [], None

    def send(self, message):
        self.sent.append(message)

    def poll(self, wait=0.0):
        return self.answer is not None

    def recv(self):
        answer, self.answer = self.answer, None
        return answer


def test_a_process_that_is_late_with_the_first_plan_is_not_asked_for_it_again(short_ocp, start):
    planner, rests = hovering(short_ocp, start * np.repeat([1.0, 0.0], 10))
    process = PlannerProcess.__new__(PlannerProcess)
    process._pipe, process.trouble, process._at_work = Pipe(), "", False
    process._is_overdue, process._wait, process._from_rest = False, 0.0, None
    process.start(Sample(H, 0.0, {}), rests)
    assert process.result() is None
    process.start(Sample(2.0 * H, 0.0, {}), rests)
    assert process.result() is None and len(process._pipe.sent) == 1
    process._pipe.answer = planner.again(*process._pipe.sent[0])
    process.start(Sample(3.0 * H, 0.0, {}), rests)
    plan = process.result().plan
    assert plan.start_time == 3.0 * H and len(process._pipe.sent) == 1
    process.start(Sample(4.0 * H, 0.0, {}), process.result())
    assert len(process._pipe.sent) == 2 and process.result() is None


def test_after_hovering_a_problem_that_starts_where_it_is_measured_does_so(short_ocp, start):
    setup = Setup(FailingSolver(short_ocp), start * np.repeat([1.0, 0.0], 10))
    setup.ocp.hover, setup.ocp.starts_at_measured = H, True
    setup.go(0.5 * H)
    setup.jump(start)
    setup.go(1.5 * H)
    np.testing.assert_array_equal(setup.read("plan").start, start)


def test_it_does_not_start_between_two_sampling_instants(short_ocp, start):
    setup = Setup(SequentialConvexSolver(short_ocp), start)
    setup.simulator.get_mutable_context().SetTime(0.3)
    with pytest.raises(uv.RunFailed, match=r"starts at t = 0\.3 s: must be a multiple .* 0\.2 s$"):
        setup.simulator.Initialize()


@pytest.mark.parametrize("asked", [99.0, np.nan])
def test_why_a_force_is_refused_is_said_once(short_ocp, start, caplog, asked):
    def problem(force: np.ndarray):
        raise uv.InvalidParameter("force", float(force[0]), "smaller")

    setup = Setup(SequentialConvexSolver(short_ocp), start, targets=Targets(
        np.full(6, 20.0), problem))
    setup.give(desired_force=np.full(6, asked))
    setup.go(3.5 * H)
    assert setup.report()["refused"] == 1.0
    (said,) = [record.getMessage() for record in caplog.records]
    assert said.endswith(f"the desired force is refused: force = {asked}: must be smaller")


# A problem whose target is an input ---------------------------------------------------------------


@pytest.fixture(scope="module")
def tracking() -> TrackingOcp:
    return tracking_ocp(overrides=("mpc.horizon=3",))


def resting(tracking: TrackingOcp, **given) -> Setup:
    """Returns a planner with an aim, whose robot stays in its posture."""
    return Setup(SequentialConvexSolver(tracking), at_rest(tracking, POSITION), **given)


def test_without_an_aim_it_stays_at_the_reference(tracking):
    loop = resting(tracking)
    loop.go(2.5 * H)
    assert loop.report()["cost"] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(
        loop.read("nominal_state"), at_rest(tracking, POSITION), atol=1e-9)


def test_every_plan_is_that_of_the_problem_for_what_is_given_at_the_sample(tracking):
    """From the last plan continued, with the iterations of a sample."""
    loop = resting(tracking, target=POSITION + 0.1, safe_depth=POSITION[0] + 0.05)
    loop.simulator.Initialize()
    plan = loop.read("plan")
    for k, (target, depth) in enumerate([
            (POSITION - 0.1, 0.05), (POSITION + 0.3, 0.05), (POSITION + 0.3, 0.1)], start=1):
        aim = TrackingTarget(target, POSITION[0] + depth)
        loop.give(target=target, safe_depth=aim.safe_depth)
        loop.go((k + 0.5) * H)
        problem = tracking.aimed(aim)
        expected = SequentialConvexSolver(problem).solve(problem.continued(plan), 2)
        plan, report = loop.read("plan"), loop.report()
        np.testing.assert_array_equal(plan.zeta_dot, expected.plan.zeta_dot)
        np.testing.assert_array_equal(plan.a, expected.plan.a)
        assert report["status"] == SOLVED
        assert report["cost"] == expected.evaluation.cost
        assert max(report["violation"], report["terminal_slack"]) <= 1e-6


def test_a_target_that_is_no_number_fails_the_sample_and_nothing_else(tracking):
    loop = resting(tracking, target=POSITION + 0.1, safe_depth=POSITION[0] + 0.05)
    loop.go(1.5 * H)
    plan = loop.read("plan")
    loop.give(target=np.full(3, np.nan))
    loop.go(2.5 * H)
    assert loop.report()["status"] == FAILED
    np.testing.assert_array_equal(loop.read("plan").zeta_dot, tracking.continued(plan).zeta_dot)
    np.testing.assert_array_equal(loop.read("plan").a, plan.a)
    loop.give(target=POSITION)
    loop.go(3.5 * H)
    assert loop.report()["status"] == SOLVED


def test_a_start_whose_plan_cannot_end_in_the_set_is_refused(tracking):
    """The proof begins with a plan that does: here the arm is too far from its posture."""
    start = at_rest(tracking, POSITION)
    start[6:10] += 0.4 * (tracking.limits["q"].upper - start[6:10])
    start[3:5] = 0.0
    with pytest.raises(uv.RunFailed, match=r"at the start, t = 0 s: .*out of the reach"):
        Setup(SequentialConvexSolver(tracking), start, target=POSITION).simulator.Initialize()


def test_a_start_beyond_the_safe_region_is_refused(tracking):
    with pytest.raises(uv.RunFailed, match=r"at rest, limits\.safe_depth is exceeded by 0\.1"):
        resting(tracking, target=POSITION,
                safe_depth=POSITION @ DIRECTION - 0.1).simulator.Initialize()
