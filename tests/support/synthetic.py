"""A synthetic record with the signals of a plausible run, for tests of functions of records."""

from dataclasses import replace

import numpy as np

from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import load_scenario

NUMBERS = (
    "log_period=0.02", "mpc.time_step=0.2", "disturbance.bound=0.1",
    "task.force=[20, 0, 0, 0, 0, 0]", "task.force_tolerance=2",
    "limits.nu1=0.3", "limits.nu2=0.25", "limits.qdot=0.4", "limits.roll=0.25", "limits.pitch=0.3",
    "limits.tip_pitch=1.2", "limits.q_lower=[-0.4, 0.6, -0.1, -0.8]", "limits.q_upper=null",
    "limits.tau=null", "limits.u=[0.4, 0.25, 0.4, 0.5, 0.5, 0.4, 3, 3, 3, 3]",
    "tube.e=0.006", "tube.position=0.005", "tube.orientation=0.004", "tube.joints=0.005",
    "tube.z=0.04", "tube.nu1=0.03", "tube.nu2=0.02", "tube.qdot=0.01",
    "tube.roll=0.002", "tube.pitch=0.001",
    "tube.u=[0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.3, 0.3, 0.3, 0.3]")
"""Fixed here, so that tuning the shipped scenario does not change the record."""


def synthetic_record(duration: float = 20.0, **changes: object) -> Record:
    """Returns a record of 4 joints; the force is 20 N (1 − e^{−3(t − 2)}) from 2 s on."""
    scenario = load_scenario("girona500_ideal", [*NUMBERS, f"duration={duration}"])
    time = np.arange(0.0, duration + 1e-9, scenario.log_period)
    mpc_time = np.arange(0.0, duration, scenario.mpc.time_step)
    wave = np.sin(time)[:, None] * np.linspace(1.0, 0.2, 10)
    decay = np.exp(-1.5 * time)[:, None]
    approach = np.array([-0.3, 0.05, -0.08, 0.04, -0.03, 0.1])
    after = np.maximum(time - 2.0, 0.0)
    press = 20.0 * (1.0 - np.exp(-3.0 * after)) * (1.0 + 0.5 * np.exp(-after) * np.sin(9.0 * after))
    config = np.hstack([
        np.array([-1.0, 0.0, 0.0, 0.0, 0.0, 0.0]) + decay * approach,
        np.array([0.0, 1.1, 0.47, 0.0]) + decay * [0.1, -0.1, 0.1, 0.2]])
    zeta = 0.15 * np.sin(np.pi * np.minimum(time / 2.0, 1.0))[:, None] * np.linspace(1.0, 0.3, 10)
    deviation = 0.0015 * wave
    arrays = {
        "time": time,
        "state": np.hstack([config + deviation, zeta + 5.0 * deviation]),
        "nominal_state": np.hstack([config, zeta]),
        "chi": np.array([0.02, 0.0, 0.04, 0.0, 0.0, 0.0]) + decay * approach + deviation[:, :6],
        "chi_nominal": np.array([0.02, 0.0, 0.04, 0.0, 0.0, 0.0]) + decay * approach,
        "chi_des": np.array([0.02, 0.0, 0.04, 0.0, 0.0, 0.0]),
        "nominal_input": 0.2 * decay * np.cos(3.0 * time)[:, None] * np.ones(10),
        "u": 0.2 * decay * np.cos(3.0 * time)[:, None] * np.ones(10) - 0.03 * wave,
        "tau": 30.0 * wave,
        "state_lost": np.zeros(len(time)),
        "input_limited": np.zeros(len(time)),
        "force": np.hstack([press[:, None], np.zeros((len(time), 5))]),
        "desired_force": np.tile([20.0, 0.0, 0.0, 0.0, 0.0, 0.0], (len(time), 1)),
        "penetration": press / 1000.0,
        "disturbance": 0.1 * np.sin(time)[:, None] * np.full(10, 1.0 / np.sqrt(10.0)),
        "acceleration": 0.2 * decay * np.cos(3.0 * time)[:, None] * np.ones(10),
        "effective_disturbance": 0.1 * np.sin(time)[:, None] * np.full(10, 1.0 / np.sqrt(10.0)),
        "joint_lower": np.array([-0.4, 0.6, -0.1, -0.8]),
        "joint_upper": np.array([1.46, 1.3114, 0.73, 3.14]),
        "mpc_time": mpc_time,
        "mpc_status": np.zeros(len(mpc_time)),
        "mpc_cost": np.exp(-mpc_time),
        "mpc_terminal_slack": np.maximum(0.0, 0.3 - 0.1 * mpc_time),
        "mpc_violation": np.zeros(len(mpc_time)),
        "mpc_iterations": np.ones(len(mpc_time)),
        "mpc_rows": np.linspace(0.0, 30.0, len(mpc_time)).round(),
        "mpc_refused": np.zeros(len(mpc_time)),
        "certified": np.array(False),
        "tube_report": np.concatenate([np.zeros(3), np.full(3, np.inf), np.full(13, 0.4)]),
        "tube_deviation": np.abs(wave[:, :1]) * 1e-3 * np.arange(1.0, 7.0),
        "tube_bound": np.tile(2e-3 * np.arange(1.0, 7.0), (len(time), 1)),
        "step_seconds": 0.03 + 0.01 * np.sin(7.0 * mpc_time) ** 2,
    }
    return replace(Record(scenario=scenario, wall_time_s=10.0, **arrays), **changes)


def aimed_at(target: np.ndarray) -> dict[str, np.ndarray]:
    """Returns the signals of a press target (T, 3) that nothing clips, without noise."""
    return {"target": target, "unclipped_target": target, "target_of_reading": target}


def synthetic_sensed_record(duration: float = 4.0, **changes: object) -> Record:
    """Returns the record as one of a sensed wall at x = 0, with 25 mm of safe depth.

    From 2.1 s on the estimate of its place is x = 3 mm, that of its stiffness 800 N/m less 100 N/m
    each second, with a deviation of 200 N/m.
    """
    scenario = load_scenario("girona500_contact", [
        f"duration={duration}", "task.force_tolerance=2", "surface.geometry.point=[0, 0, 0]",
        "surface.geometry.normal=[-1, 0, 0]", "surface.law.stiffness=700"])
    record = synthetic_record(duration)
    known = record.time > 2.09
    signals = aimed_at(np.column_stack([
        2.0 * record.chi[:, 0], np.zeros((len(record.time), 2))])) | {
        "force_last_valid": record.force + 0.3 * np.sin(40.0 * record.time)[:, None],
        "safe_depth": record.chi_nominal[:, :1] + 0.025,
        "contact_depth": np.where(known, 0.003, np.nan)[:, None],
        "stiffness_estimate": np.where(
            known, 800.0 - 100.0 * np.maximum(record.time - 2.1, 0.0), np.nan)[:, None],
        "stiffness_std": np.where(known, 200.0, np.nan)[:, None],
        "stiffness_used": 1000.0 - 100.0 * np.maximum(record.time - 2.1, 0.0)[:, None]}
    return replace(record, scenario=scenario, signals=signals, **changes)


def desiring(wrench: list[float], record: Record) -> Record:
    """Returns the record with this 𝔉_des (6,) [N, N m], and a torque on the surface."""
    force = record.force.copy()
    force[:, 3] = 0.5
    desired = np.tile(np.asarray(wrench, dtype=float), (len(record.time), 1))
    return replace(record, force=force, desired_force=desired)
