"""Tests of `uvms_drake.station.simulation`."""

import gc
import weakref
from dataclasses import fields, replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from support.runs import simulated

import uvms_drake as uv
from uvms_drake.control.feedback.tube_monitor import FIELDS, TUBE_REPORT
from uvms_drake.model.surface.law import check_surface
from uvms_drake.station.record import LOG_FILE, save_record
from uvms_drake.station.simulation import make_record

SHORT = ["duration=1.5", "log_period=0.01"]


def logs_of(record):
    logs = {field.name: getattr(record, field.name) for field in fields(record)
            if field.name not in ("scenario", "signals", "wall_time_s")}
    return logs | {"desired_force": record.desired_force, "state_lost": record.state_lost[:, None],
                   "input_limited": record.input_limited[:, None]}


@pytest.fixture
def record():
    return simulated("girona500_ideal", 1.5, "log_period=0.01")


def test_a_run_leaves_neither_its_context_nor_its_solver_behind(monkeypatch):
    left = []

    def watched(station):
        simulator = Simulator(station)
        mpc = station.GetSubsystemByName("tube_mpc").GetSubsystemByName("nominal_mpc")
        left.extend(map(weakref.ref, (simulator, simulator.get_mutable_context(), mpc.ocp)))
        return simulator

    monkeypatch.setattr("uvms_drake.station.simulation.Simulator", watched)
    uv.simulate(uv.load_scenario("girona500_ideal", ["duration=0.02", "mpc.horizon=8"]))
    gc.collect()
    assert [ref() for ref in left] == [None] * 3


def test_the_record_has_all_signals_at_all_samples(record):
    np.testing.assert_allclose(record.time, np.arange(151) * 0.01, atol=1e-12)
    for name in ("state", "nominal_state", "chi", "chi_nominal", "nominal_input", "u", "tau",
                 "state_lost", "input_limited", "force", "penetration", "disturbance",
                 "acceleration", "effective_disturbance"):
        assert len(getattr(record, name)) == 151
    assert record.penetration.ndim == record.state_lost.ndim == record.input_limited.ndim == 1
    assert record.state.shape[1] == 20
    for field in fields(record):
        if field.name not in ("scenario", "signals", "tube_report", "failure"):
            assert np.all(np.isfinite(getattr(record, field.name))), field.name
    assert record.tube_deviation.shape == record.tube_bound.shape == (151, len(FIELDS))
    assert record.tube_report.shape == (len(TUBE_REPORT),)
    assert not np.any(np.isnan(record.tube_report))  # inf: no exit


def test_the_deviation_is_that_of_pose_joints_and_velocity(record):
    pose = uv.pose_difference(record.chi, record.chi_nominal)
    joints = (record.config - record.nominal_config)[:, 6:]
    for part, error in (
            ("task", np.hstack([pose, joints])), ("position", pose[:, :3]),
            ("orientation", pose[:, 3:]), ("joints", joints),
            ("z", record.zeta - record.nominal_zeta)):
        np.testing.assert_allclose(record.deviation_of(part), np.linalg.norm(error, axis=1),
                                   atol=1e-12, err_msg=part)


def test_where_the_controller_knows_all_else_the_disturbance_is_the_effective_one(record):
    assert np.max(np.abs(record.disturbance)) > 0.03
    np.testing.assert_allclose(record.effective_disturbance, record.disturbance, atol=1e-9)


def test_another_surface_is_in_the_effective_disturbance():
    """By the difference of the two forces on the robot."""
    scenario = uv.load_scenario("girona500_ideal", [
        *SHORT, "start.eta=[-1.13, -0.05, -0.05, 0.02, 0.02, 0.05]", "surface_error.stiffness=1.2",
        "surface_error.shift=[-0.002, 0, 0]", "surface_error.turn=[0, 0.05, 0.02]"])
    record = uv.simulate(scenario)
    model = uv.ContactModel.load(scenario.model, check_surface(scenario.surface))
    kinematics = model.kinematics(record.config)
    chi_dot = (kinematics.J_chi @ record.zeta[..., None])[..., 0]
    unknown = record.force - model.surface.force(record.chi, chi_dot)
    assert np.max(np.abs(unknown)) > 2.0
    torque = kinematics.J_chi.swapaxes(-1, -2) @ unknown[..., None]
    induced = -np.linalg.solve(model.mass_matrix(kinematics), torque)[..., 0]
    np.testing.assert_allclose(
        record.effective_disturbance, record.disturbance + induced, atol=1e-8)


def test_the_joint_limits_are_those_in_force(record):
    """Those of the scenario where it has its own, which are narrower; the robot's elsewhere."""
    limits = record.scenario.limits
    np.testing.assert_array_equal(record.joint_lower, limits.q_lower)
    np.testing.assert_array_equal(record.joint_upper, limits.q_upper)
    wide = replace(record.scenario, limits=replace(limits, q_lower=None))
    recorded = make_record(wide, record.model, logs_of(record), 1.0, certified=False)
    np.testing.assert_array_equal(recorded.joint_lower, record.model.q_lower)
    np.testing.assert_array_equal(recorded.joint_upper, limits.q_upper)
    assert np.all(recorded.joint_lower < record.joint_lower)


def test_the_same_seed_gives_the_same_log_byte_for_byte(record, tmp_path):
    times = []
    again = uv.simulate(record.scenario, progress=lambda _, done: times.append(done))
    for name, item in (("a", record), ("b", again)):
        (tmp_path / name).mkdir()
        save_record(item, tmp_path / name)
    assert (tmp_path / "a" / LOG_FILE).read_bytes() == (tmp_path / "b" / LOG_FILE).read_bytes()
    assert times == sorted(times)
    assert 15 <= len(times) <= 17


def test_the_first_plan_is_announced_before_it_is_made(monkeypatch):
    monkeypatch.setattr("uvms_drake.control.mpc.planner.FIRST_SOLVE_ITERATIONS", 2)
    said = []
    with pytest.raises(uv.RunFailed, match="out of the reach"):
        uv.simulate(uv.load_scenario("girona500_ideal", ["start.eta.0=-50"]),
                    progress=lambda *what: said.append(what))
    assert said == [("first plan", 0.0)]


def test_the_end_of_a_run_is_logged_where_the_period_does_not_go_into_it():
    record = uv.simulate(uv.load_scenario("girona500_ideal", ["duration=0.33", "log_period=0.1"]))
    np.testing.assert_allclose(record.time, [0.0, 0.1, 0.2, 0.3, 0.33], atol=1e-12)
    np.testing.assert_allclose(record.mpc_time, [0.0, 0.2], atol=1e-12)
