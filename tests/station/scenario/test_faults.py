"""Effects of faults: declared here, in a scenario's `faults`, and checked.

========================================  ==========================================================
fault                                     declared behaviour
========================================  ==========================================================
a solve fails or is late, at random       The last plan, continued by the terminal controller, takes
samples, for seconds or for ever          its place. Inside the theory: no exit. `mpc_status` is 1
                                          or 2 at the samples where it happened.
the first solve fails                     There is no plan to fall back to: one line, at t = 0.
a control period is dropped               The last plan goes on by itself, where it ends by the
                                          terminal controller. Inside the theory: no exit, and the
                                          next plan starts where it is then. `mpc_status` is 3.
the measured state is not a number        Outside: the command is the plan's own, without feedback,
for 0.5 s                                 and `state_lost` says when. Finite; no command exceeds
                                          `limits.u`; back in the tube when the fault is over.
the measured state is not a number at     Bad input, one line: there would be no first plan.
t = 0
the measured state is frozen for 0.5 s    Outside: the monitor notes an exit, with its time. Finite;
                                          no command exceeds `limits.u`, and `input_limited` says
                                          when they cut it; back in the tube when the fault is over.
the measured force is not a number        Outside: the law goes on with the last one that was,
for 0.5 s, or frozen, cut, 5 N off: `force_last_valid`. Finite; no command exceeds `limits.u`; back
                                          at the task when the fault is over. Without anything that
                                          measures the force: bad input, one line. (See
                                          `test_felt_force`.)
‖d‖ = 1.5, 2, 5 times d̃                   Outside: ‖d‖ > d̃ is noted at the sample at which it is
                                          first. The tube is proportional to d̃, so the deviation
                                          stays within as many times the trajectory-wise bound.
a wall 10 times as stiff as modelled      Outside: an exit is noted when contact is made. Finite.
a joint is stuck                          Outside: an exit is noted after it sticks. Finite; no
                                          command exceeds `limits.u`.
========================================  ==========================================================

The monitor, the logs and the adversary see the true state. What is outside of the theory voids the
certificate. Nothing ends in a traceback, and no number in a log is not finite.
"""

import logging
from dataclasses import replace

import numpy as np
import pytest
from support.laws import PAPER

import uvms_drake as uv
from uvms_drake.actuation.joint_brake import StuckJoint
from uvms_drake.certificate.assumptions import assumed_conditions
from uvms_drake.certificate.certificate import fingerprint
from uvms_drake.command.main import main
from uvms_drake.common.alarm import LOGGER
from uvms_drake.common.schema import check_values
from uvms_drake.control.feedback.tube_monitor import FIELDS, TUBE_REPORT
from uvms_drake.control.mpc.planner import DROPPED, FAILED, SOLVED, TIMED_OUT
from uvms_drake.control.mpc.solver_faults import (
    DroppedPeriod,
    SolverFailure,
    SolverTimeout,
    solver_fault,
)
from uvms_drake.control.ocp import scp
from uvms_drake.plant.disturbance import ExcessDisturbance
from uvms_drake.report.events import events
from uvms_drake.sensing.faults import FrozenState, LostState
from uvms_drake.station.scenario.scenario import dump_scenario

CLOSE = "start.eta=[-1.13, -0.05, -0.05, 0.02, 0.02, 0.05]"
"""The tip starts 4 cm off the wall and touches it within a second."""
PERIOD = 0.02
"""Of the log and of the monitor [s]."""
STEP = 0.2
"""Of the MPC [s]."""


def scenario_of(duration: float, *faults, overrides=()):
    scenario = uv.load_scenario("girona500_ideal", [
        f"duration={duration}", f"log_period={PERIOD}", CLOSE, *overrides])
    scenario = replace(scenario, faults=list(faults))
    check_values(scenario)
    return scenario


