"""Synthetic logs of a robot that differs from its file."""

import numpy as np

from uvms_drake.identification.log import GRID, Log
from uvms_drake.identification.output_error import OWN, STEP, simulated
from uvms_drake.identification.parameters import UNIT, parameters_of
from uvms_drake.identification.vehicle_dynamics import arm_motion, vehicle_dynamics
from uvms_drake.model.robot import Robot
from uvms_drake.model.uvms_model import UvmsModel

POSTURES = {"bluerov2_alpha5": np.array([3.1, 0.6, 1.5, 1.5]),
            "girona500_arm5e": np.array([0.1, 0.9, 0.4, 0.2])}
TRUTH = {"vehicle.added_mass.roll": 0.3, "vehicle.added_mass.pitch": 0.3,
         "vehicle.linear_drag.roll": -0.3, "vehicle.linear_drag.pitch": 0.3,
         "vehicle.center_of_buoyancy.x": 0.003, "vehicle.center_of_buoyancy.y": -0.002}


def synthetic_logs(robot: str, seed: int, count: int = 4, powered: bool = False,
                   seconds: float = 26.0) -> list[Log]:
    """Returns logs of a robot that differs from its file by `TRUTH`.

    The arm swings, the vehicle is released 4 degrees off and feels a constant moment; errors of the
    attitude are correlated over a second.
    """
    model, (base, parameters) = UvmsModel(Robot.load(robot).uvms), parameters_of(robot)
    rng, logs = np.random.default_rng(seed), []
    time = GRID * np.arange(round(seconds / GRID))
    theta = np.array([TRUTH.get(each.name, 0.0) for each in parameters])
    for index in range(count):
        n = model.num_joints
        rate, phase = rng.uniform(0.4, 1.5, n), rng.uniform(0, 2 * np.pi, n)
        angle = time[:, None] * rate + phase
        q = POSTURES[robot] + 0.35 * np.sin(angle)
        q_dot, q_ddot = 0.35 * rate * np.cos(angle), -0.35 * rate**2 * np.sin(angle)
        dynamics = vehicle_dynamics(base, [each.links for each in parameters], UNIT, arm_motion(
            model, q, q_dot, q_ddot)).with_parameters(theta)
        inertia = np.diag(dynamics.composite.inertia[0])
        wrench = np.zeros((len(time), 6))
        if powered:
            for axis in range(6):
                speed = rng.uniform(0.5, 2.0)
                wrench[:, axis] = 0.2 * inertia[axis] * np.sin(speed * time + rng.uniform(0, 6))
        own = np.zeros((1, OWN))
        own[0, :2] = np.deg2rad(4.0) * rng.choice([-1.0, 1.0], 2)
        own[0, 12:15] = 0.01 * inertia[3:6] * rng.normal(size=3)
        # Every sample of the grid: two simulations, half a step of the integration apart.
        motion = simulated(dynamics, wrench, np.array([0]), len(time) // STEP, own, sensitive=False)
        x = np.full((len(time), 9), np.nan)
        even = STEP * np.arange(len(time) // STEP)
        for k in range(9):
            x[:, k] = np.interp(time, time[even], motion.state[0, :, k])
        noise = rng.normal(size=(len(time), 2))
        for i in range(1, len(time)):
            noise[i] = 0.95 * noise[i - 1] + np.sqrt(1 - 0.95**2) * noise[i]
        x[:, :2] += np.deg2rad(0.1) * noise
        x[:, 6:] += 0.003 * rng.normal(size=(len(time), 3))
        x[:, 3:6] += 0.005 * rng.normal(size=(len(time), 3)) if powered else np.nan
        x[:, 2] = x[:, 2] + 0.005 * rng.normal(size=len(time)) if powered else np.nan
        rate_of = np.gradient(x, GRID, axis=0)
        logs.append(Log(f"log{index}", time, q, q_dot, q_ddot, wrench, x, rate_of,
                        np.full((len(time), 3), np.nan), np.full((len(time), 3), np.nan),
                        np.zeros(len(time), dtype=bool)))
    return logs
