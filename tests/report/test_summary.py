"""Tests of `uvms_drake.report.summary`."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support.probability import made
from support.synthetic import desiring, synthetic_record

from uvms_drake.actuation import Thrusters
from uvms_drake.control.feedback.tube_monitor import FIELDS, TUBE_REPORT
from uvms_drake.control.limits.pose import Joints
from uvms_drake.control.mpc.planner import KEPT
from uvms_drake.papers.nikou2018 import Transpose
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.plant.surface import SurfaceError
from uvms_drake.report import signals
from uvms_drake.report.signals import settling_index
from uvms_drake.report.summary import EVENT_LINES, format_summary, summarise, summarise_claim

KEYS = {
    "scenario", "seed", "versions", "duration_s", "wall_time_s", "real_time_factor", "mpc",
    "task_error", "force", "contact", "constraints", "disturbance", "tube", "events"}
CONSTRAINTS = [
    "nu1", "nu2", "qdot", "roll", "pitch", "tip_pitch", "q1_min", "q1_max", "q2_min", "q2_max",
    "q3_min", "q3_max", "q4_min", "q4_max", "static_force", "u_surge", "u_sway", "u_heave",
    "u_roll", "u_pitch", "u_yaw", "u_q1", "u_q2", "u_q3", "u_q4"]
TUBE = {
    "certified", "law", "error", "bound_e", "worst_e", "bound_z", "worst_z", "exits",
    "first_exit_s", "exits_along_the_run", "worst_ratio", "disturbance_excesses"}


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
        "state", "nominal_state", "chi", "chi_nominal", "u", "tau", "disturbance",
        "effective_disturbance", "desired_force", "penetration", "tube_deviation", "tube_bound")}
    return replace(base, time=np.arange(float(len(force_x))), force=force, **short, **changes)


def test_the_fixed_keys_are_there_and_valid_json():
    summary = summarise(synthetic_record())
    assert set(summary) >= KEYS
    assert set(summary["versions"]) == {"uvms_drake", "drake", "python"}
    assert set(summary["mpc"]) == {
        "solves", "failures", "late", "dropped", "fallbacks", "kept", "step_ms", "refused_targets",
        "worst_terminal_slack", "worst_violation"}
    assert set(summary["mpc"]["step_ms"]) == {"p50", "p95", "p99", "max"}
    assert set(summary["task_error"]) >= {"initial", "final", "final_norm"}
    assert set(summary["force"]) >= {
        "desired", "final", "final_error_norm", "worst_error_norm_after_settling",
        "settling_time_s"}
    assert set(summary["tube"]) == TUBE
    assert set(summary["tube"]["worst_ratio"]) == {"set", "trajectory"}
    assert list(summary["constraints"]) == CONSTRAINTS
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary


def test_a_tube_that_nobody_watched_has_no_worst_deviation():
    record = synthetic_record()
    hovering = replace(record.scenario, mpc=replace(record.scenario.mpc, hover=99.0))
    summary = summarise(replace(record, scenario=hovering, certified=np.array(False)))
    assert summary["tube"]["worst_e"] is summary["tube"]["worst_z"] is None
    assert "not watched: the robot hovered until the end" in format_summary(summary)


def test_a_weighted_disturbance_has_its_semi_axes_printed():
    record = synthetic_record()
    weights = np.repeat([1.0, 3.0], [6, 4])
    disturbance = ConstantDisturbance(bound=0.05, weights=weights)
    summary = summarise(replace(record, scenario=replace(
        record.scenario, disturbance=disturbance)))
    assert summary["disturbance"]["semi_axes"] == pytest.approx(0.05 * weights)
    assert "bound 0.15 " in format_summary(summary)
    assert "ellipsoid of semi-axes 0.05, 0.05, " in format_summary(summary)


def test_duration_and_wall_time_give_the_real_time_factor():
    summary = summarise(synthetic_record(wall_time_s=8.0))
    assert (summary["duration_s"], summary["real_time_factor"]) == (20.0, 2.5)


def test_force_settles_at_the_first_time_from_which_it_stays():
    force = summarise(pressing([0.0, 19.0, 25.0, 21.5, 19.5, 20.5]))["force"]
    assert force["settling_time_s"] == 3.0
    assert force["worst_error_norm_after_settling"] == 1.5
    assert force["worst_normal_error_after_settling"] == 1.5
    assert force["final_error_norm"] == 0.5
    assert force["peak_normal"] == 25.0
    assert force["overshoot"] == {"newton": 5.0, "percent": 25.0}


def test_a_force_that_never_settles_has_no_settling_time():
    force = summarise(pressing([0.0, 20.0, 30.0]))["force"]
    assert force["settling_time_s"] is None
    assert force["worst_error_norm_after_settling"] is None
    assert force["overshoot"]["newton"] == 10.0
    assert force["final"] == [30.0, 0.0, 0.0, 0.0, 0.0, 0.0]


def test_the_overshoot_is_not_negative():
    assert summarise(pressing([0.0, 10.0]))["force"]["overshoot"]["newton"] == 0.0


def test_the_last_seconds_are_averaged():
    last = summarise(pressing([99.0, 20.0, 20.0, 20.0, 20.0, 20.0, 26.0]))["force"]["last_5_s"]
    assert last == {"mean_error_norm": 1.0, "worst_normal_error": 6.0,
                    "worst_tangential_error": 0.0}


def test_a_force_of_zero_has_no_direction():
    record = synthetic_record()
    nothing = np.zeros_like(record.desired_force)
    force = summarise(replace(record, desired_force=nothing))["force"]
    assert force["peak_normal"] is None
    assert force["overshoot"]["percent"] is None


@pytest.mark.parametrize(("wrench", "unit"), [
    ([20, 0, 0, 0, 0, 0], "N"), ([0, 0, 0, 0, 1, 0], "N m"), ([20, 0, 0, 0, 1, 0], "N, N m")])
def test_errors_are_in_the_unit_of_what_is_desired(wrench, unit):
    summary = summarise(desiring(wrench, synthetic_record()))
    text = format_summary(summary)
    assert f"{np.linalg.norm(wrench):.4g} {unit} desired, " in text
    force = summary["force"]
    assert (f"error {force['final_error_norm']:.3g} {unit} at the end, "
            f"{force['last_5_s']['mean_error_norm']:.3g} {unit} on average in the last 5 s"
            in text) == (wrench[0] == 0)
    assert (f"normal error {abs(force['final_error_normal']):.3g} N at the end" in text) == (
        wrench[0] > 0)
    assert ("N at its peak" in text) == ("tangential error" in text) == (wrench[0] > 0)


def test_settling_index():
    assert settling_index(np.array([3.0, 1.0, 0.5]), 1.0) == 1
    assert settling_index(np.array([0.0, 0.0]), 1.0) == 0
    assert settling_index(np.array([0.0, 2.0]), 1.0) is None


@pytest.mark.parametrize(("channel", "name"), [(0, "u_surge"), (5, "u_yaw"), (9, "u_q4")])
def test_inputs_are_limited_on_both_sides(channel, name):
    record = synthetic_record()
    u = np.zeros_like(record.u)
    limit = record.scenario.limits.u[channel]
    u[100, channel] = -limit - 0.5
    row = summarise(replace(record, u=u))["constraints"][name]
    assert row == {"limit": limit, "worst": limit + 0.5, "margin": pytest.approx(-0.5),
                   "unit": "m/s²" if name == "u_surge" else "rad/s²"}


def test_velocities_are_limited_by_blocks():
    record = synthetic_record()
    state = record.state.copy()
    state[:, 10:] = 0.0
    state[50, 10:13] = [0.3, 0.0, 0.4]
    state[50, 13:16] = [0.0, 0.0, -0.2]
    constraints = summarise(replace(record, state=state))["constraints"]
    assert constraints["nu1"]["worst"] == pytest.approx(0.5)
    assert constraints["nu1"]["margin"] == pytest.approx(-0.2)
    assert constraints["nu2"]["worst"] == pytest.approx(0.2)
    assert constraints["qdot"]["worst"] == 0.0


def test_joints_have_a_lower_and_an_upper_limit():
    record = synthetic_record()
    state = record.state.copy()
    state[3, 6] = -0.5
    constraints = summarise(replace(record, state=state))["constraints"]
    assert constraints["q1_min"] == {
        "limit": -0.4, "worst": -0.5, "margin": pytest.approx(-0.1), "unit": "rad"}
    assert constraints["q1_max"]["margin"] > 0.0


def test_a_joint_without_limits_has_no_constraint(monkeypatch):
    lower, upper = np.array([-0.52, -0.14, -0.9, -3.1]), np.array([1.46, 1.3114, 0.73, np.inf])
    monkeypatch.setattr(signals, "limits_of", lambda *_: {"q": Joints(lower, upper)})
    record = synthetic_record()
    constraints = summarise(record)["constraints"]
    assert "q4_max" not in constraints
    assert "q4_min" in constraints


@pytest.mark.parametrize(("name", "angle"), [("roll", 3), ("pitch", 4)])
def test_the_attitude_of_the_vehicle_is_limited_on_both_sides(name, angle):
    record = synthetic_record()
    state, limit = record.state.copy(), getattr(record.scenario.limits, name)
    state[70, angle] = -limit - 0.125
    row = summarise(replace(record, state=state))["constraints"][name]
    assert row == {"limit": limit, "worst": limit + 0.125, "margin": pytest.approx(-0.125),
                   "unit": "rad"}


def test_forces_are_constraints_only_if_they_are_limited():
    record = synthetic_record()
    tau = np.zeros_like(record.tau)
    tau[5, 0], tau[6, 9] = -130.0, 0.5
    limits = replace(record.scenario.limits, tau=np.array([120.0] * 9 + [2.0]))
    limited = replace(record, tau=tau, scenario=replace(record.scenario, limits=limits))
    constraints = summarise(limited)["constraints"]
    assert list(constraints) == CONSTRAINTS + [
        name.replace("u_", "tau_") for name in CONSTRAINTS if name.startswith("u_")]
    assert constraints["tau_surge"] == {"limit": 120.0, "worst": 130.0, "margin": -10.0,
                                        "unit": "N"}
    assert constraints["tau_q4"] == {"limit": 2.0, "worst": 0.5, "margin": 1.5,
                                     "unit": "N m"}
    assert "tau_q4" in format_summary(summarise(limited))


def test_the_force_that_is_limited_is_that_of_the_pose_on_the_surface_that_is_known():
    """15 mm deep with 1000 N/m, less half of the transition, whatever the real surface is like."""
    chi = np.zeros((len(synthetic_record().time), 6))
    chi[3, 0] = 0.015
    record = replace(synthetic_record(), chi=chi)
    force = summarise(record)["constraints"]["static_force"]
    assert force == {"limit": 45.0, "worst": pytest.approx(14.0), "margin": pytest.approx(31.0),
                     "unit": "N"}
    stiff = replace(record.scenario, surface_error=SurfaceError(stiffness=2.0))
    assert summarise(replace(record, scenario=stiff))["constraints"]["static_force"] == force
    free = replace(record.scenario, limits=replace(record.scenario.limits, static_force=None))
    assert "static_force" not in summarise(replace(record, scenario=free))["constraints"]


def test_task_errors_go_the_short_way_around():
    record = synthetic_record()
    chi = np.tile([0.0, 0.0, 0.0, 3.1, 0.0, -3.1], (len(record.time), 1))
    task = summarise(replace(
        record, chi=chi, chi_des=np.array([1.0, 0.0, 0.0, -3.1, 0.0, 3.1])))["task_error"]
    np.testing.assert_allclose(task["final"], [-1.0, 0, 0, 6.2 - 2 * np.pi, 0, 2 * np.pi - 6.2])
    assert task["final_norm"] == pytest.approx(np.linalg.norm(task["final"]))


def test_the_worst_deviations_are_those_that_the_monitor_logged():
    record = synthetic_record()
    logged = np.zeros_like(record.tube_deviation)
    logged[100] = np.arange(1.0, 7.0)
    tube = summarise(replace(record, tube_deviation=logged))["tube"]
    assert (tube["worst_e"], tube["worst_z"]) == (1.0 + FIELDS.index("task"),
                                                 1.0 + FIELDS.index("z"))
    assert (tube["bound_e"], tube["bound_z"]) == (0.006, 0.04)


def test_a_run_that_stays_in_the_tube_has_no_exits():
    tube = summarise(synthetic_record())["tube"]
    assert (tube["exits"], tube["exits_along_the_run"], tube["disturbance_excesses"]) == (0, 0, 0)
    assert tube["first_exit_s"] is None
    assert tube["certified"] is False
    assert tube["law"] == "resolved"


def test_exits_are_those_of_the_monitor():
    record = reporting(set_exits=2.0, set_first_exit=0.75, trajectory_exits=3.0,
                       trajectory_first_exit=0.5, disturbance_exits=4.0)
    summary = summarise(record)
    tube = summary["tube"]
    assert (tube["exits"], tube["exits_along_the_run"], tube["disturbance_excesses"]) == (2, 3, 4)
    assert tube["first_exit_s"] == 0.75
    text = format_summary(summary)
    assert "exits: 2 set-wise (first at 0.75 s), 3 along the run" in text
    assert "exits" not in format_summary(summarise(reporting()))


def test_the_worst_ratio_is_that_of_task_position_orientation_joints_and_velocity():
    ratio = summarise(reporting(
        worst_set_orientation=0.7, worst_trajectory_z=0.9, worst_set_r=5.0, worst_set_task=0.8,
        worst_trajectory_r=5.0))["tube"]["worst_ratio"]
    assert ratio == {"set": 0.8, "trajectory": 0.9}


def test_without_a_bound_along_the_run_there_is_no_ratio_to_it():
    record = synthetic_record()
    tube = summarise(replace(record, tube_bound=np.full_like(record.tube_bound, np.inf)))["tube"]
    assert tube["worst_ratio"] == {"set": 0.4, "trajectory": None}


def test_a_certified_run_says_so():
    summary = summarise(synthetic_record(certified=np.array(True)))
    assert summary["tube"]["certified"] is True
    assert "certified     yes" in format_summary(summary)


def test_the_worst_plan_is_reported():
    record = synthetic_record()
    violation = np.zeros_like(record.mpc_violation)
    violation[7] = 3e-5
    summary = summarise(replace(record, mpc_violation=violation))
    assert summary["mpc"]["worst_violation"] == 3e-5
    assert summary["mpc"]["worst_terminal_slack"] == pytest.approx(0.3)
    assert "plans exceed a limit by 3e-05 and the terminal set by 0.3" in format_summary(summary)


def test_failures_of_the_solver_are_counted():
    record = synthetic_record()
    status = np.zeros_like(record.mpc_status)
    status[[3, 4]], status[7], status[[8, 9, 11]] = 1.0, 2.0, 3.0
    summary = summarise(replace(record, mpc_status=status))
    mpc = summary["mpc"]
    assert (mpc["solves"], mpc["failures"], mpc["late"], mpc["dropped"], mpc["fallbacks"]) == (
        len(status) - 3, 2, 1, 3, 3)
    assert "97 solves, 2 failures, 1 late, 3 fallbacks, 3 dropped" in format_summary(summary)


def test_a_plan_that_was_kept_because_it_is_sounder_is_no_failure_and_the_last_event_in_the_table():
    record = synthetic_record()
    status = np.zeros_like(record.mpc_status)
    status[[3, 4, 5]] = KEPT
    summary = summarise(replace(record, mpc_status=status))
    mpc = summary["mpc"]
    assert (mpc["kept"], mpc["failures"], mpc["fallbacks"], mpc["solves"]) == (3, 0, 0, len(status))
    assert f"MPC           {len(status)} solves, 3 kept\n" in format_summary(summary)
    kept, *others = summary["events"]
    assert kept["kind"] == "plan_kept"
    assert others == summarise(record)["events"]
    assert format_summary(summary).splitlines()[-1].endswith(kept["text"])


def test_step_times_are_in_milliseconds():
    record = synthetic_record()
    solved = replace(record, step_seconds=np.linspace(0.0, 0.1, 101), mpc_status=np.zeros(101))
    step = summarise(solved)["mpc"]["step_ms"]
    assert step == {key: pytest.approx(value) for key, value in (
        ("p50", 50.0), ("p95", 95.0), ("p99", 99.0), ("max", 100.0))}


def test_the_disturbance_is_measured_by_its_norm():
    record = synthetic_record()
    d = np.zeros_like(record.disturbance)
    d[7, [0, 9]] = [0.03, -0.04]
    disturbance = summarise(replace(record, disturbance=d, effective_disturbance=3.0 * d))
    assert disturbance["disturbance"] == {
        "unit": "m/s², rad/s²", "bound": 0.1, "worst": pytest.approx(0.15),
        "semi_axes": None, "applied": pytest.approx(0.05), "exceeded": 1}


def test_where_no_bound_of_what_disturbs_is_declared_none_is_exceeded():
    record = synthetic_record()
    scenario = replace(record.scenario, disturbance=replace(record.scenario.disturbance, bound=0.0))
    record = replace(record, scenario=scenario, certified=np.array(False),
                     effective_disturbance=record.effective_disturbance + 0.05)
    summary = summarise(record)
    assert summary["disturbance"]["exceeded"] is None
    assert "no bound is declared" in format_summary(summary)
    assert not [each for each in summary["events"] if each["kind"] == "disturbance_exceeded"]
    certified = summarise(replace(record, certified=np.array(True)))
    assert certified["disturbance"]["exceeded"] == 1


def test_with_weights_the_disturbance_is_measured_by_the_bounds_of_its_components():
    """0.03 m/s² of a hull of a tenth, which is too much, and 0.04 rad/s² of a joint of all of d̃."""
    record = synthetic_record()
    scenario = replace(record.scenario, disturbance=replace(
        record.scenario.disturbance, bound=1.0, weights=np.repeat([0.01, 0.1], [6, 4])))
    d = np.zeros_like(record.disturbance)
    d[7, 0], d[9, 9] = 0.03, -0.04
    summary = summarise(replace(
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
    summary = summarise(replace(record, effective_disturbance=d))
    assert summary["disturbance"]["exceeded"] == times
    assert (f"exceeded {times} times" in format_summary(summary)) == (times > 0)


def test_the_table_says_that_the_tube_is_declared_and_what_is_violated():
    record = synthetic_record()
    text = format_summary(summarise(record))
    assert "certified     no (declared tube)" in text
    assert "VIOLATED" not in text
    u = record.u.copy()
    u[0, 0] = 9.0
    scenario = replace(record.scenario, ancillary=Transpose())
    text = format_summary(summarise(replace(record, u=u, scenario=scenario)))
    _, row = (line for line in text.splitlines() if "VIOLATED" in line)
    assert row.startswith("u_surge")
    assert "law transpose; |chi - chi_nominal|" in text


def test_the_table_of_a_run_without_settling_and_samples_is_printable():
    empty = dict.fromkeys(("mpc_time", "mpc_status", "mpc_terminal_slack", "mpc_violation",
                           "mpc_refused", "mpc_rows", "step_seconds"), np.zeros(0))
    summary = summarise(pressing([0.0, 0.0], wall_time_s=0.0, **empty))
    assert summary["mpc"]["step_ms"] == dict.fromkeys(("p50", "p95", "p99", "max"))
    assert summary["mpc"]["worst_violation"] is None
    assert summary["real_time_factor"] is None
    assert "never settled" in format_summary(summary)


def test_the_events_are_in_the_summary_and_in_the_table():
    record = synthetic_record()
    status = np.zeros_like(record.mpc_status)
    status[50] = 1.0
    summary = summarise(replace(record, mpc_status=status))
    assert [event["kind"] for event in summary["events"]] == ["contact", "settled", "solver_failed"]
    assert summary["events"][-1] == {
        "time_s": pytest.approx(10.0), "until_s": pytest.approx(10.2), "kind": "solver_failed",
        "text": "the solver failed"}
    assert summary["events"][0]["until_s"] is None
    text = format_summary(summary)
    first, second, third = text[text.index("\nevents ") + 1:].splitlines()
    assert first == "events        10.00 s to 10.20 s  the solver failed"
    assert second.startswith(" " * 14 + "2.02 s to the end   contact, ")
    settled = summary["force"]["settling_time_s"]
    assert third.startswith(f"{'':<14}{f'{settled:.2f} s':<20}force within 2 N")


def test_what_alarms_comes_first_and_the_rest_is_counted():
    record = synthetic_record()
    d = np.zeros_like(record.disturbance)
    d[::20] = 1.0
    summary = summarise(replace(record, effective_disturbance=d))
    number = len(summary["events"])
    assert number > EVENT_LINES
    text = format_summary(summary)
    block = text[text.index("\nevents ") + 1:].splitlines()
    assert len(block) == EVENT_LINES
    assert block[0] == ("events        0.00 s to 0.02 s    whole disturbance above its bound of "
                        "0.1, at most 3.16")
    assert all("whole disturbance above" in line for line in block[:-1])
    assert block[-1].strip() == f"... and {number - EVENT_LINES + 1} more in summary.json"


def test_a_run_without_events_has_none():
    record = synthetic_record(1.0)
    assert summarise(record)["events"] == []
    assert "events        none" in format_summary(summarise(record))


def test_a_surface_that_is_never_reached_is_said():
    record = pressing(np.zeros(4))
    text = format_summary(summarise(record))
    assert "normal force 0 N at its peak, never in contact" in text


def test_what_is_a_length_is_in_millimetres_and_what_has_a_unit_says_it():
    record = synthetic_record()
    chi = record.chi.copy()
    chi[[0, -1]] = record.chi_des + np.outer([0.1, 0.001], [3.0, 0.0, 4.0, 1.0, 0.0, 0.0])
    text = format_summary(summarise(replace(record, chi=chi)))
    assert "task error    500 mm and 100 mrad at the start, 5 mm and 1 mrad at the end" in text
    assert "bound 0.1 [m/s², rad/s²]\n" in text
    assert "mm, mrad (bound 6)," in text


def test_a_force_that_nobody_desires_is_not_judged():
    lines = format_summary(summarise(desiring([0] * 6, synthetic_record()))).splitlines()
    (line,) = (line for line in lines if line.startswith("force "))
    assert line.split() == ["force", "no", "force", "desired"]
    assert lines[lines.index(line) + 1].split()[:2] == ["largest", "force"]


def test_contact_is_told_by_touch_losses_and_static_force_on_the_real_surface():
    """The wall of the record yields 1000 N/m past a transition of 2 mm; the real one is shifted."""
    record = pressing([0.0, 19.0, 0.0, 20.5, 20.0, 0.0])
    chi = record.chi.copy()
    chi[:, 0] = [-0.1, 0.020, -0.1, 0.0215, 0.021, 0.0]
    depth = np.maximum(chi[:, 0], 0.0)
    force = record.force.copy()
    force[5, 0] = 20.0  # Settled from the third second on.
    record = replace(record, chi=chi, penetration=depth, force=force)
    contact = summarise(record)["contact"]
    assert contact == {"first_touch_s": 1.0, "losses": 1, "largest_force": 20.5,
                       "largest_static_force": pytest.approx(20.5)}
    moved = replace(record.scenario, surface_error=SurfaceError(shift=np.array([0.01, 0.0, 0.0])))
    assert summarise(replace(record, scenario=moved))["contact"]["largest_static_force"] \
        == pytest.approx(10.5)


def test_without_contact_there_is_no_first_touch():
    record = pressing([0.0, 0.0])
    contact = summarise(replace(record, penetration=np.zeros(2)))["contact"]
    assert (contact["first_touch_s"], contact["losses"]) == (None, 0)


def test_a_claim_in_probability_names_walls_that_are_not_declared():
    seen = {"out_of_class": {"friction": {"specified": 0.5, "observed": 0.61}}}
    claim = summarise_claim(made((1, 2)), seen)
    assert (claim["failures"], claim["runs"], claim["confidence"]) == (2, 60, 0.95)
    assert claim["outside"] == [
        "contact.friction was seen to be 0.61, declared up to 0.5"]
    assert summarise_claim(None, seen) is None


def test_the_summary_has_each_thrusters_forces_and_limits():
    """Forces of a sine of 80 N; the third thruster is at its limit in a quarter of the time."""
    base = synthetic_record(4.0)
    wave = np.sin(np.pi * base.time)[:, None] * np.ones(5)
    command = 0.5 * wave
    command[:, 2] = np.where(base.time < 1.0, 1.0, 0.0)
    record = replace(base, scenario=replace(base.scenario, actuation=[Thrusters()]), signals={
        "thruster_command": command, "thruster_force": 80.0 * wave})
    rows = summarise(record)["thrusters"]
    assert list(rows) == ["surge_port", "surge_starboard", "heave_bow", "heave_stern", "sway"]
    row = rows["heave_bow"]
    assert (row["least"], row["largest"]) == pytest.approx((-80.0, 80.0), rel=1e-2)
    assert row["rms"] == pytest.approx(80.0 / np.sqrt(2.0), rel=1e-2)
    assert (row["lower"], row["upper"]) == (-95.122, 104.659)
    assert row["at_limit"] == pytest.approx(0.25, abs=0.01)
    assert rows["sway"]["at_limit"] == 0.0
    assert "heave_bow: -80 to 80 N of -95.12 to 104.7 N, 56." in format_summary(summarise(record))
    assert summarise(base)["thrusters"] == {}