def run(scenario):
    """Returns the record and the monitor's report of a run; every number in the logs is finite."""
    record = uv.simulate(scenario)
    for name in ("state", "nominal_state", "u", "tau", "force", "tube_deviation", "tube_bound",
                 "disturbance", "mpc_cost", "mpc_status", "state_lost"):
        assert np.all(np.isfinite(getattr(record, name))), name
    return record, dict(zip(TUBE_REPORT, record.tube_report, strict=True))


@pytest.fixture
def said(caplog):
    """Returns what has been said of a run while it went on."""
    caplog.set_level(logging.WARNING, LOGGER.name)
    return lambda: caplog.messages


def ends_at_the_task(record) -> bool:
    error = record.force[-1] - np.asarray(record.scenario.task.force)
    return bool(np.linalg.norm(error) < record.scenario.task.force_tolerance)


def assert_tube_kept(record, report) -> None:
    assert report["set_exits"] == report["trajectory_exits"] == 0.0
    assert ends_at_the_task(record)


def assert_no_command_exceeds_the_limits(record) -> None:
    assert np.all(np.abs(record.u) <= record.scenario.limits.u)


# Faults of the solver ----------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize(("kind", "status", "which"), [
    (SolverFailure, FAILED, "at random"), (SolverFailure, FAILED, "for ever"),
    (SolverTimeout, TIMED_OUT, "for 2 s")])
def test_without_a_new_plan_the_tube_is_kept_and_it_is_in_the_log(kind, status, which):
    fault, samples = {
        "at random": (kind(probability=0.4), None),
        "for 2 s": (kind(start=0.6, duration=2.0), range(3, 13)),
        "for ever": (kind(), range(1, 100))}[which]
    record, report = run(scenario_of(4.0, fault))
    count = np.arange(len(record.mpc_status))
    if samples is None:
        expected = [solver_fault([fault], record.scenario.seed, int(k), STEP) for k in count]
    else:
        expected = np.where(np.isin(count, samples), status, SOLVED)
    expected[0] = SOLVED  # The first plan is exempt.
    np.testing.assert_array_equal(record.mpc_status, expected)
    assert 4 < np.count_nonzero(record.mpc_status == status) == np.count_nonzero(expected)
    assert not np.any(record.state_lost)
    assert_tube_kept(record, report)


@pytest.mark.long
def test_a_late_plan_is_as_good_as_none():
    failed, late = (run(scenario_of(1.0, kind(start=0.4)))[0]
                    for kind in (SolverFailure, SolverTimeout))
    np.testing.assert_array_equal(failed.state, late.state)
    assert not np.array_equal(failed.nominal_state, run(scenario_of(1.0))[0].nominal_state)


