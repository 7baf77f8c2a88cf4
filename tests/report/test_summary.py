"""Tests of `uvms_drake.report.summary`."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from support.missions import mission_record
from support.probability import made
from support.snapshot import check_snapshot
from support.synthetic import desiring, synthetic_record, synthetic_sensed_record

import uvms_drake as uv
from uvms_drake.actuation import Thrusters
from uvms_drake.certificate.run_verdict import broken
from uvms_drake.control.feedback.tube_monitor import FIELDS, TUBE_REPORT
from uvms_drake.control.limits import TubeRadii
from uvms_drake.control.limits.pose import Joints
from uvms_drake.control.mpc.planner import FAILED, KEPT
from uvms_drake.control.mpc.solver_faults import SolverFailure
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.plant.surface import SurfaceError
from uvms_drake.report import signals
from uvms_drake.report.metrics import relative_margins
from uvms_drake.report.summary import (
    format_summary,
    summarise_claim,
)


def reporting(**values):
    """Returns a record whose monitor reports these values, and its usual ones for the rest."""
    record = synthetic_record(2.0)
    report = record.tube_report.copy()
    for name, value in values.items():
        report[TUBE_REPORT.index(name)] = value
    return replace(record, tube_report=report)


def pressing(force_x, **changes):
    """Returns a record of 1 s steps with this normal force [N] and no other."""
    force = np.zeros((len(force_x), 6))
    force[:, 0] = force_x
    base = synthetic_record()
    short = {name: getattr(base, name)[: len(force_x)] for name in (
        "state", "nominal_state", "nominal_input", "chi", "chi_nominal", "u", "tau", "disturbance",
        "effective_disturbance", "desired_force", "penetration", "tube_deviation", "tube_bound")}
    return replace(base, time=np.arange(float(len(force_x))), force=force, **short, **changes)


def test_the_keys_are_the_stored_ones_and_valid_json():
    summary = uv.summarise(synthetic_record())
    text = json.dumps(summary, allow_nan=False, indent=1)
    assert json.loads(text) == summary
    check_snapshot("summary_keys", "\n".join(re.findall(r'^ *"\w+":', text, re.MULTILINE)))


def test_a_certified_run_fails_by_a_cut_a_missing_plan_and_any_certified_row():
    """Of the rows that the monitor does not watch; a fault that was declared is none."""
    record = synthetic_record(4.0, certified=np.array(True))
    kept = uv.summarise(record)
    assert not {"the command, cut", "the MPC, without a plan"} & set(broken(kept))
    cut = uv.summarise(replace(record, input_limited=np.ones_like(record.input_limited)))
    assert set(broken(cut)) - set(broken(kept)) == {"the command, cut"}
    status = record.mpc_status.copy()
    status[3] = FAILED
    failed = uv.summarise(replace(record, mpc_status=status))
    assert set(broken(failed)) - set(broken(kept)) == {"the MPC, without a plan"}
    declared = replace(record.scenario, faults=[SolverFailure(
        start=3.0 * record.scenario.mpc.time_step, duration=0.05)])
    known = uv.summarise(replace(record, mpc_status=status, scenario=declared))
    assert "the MPC, without a plan" not in broken(known)
    speed = record.zeta.copy()
    speed[-1, 0] += 10.0
    fast = uv.summarise(replace(record, state=np.hstack([record.config, speed])))
    assert "the tube, nu1" in broken(fast) and "the tube, nu1" not in broken(kept)
    declared = uv.summarise(replace(
        record, state=np.hstack([record.config, speed]), certified=np.array(False)))
    assert "the declared tube (nu1)" in broken(declared)
    none = replace(record.scenario, tube=TubeRadii())
    assert not uv.summarise(replace(
        record, scenario=none, certified=np.array(False)))["tube"]["left"]


@pytest.mark.parametrize("ahead", [0, 1])
def test_a_plan_in_advance_is_compared_with_the_fault_of_the_sample_before(ahead):
    record = synthetic_record(4.0)
    status = record.mpc_status.copy()
    status[[3 + ahead, 8]] = FAILED
    scenario = replace(record.scenario, mpc=replace(record.scenario.mpc, in_advance=bool(ahead)),
                       faults=[SolverFailure(
                           start=3.0 * record.scenario.mpc.time_step, duration=0.05)])
    found = uv.summarise(replace(record, mpc_status=status, scenario=scenario))["mpc"]
    assert (found["failures"], found["own_failures"]) == (2, 1)


def test_a_joint_without_limits_has_no_constraint(monkeypatch):
    lower, upper = np.array([-0.52, -0.14, -0.9, -3.1]), np.array([1.46, 1.3114, 0.73, np.inf])
    monkeypatch.setattr(signals, "limits_of", lambda *_: {"q": Joints(lower, upper)})
    record = synthetic_record()
    constraints = uv.summarise(record)["constraints"]
    assert "q4_max" not in constraints
    assert "q4_min" in constraints


def test_forces_are_constraints_only_if_they_are_limited():
    record = synthetic_record()
    tau = np.zeros_like(record.tau)
    tau[5, 0], tau[6, 9] = -130.0, 0.5
    limits = replace(record.scenario.limits, tau=np.array([120.0] * 9 + [2.0]))
    limited = replace(record, tau=tau, scenario=replace(record.scenario, limits=limits))
    constraints = uv.summarise(limited)["constraints"]
    inputs = [name for name in constraints if name.startswith("u_")]
    assert list(constraints) == [*uv.summarise(record)["constraints"],
                                 *(name.replace("u_", "tau_") for name in inputs)]
    assert constraints["tau_surge"] == {"limit": 120.0, "worst": 130.0, "margin": -10.0,
                                        "unit": "N"}
    assert constraints["tau_q4"] == {"limit": 2.0, "worst": 0.5, "margin": 1.5,
                                     "unit": "N m"}


def test_the_force_that_is_limited_is_that_of_the_pose_on_the_surface_that_is_known():
    """15 mm deep with 1000 N/m, less half of the transition, whatever the real surface is like."""
    chi = np.zeros((len(synthetic_record().time), 6))
    chi[3, 0] = 0.015
    record = replace(synthetic_record(), chi=chi)
    force = uv.summarise(record)["constraints"]["static_force"]
    assert force == {"limit": 45.0, "worst": pytest.approx(14.0), "margin": pytest.approx(31.0),
                     "unit": "N"}
    stiff = replace(record.scenario, surface_error=SurfaceError(stiffness=2.0))
    assert uv.summarise(replace(record, scenario=stiff))["constraints"]["static_force"] == force
    free = replace(record.scenario, limits=replace(record.scenario.limits, static_force=None))
    assert "static_force" not in uv.summarise(replace(record, scenario=free))["constraints"]


def test_task_errors_go_the_short_way_around():
    record = synthetic_record()
    chi = np.tile([0.0, 0.0, 0.0, 3.1, 0.0, -3.1], (len(record.time), 1))
    task = uv.summarise(replace(
        record, chi=chi, chi_des=np.array([1.0, 0.0, 0.0, -3.1, 0.0, 3.1])))["task_error"]
    np.testing.assert_allclose(task["final"], [-1.0, 0, 0, 6.2 - 2 * np.pi, 0, 2 * np.pi - 6.2])
    assert task["final_norm"] == pytest.approx(np.linalg.norm(task["final"]))


def test_the_worst_deviations_are_those_that_the_monitor_logged():
    record = synthetic_record()
    logged = np.zeros_like(record.tube_deviation)
    logged[100] = np.arange(1.0, 7.0)
    tube = uv.summarise(replace(record, tube_deviation=logged))["tube"]
    assert (tube["worst_e"], tube["worst_z"]) == (1.0 + FIELDS.index("task"),
                                                 1.0 + FIELDS.index("z"))
    assert (tube["bound_e"], tube["bound_z"]) == (0.006, 0.04)


def test_the_disturbance_is_measured_by_its_norm():
    record = synthetic_record()
    d = np.zeros_like(record.disturbance)
    d[7, [0, 9]] = [0.03, -0.04]
    disturbance = uv.summarise(replace(record, disturbance=d, effective_disturbance=3.0 * d))
    assert disturbance["disturbance"] == {
        "unit": "m/s², rad/s²", "bound": 0.1, "worst": pytest.approx(0.15),
        "semi_axes": None, "applied": pytest.approx(0.05), "exceeded": 1}


def test_with_weights_the_disturbance_is_measured_by_the_bounds_of_its_components():
    """0.03 m/s² of a hull of a tenth, which is too much, and 0.04 rad/s² of a joint of all of d̃."""
    record = synthetic_record()
    scenario = replace(record.scenario, disturbance=replace(
        record.scenario.disturbance, bound=1.0, weights=np.repeat([0.01, 0.1], [6, 4])))
    d = np.zeros_like(record.disturbance)
    d[7, 0], d[9, 9] = 0.03, -0.04
    summary = uv.summarise(replace(
        record, scenario=scenario, disturbance=d, effective_disturbance=2.0 * d))
    assert summary["disturbance"] == {
        "unit": "m/s², rad/s²", "bound": pytest.approx(0.1), "worst": pytest.approx(0.6),
        "semi_axes": pytest.approx(np.repeat([0.01, 0.1], [6, 4])),
        "applied": pytest.approx(0.3), "exceeded": 1}
    (event,) = [each for each in summary["events"] if each["kind"] == "disturbance_exceeded"]
    assert event["time_s"] == pytest.approx(record.time[7])
    assert event["text"] == "whole disturbance above its bound of 0.1, at most 0.6"


@pytest.mark.parametrize(("above", "times"), [
    ([], 0), ([0], 1), ([0, 1, 2, 50], 2), ([40, 42, 100], 3), (range(101), 1)])
def test_separate_times_above_the_bound_are_counted(above, times):
    record = synthetic_record(2.0)
    d = np.zeros_like(record.effective_disturbance)
    d[:, 0] = 0.1 * (1.0 + 1e-9)  # Rounding is no excess.
    d[list(above), 0] = 0.1001
    summary = uv.summarise(replace(record, effective_disturbance=d))
    assert summary["disturbance"]["exceeded"] == times


def test_contact_is_told_by_touch_losses_and_static_force_on_the_real_surface():
    """The wall of the record yields 1000 N/m past a transition of 2 mm; the real one is shifted."""
    record = pressing([0.0, 19.0, 0.0, 20.5, 20.0, 0.0])
    chi = record.chi.copy()
    chi[:, 0] = [-0.1, 0.020, -0.1, 0.0215, 0.021, 0.0]
    depth = np.maximum(chi[:, 0], 0.0)
    force = record.force.copy()
    force[5, 0] = 20.0  # Settled from the third second on.
    record = replace(record, chi=chi, penetration=depth, force=force)
    contact = uv.summarise(record)["contact"]
    assert contact == {"first_touch_s": 1.0, "losses": 1, "largest_force": 20.5,
                       "largest_static_force": pytest.approx(20.5)}
    moved = replace(record.scenario, surface_error=SurfaceError(shift=np.array([0.01, 0.0, 0.0])))
    assert uv.summarise(replace(record, scenario=moved))["contact"]["largest_static_force"] \
        == pytest.approx(10.5)


def test_a_claim_in_probability_names_walls_that_are_not_declared():
    record, seen = synthetic_record(2.0), {"mission": {}, "contact": {
        "out_of_class": {"friction": {"specified": 0.5, "observed": 0.61}}}}
    claim = summarise_claim(record, made((1, 2)), seen)
    assert (claim["failures"], claim["runs"], claim["confidence"]) == (2, 60, 0.95)
    assert claim["outside"] == [
        "contact.friction was seen to be 0.61, declared up to 0.5"]
    assert summarise_claim(record, None, seen) is None
    # One that was stopped is no draw, but one is whose mission was over before.
    early = replace(record, declared_duration=np.array(9.0))
    assert summarise_claim(early, made((1, 2)), {"mission": {}, "contact": {}})["outside"] == [
        "stopped at 2 s of 9 s"]
    done = {"mission": {"over_s": 1.0}, "contact": {}}
    assert summarise_claim(early, made((1, 2)), done)["outside"] == []


def test_the_summary_has_each_thrusters_forces_and_limits():
    """Forces of a sine of 80 N; the third thruster is at its limit in a quarter of the time."""
    base = synthetic_record(4.0)
    wave = np.sin(np.pi * base.time)[:, None] * np.ones(5)
    command = 0.5 * wave
    command[:, 2] = np.where(base.time < 1.0, 1.0, 0.0)
    record = replace(base, scenario=replace(base.scenario, actuation=[Thrusters()]), signals={
        "thruster_command": command, "thruster_force": 80.0 * wave})
    rows = uv.summarise(record)["thrusters"]
    assert list(rows) == ["surge_port", "surge_starboard", "heave_bow", "heave_stern", "sway"]
    row = rows["heave_bow"]
    assert (row["least"], row["largest"]) == pytest.approx((-80.0, 80.0), rel=1e-2)
    assert row["rms"] == pytest.approx(80.0 / np.sqrt(2.0), rel=1e-2)
    assert (row["lower"], row["upper"]) == (-95.122, 104.659)
    assert row["at_limit"] == pytest.approx(0.25, abs=0.01)
    assert rows["sway"]["at_limit"] == 0.0
    assert uv.summarise(base)["thrusters"] == {}


@pytest.mark.parametrize(("force_x", "expected"), [
    ([0.0, 19.0, 25.0, 21.5, 19.5, 20.5], {
        "settling_time_s": 3.0, "worst_error_norm_after_settling": 1.5,
        "worst_normal_error_after_settling": 1.5, "final_error_norm": 0.5, "peak_normal": 25.0,
        "overshoot": {"newton": 5.0, "percent": 25.0}}),
    ([0.0, 20.0, 30.0], {
        "settling_time_s": None, "worst_error_norm_after_settling": None,
        "overshoot": {"newton": 10.0, "percent": 50.0}, "final": [30.0, 0, 0, 0, 0, 0]}),
    ([0.0, 10.0], {"overshoot": {"newton": 0.0, "percent": 0.0}}),
    ([99.0, 20.0, 20.0, 20.0, 20.0, 20.0, 26.0], {"last_5_s": {
        "mean_error_norm": 1.0, "worst_normal_error": 6.0, "worst_tangential_error": 0.0}})])
def test_a_force_settles_once_it_stays_and_is_averaged_at_the_end(force_x, expected):
    force = uv.summarise(pressing(force_x))["force"]
    assert {key: force[key] for key in expected} == expected


@pytest.mark.parametrize(("signal", "channel", "excess", "name", "unit"), [
    ("u", 0, -0.5, "u_surge", "m/s²"), ("u", 5, -0.5, "u_yaw", "rad/s²"),
    ("u", 9, -0.5, "u_q4", "rad/s²"), ("state", 3, -0.125, "roll", "rad"),
    ("state", 4, -0.125, "pitch", "rad"), ("state", 6, -0.1, "q1_min", "rad")])
def test_limits_hold_on_both_sides(signal, channel, excess, name, unit):
    record = synthetic_record()
    values, limits = getattr(record, signal).copy(), record.scenario.limits
    limit = (record.joint_lower[0] if name == "q1_min" else
             limits.u[channel] if signal == "u" else getattr(limits, name))
    values[100, channel] = (limit if name == "q1_min" else -limit) + excess
    row = uv.summarise(replace(record, **{signal: values}))["constraints"][name]
    worst = limit + (excess if name == "q1_min" else -excess)
    assert row == {"limit": limit, "worst": pytest.approx(worst), "margin": pytest.approx(excess),
                   "unit": unit}


def test_exits_and_ratios_are_those_of_the_monitor():
    tube = uv.summarise(reporting(
        set_exits=2.0, set_first_exit=0.75, trajectory_exits=3.0, disturbance_exits=4.0,
        worst_set_orientation=0.7, worst_trajectory_z=0.9, worst_set_r=5.0, worst_set_task=0.8,
        worst_trajectory_r=5.0))["tube"]
    assert (tube["exits"], tube["exits_along_the_run"], tube["disturbance_excesses"]) == (2, 3, 4)
    assert tube["first_exit_s"] == 0.75
    assert tube["worst_ratio"] == {"set": 0.8, "trajectory": 0.9}
    record = synthetic_record()
    unbounded = replace(record, tube_bound=np.full_like(record.tube_bound, np.inf))
    assert uv.summarise(unbounded)["tube"]["worst_ratio"] == {"set": 0.4, "trajectory": None}


def test_outcomes_of_the_solver_are_counted():
    record = synthetic_record()
    status, violation = np.zeros((2, len(record.mpc_status)))
    status[[3, 4]], status[7], status[[8, 9, 11]], status[[12, 14]] = 1.0, 2.0, 3.0, KEPT
    violation[7] = 3e-5
    mpc = uv.summarise(replace(record, mpc_status=status, mpc_violation=violation))["mpc"]
    assert {key: mpc[key] for key in ("solves", "failures", "late", "dropped", "fallbacks",
                                      "kept")} == {
        "solves": len(status) - 3, "failures": 2, "late": 1, "dropped": 3, "fallbacks": 3,
        "kept": 2}
    assert mpc["worst_violation"] == 3e-5
    assert mpc["worst_terminal_slack"] == pytest.approx(0.3)


def test_without_a_bound_no_disturbance_exceeds_it_and_without_a_monitor_no_deviation_is_known():
    record = synthetic_record()
    base = record.scenario
    free = replace(record, certified=np.array(False),
                   scenario=replace(base, disturbance=replace(base.disturbance, bound=0.0)),
                   effective_disturbance=record.effective_disturbance + 0.05)
    summary = uv.summarise(free)
    assert summary["disturbance"]["exceeded"] is None
    assert not [each for each in summary["events"] if each["kind"] == "disturbance_exceeded"]
    assert uv.summarise(replace(free, certified=np.array(True)))["disturbance"]["exceeded"] == 1
    hovering = replace(base, mpc=replace(base.mpc, hover=99.0))
    tube = uv.summarise(replace(record, scenario=hovering, certified=np.array(False)))["tube"]
    assert tube["worst_e"] is tube["worst_z"] is None


# The table.


def runs():
    """Returns the runs of the stored table, by name."""
    record = synthetic_record()
    time, base = record.time, record.scenario
    empty = dict.fromkeys(("mpc_time", "mpc_status", "mpc_terminal_slack", "mpc_violation",
                           "mpc_refused", "mpc_rows", "step_seconds"), np.zeros(0))
    status = np.arange(len(record.mpc_status)) % 5.0
    u, force, d = record.u.copy(), record.force.copy(), np.zeros_like(record.disturbance)
    u[0, 0], force[:, 1:3], d[::20] = 9.0, [3.0, 4.0], 1.0
    weighted = ConstantDisturbance(bound=0.05, weights=np.repeat([1.0, 3.0], [6, 4]))
    wave = 80.0 * np.sin(np.pi * time)[:, None] * np.ones(5)
    return {
        "as planned": record, "certified": replace(record, certified=np.array(True)),
        "a mission": mission_record(),
        "tangential force, a violated limit": replace(record, u=u, force=force),
        "exits": reporting(set_exits=2.0, set_first_exit=0.75, trajectory_exits=3.0),
        "failures of the solver": replace(record, mpc_status=status),
        "more events than lines": replace(record, effective_disturbance=d),
        "a weighted disturbance": replace(record, scenario=replace(base, disturbance=weighted)),
        "no bound": replace(record, scenario=replace(
            base, disturbance=replace(base.disturbance, bound=0.0))),
        "hovering": replace(record, scenario=replace(base, mpc=replace(base.mpc, hover=99.0))),
        "thrusters": replace(record, scenario=replace(base, actuation=[Thrusters()]), signals={
            "thruster_command": wave / 160.0, "thruster_force": wave}),
        "never settled, no samples": pressing([0.0, 0.0], wall_time_s=0.0, **empty),
        "never touched": replace(record, force=0.0 * force, penetration=0.0 * time),
        "no force desired": desiring([0] * 6, record),
        "torque": desiring([0, 0, 0, 0, 1, 0], record),
        "force and torque": desiring([20, 0, 0, 0, 1, 0], record),
        "no events": synthetic_record(1.0)}


def test_the_table_of_each_kind_of_run_is_the_stored_one():
    lines = []
    for name, record in runs().items():
        summary = uv.summarise(record)
        verdict = summary["verdict"]
        lines += [f"=== {name}", format_summary(summary, full=True), "--- in short",
                  format_summary(summary), f"{verdict['status']}: {verdict['text']}"]
    check_snapshot("summary", "\n".join(lines))


def test_the_overview_is_a_screen_and_has_the_tightest_limits_those_broken_first():
    records = runs()
    for record in records.values():
        summary = uv.summarise(record)
        text = format_summary(summary)
        assert text.startswith(f"{summary['scenario']}: {summary['verdict']['text']}\n")
        lines = text.splitlines()
        assert len(lines) <= 40 and "\n\n\n" not in text
        (head,) = (i for i, line in enumerate(lines) if line.startswith("tightest"))
        names = [line.split()[0] for line in lines[head + 1: head + 6]]
        margins = relative_margins(summary["constraints"])
        assert [margins[name] for name in names] == sorted(margins.values())[:5]
        assert any(line.startswith("events") for line in lines)
    violated = uv.summarise(records["tangential force, a violated limit"])
    assert re.search(r"^tightest .*\nu_surge .* VIOLATED$", format_summary(violated), re.M)


def test_the_size_of_a_limit_is_its_range_or_its_bound():
    rows = {name: {"limit": limit, "margin": 0.1} for name, limit in (
        ("q1_min", -0.5), ("q1_max", 1.5), ("q2_min", -0.4), ("nu1", 0.2), ("contact.force", 45.0))}
    assert relative_margins(rows) == pytest.approx({
        "q1_min": 0.05, "q1_max": 0.05, "q2_min": 0.25, "nu1": 0.5, "contact.force": 0.1 / 45.0})


def test_the_angle_of_the_tool_is_an_angle():
    record = synthetic_sensed_record(2.0)
    row = uv.summarise(record)["constraints"]["tool_angle"]
    x_E = rotation_matrix(record.chi[:, 3:])[..., 0]
    direction = record.scenario.contact.direction
    assert row["worst"] == pytest.approx(np.max(np.arccos(np.clip(x_E @ direction, -1.0, 1.0))))
    assert (row["limit"], row["unit"]) == (pytest.approx(record.scenario.contact.tool_angle), "rad")


def test_the_table_has_the_numbers_of_the_summary_and_begins_with_the_verdict():
    record = runs()["tangential force, a violated limit"]
    summary = uv.summarise(record)
    text = format_summary(summary, full=True)
    force = summary["force"]
    assert text.splitlines()[0] == (
        "girona500_ideal: LIMITS VIOLATED: u_surge (without a certificate)")
    assert f"normal error {abs(force['final_error_normal']):.3g} N at the end" in text
    assert "tangential error 5 N at the end, at most 5 N in the last 5 s" in text
    chi = record.chi.copy()
    chi[[0, -1]] = record.chi_des + np.outer([0.1, 0.001], [3.0, 0.0, 4.0, 1.0, 0.0, 0.0])
    moved = format_summary(uv.summarise(replace(record, chi=chi)), full=True)
    assert "end-effector  off by 5 mm and 1 mrad at the end\n" in moved
    assert " off by 500 mm and 100 mrad at the start\n" in moved