@pytest.mark.long
def test_random_faults_are_the_same_in_every_run_of_a_seed():
    seeds = [replace(scenario_of(1.2, DroppedPeriod(probability=0.5)), seed=s) for s in (3, 3, 4)]
    first, again, other = (uv.simulate(scenario).mpc_status for scenario in seeds)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_without_a_first_plan_it_is_one_line(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(scp, "solve_staged", lambda program: None)
    output = tmp_path / "out"
    assert main(["run", "girona500_ideal", "--uncertified", "--duration", "0.1", "--output",
                 str(output), "--set", "simulator.max_step_size=0.005"]) == 1
    err = capsys.readouterr().err
    assert "no solution at the start" in err
    assert "Traceback" not in err
    assert not output.exists()


@pytest.mark.long
@pytest.mark.parametrize(("fault", "dropped"), [
    (DroppedPeriod(start=1.0, duration=0.6), {5, 6, 7}),
    (DroppedPeriod(), set(range(1, 100)))])
def test_a_dropped_control_period_keeps_the_tube(fault, dropped):
    """The horizon is 3 s: with all of them dropped, the plan comes to its end."""
    record, report = run(scenario_of(4.0, fault))
    count = np.arange(len(record.mpc_status))
    np.testing.assert_array_equal(
        record.mpc_status, np.where(np.isin(count, list(dropped)), DROPPED, SOLVED))
    np.testing.assert_allclose(record.mpc_time, STEP * count, atol=1e-9)
    assert_tube_kept(record, report)


@pytest.mark.long
def test_a_deadline_throws_plans_away_that_take_longer():
    """The first plan is exempt."""
    record, report = run(scenario_of(4.0, overrides=["mpc.deadline=1e-9"]))
    np.testing.assert_array_equal(record.mpc_status[:1], SOLVED)
    np.testing.assert_array_equal(record.mpc_status[1:], TIMED_OUT)
    assert_tube_kept(record, report)


# Faults of the measurement -----------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("law", ["Resolved {k: 20, sigma: 5}", "Transpose {k: 20, sigma: 1}"])
def test_without_a_measurement_the_command_is_the_plans_own(law):
    start = 0.5
    record = uv.simulate(scenario_of(
        1.5, LostState(start=start), overrides=[PAPER, f"ancillary=!{law}"]))
    lost = (record.time > start - 1e-9) & (record.time < start + 0.5 - 1e-9)
    np.testing.assert_array_equal(record.state_lost, lost)
    assert np.count_nonzero(lost) == 25
    feedback = np.max(np.abs(record.u - record.nominal_input), axis=1)
    assert np.max(feedback[lost]) < 1e-9
    assert np.min(feedback[~lost & (record.time > 0.1)]) > 1e-4


@pytest.mark.long
def test_a_lost_measurement_is_overcome():
    start = 0.5
    record, report = run(scenario_of(4.0, LostState(start=start)))
    assert start < report["set_first_exit"] < start + 0.5
    deviation = record.deviation_of("position")
    assert np.all(deviation[record.time > start + 2.0] < record.scenario.tube.position)
    assert_no_command_exceeds_the_limits(record)
    assert ends_at_the_task(record)


@pytest.mark.long
def test_plans_from_the_measured_state_go_on_from_the_nominal_one_without_it():
    record, _ = run(scenario_of(
        2.0, LostState(start=0.5), overrides=["mpc.initial_state=measured"]))
    np.testing.assert_array_equal(record.mpc_status, SOLVED)
    to_real = np.linalg.norm(record.state - record.nominal_state, axis=1)
    after = {k: to_real[round(k * STEP / PERIOD) + 1] for k in (2, 3, 4, 5)}
    gained = record.scenario.disturbance.bound * PERIOD  # since a plan from the measured state
    assert max(after[2], after[5]) < gained < min(after[3], after[4])


def test_without_a_measurement_at_the_start_it_is_one_line():
    at_once = replace(scenario_of(1.0), faults=[LostState(start=0.0)])
    with pytest.raises(uv.InvalidParameter, match=r"^faults\[0\]\.start = 0\.0: must be positive$"):
        uv.simulate(at_once)


@pytest.mark.long
def test_a_lost_measurement_starts_when_there_is_a_plan_if_its_start_is_left_out():
    scenario = uv.load_scenario("girona500_ideal", ["duration=1.2", "faults=[!LostState {}]"])
    record, _ = run(scenario)
    np.testing.assert_array_equal(record.state_lost, record.time > 1.0 - 1e-9)


@pytest.mark.long
def test_a_frozen_measurement_is_noted_and_overcome(said):
    start = 0.5
    record, report = run(scenario_of(4.0, FrozenState(start=start)))
    assert start < report["set_first_exit"] < start + 0.5
    left = next(event for event in events(record) if event.kind == "tube_left")
    assert left.start == report["set_first_exit"]
    assert left.end is not None
    assert f"t = {left.start:g} s: left the tube (set-wise)" in said()
    deviation = record.deviation_of("position")
    assert np.max(deviation) > 3.0 * record.scenario.tube.position
    assert np.all(deviation[record.time > start + 2.5] < record.scenario.tube.position)
    assert_no_command_exceeds_the_limits(record)
    limited = [event for event in events(record) if event.kind == "input_limited"]
    assert start < limited[0].start < start + 0.5
    assert limited[-1].end is not None
    assert not np.any(record.state_lost)
    assert ends_at_the_task(record)


# Faults of disturbance, wall and arm -------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("factor", [1.5, 5.0])
def test_a_disturbance_above_its_bound_is_noted_and_takes_the_tube_along(factor):
    record, report = run(scenario_of(3.0, ExcessDisturbance(factor=factor)))
    above = np.linalg.norm(record.disturbance, axis=1) > 1.01 * record.scenario.disturbance.bound
    assert report["disturbance_exits"] >= 1.0
    assert report["disturbance_first_exit"] == pytest.approx(
        record.time[np.argmax(above)], abs=PERIOD)
    exceeded = next(event for event in events(record) if event.kind == "disturbance_exceeded")
    assert exceeded.start == report["disturbance_first_exit"]
    assert report["worst_disturbance"] == pytest.approx(factor, rel=0.01)
    ratios = [report[f"worst_trajectory_{field}"] for field in FIELDS[:4]]
    assert 0.5 * factor < max(ratios) < 1.02 * factor
    if factor == 5.0:
        assert report["set_first_exit"] < np.inf


@pytest.mark.long
def test_an_adversary_above_its_bound_is_noted_too():
    record, report = run(scenario_of(
        1.0, ExcessDisturbance(factor=1.5),
        overrides=["disturbance=!AdversarialDisturbance {bound: 0.1}"]))
    assert report["worst_disturbance"] == pytest.approx(1.5, rel=0.01)
    assert record.scenario.disturbance.bound == 0.1


@pytest.mark.long
def test_a_wall_that_is_stiffer_than_modelled_is_noted():
    record, report = run(scenario_of(4.0, overrides=["surface_error.stiffness=10"]))
    contact = record.time[np.argmax(record.penetration > 0.0)]
    assert contact > 0.2
    assert contact <= report["set_first_exit"] < contact + 0.5
    assert np.max(record.force[:, 0]) < 400.0
    assert np.ptp(record.force[record.time > 3.0, 0]) < 20.0  # It has come to rest.


@pytest.mark.long
@pytest.mark.parametrize("joint", [0, 2])
def test_a_stuck_joint_is_noted(joint):
    start = 0.4
    record, report = run(scenario_of(4.0, StuckJoint(joint=joint, start=start)))
    q = record.state[:, 6 + joint]
    assert np.ptp(q[record.time > start + 0.5]) < 0.02
    assert start < report["set_first_exit"] < np.inf
    assert_no_command_exceeds_the_limits(record)
    assert np.max(np.abs(record.state)) < 10.0


# Scenario and certificate ------------------------------------------------------------------------


EVERY = [SolverFailure(0.25, 1.0, 2.0), SolverTimeout(0.5, 3.0), DroppedPeriod(1e-3),
         FrozenState(0.5, 1.0), LostState(1e3), StuckJoint(2, 0.1), ExcessDisturbance(1.5)]


def test_faults_go_through_a_file_and_back(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(dump_scenario(replace(uv.load_scenario("girona500_ideal"), faults=EVERY)))
    again = uv.load_scenario(str(path), ["seed=1"])
    assert again.faults == EVERY


def test_the_certificate_is_void_only_with_faults_that_the_proofs_do_not_cover():
    scenario = scenario_of(1.0)
    for fault in EVERY:
        covered = isinstance(fault, SolverFailure | SolverTimeout | DroppedPeriod)
        with_it = replace(scenario, faults=[fault])
        broken = [item.name for item in assumed_conditions(with_it) if not item.holds]
        assert broken == ([] if covered else ["faults, which the proofs do not cover"])
        assert (fingerprint(with_it) == fingerprint(scenario)) == covered
    with_deadline = scenario_of(1.0, overrides=["mpc.deadline=0.1"])
    assert fingerprint(with_deadline) == fingerprint(scenario)
