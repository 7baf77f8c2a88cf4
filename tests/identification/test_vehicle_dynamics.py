"""Tests of `identification.vehicle_dynamics` and `output_error`, against `UvmsModel`."""

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant

from uvms_drake.identification.log import gravity_in_body, state_rate
from uvms_drake.identification.output_error import OWN, simulated
from uvms_drake.identification.parameters import UNIT, error_of, parameters_of
from uvms_drake.identification.vehicle_dynamics import arm_motion, vehicle_dynamics
from uvms_drake.model.frames.spatial import times
from uvms_drake.model.robot import Robot
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.model_error import add_simulated_uvms

ROBOTS = ("bluerov2_alpha5", "girona500_arm5e")


def true_model(name, theta, parameters):
    plant = MultibodyPlant(0.0)
    uvms = add_simulated_uvms(plant, name, error_of(dict(zip(
        [each.name for each in parameters], theta, strict=True))))
    plant.Finalize()
    return UvmsModel(uvms)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_vehicle_is_moved_as_by_the_model_with_any_errors(name):
    """Random motions of arm and vehicle, random errors of all parameters at once."""
    model, rng = UvmsModel(Robot.load(name).uvms), np.random.default_rng(1)
    base, parameters = parameters_of(name)
    size, n = 20, model.num_joints
    q, q_dot, q_ddot = rng.uniform(-1.0, 1.0, (3, size, n))
    config = np.concatenate([np.zeros((size, 3)), rng.uniform(-0.5, 0.5, (size, 3)), q], axis=1)
    nu, nu_dot = rng.uniform(-1.0, 1.0, (2, size, 6))
    theta = np.array([rng.uniform(-0.3, 0.3) * each.scale for each in parameters])
    dynamics = vehicle_dynamics(base, [each.links for each in parameters], UNIT,
                                arm_motion(model, q, q_dot, q_ddot))
    state = np.concatenate([config[:, 3:5], np.zeros((size, 1)), nu], axis=1)
    g_B = gravity_in_body(state)
    for errors in (np.zeros_like(theta), theta):
        true, moved = true_model(name, errors, parameters), dynamics.with_parameters(errors)
        tau = true.inverse_dynamics(
            true.kinematics(config), np.concatenate([nu, q_dot], axis=1),
            np.concatenate([nu_dot, q_ddot], axis=1))[:, :6]
        found = times(moved.composite.inertia, nu_dot) + moved.force(
            nu[:, None], g_B[:, None])[:, 0]
        np.testing.assert_allclose(found, tau, rtol=1e-9, atol=1e-8)
    # The regressor is the difference, since the parameters are linear.
    Y = dynamics.regressor(nu, nu_dot, g_B)
    first = times(dynamics.composite.inertia, nu_dot) + dynamics.force(
        nu[:, None], g_B[:, None])[:, 0]
    np.testing.assert_allclose(np.einsum("wpi,p->wi", Y, theta), tau - first, rtol=1e-7, atol=1e-7)


def test_the_simulation_is_the_models_and_its_sensitivities_are_differences():
    name, rng = ROBOTS[0], np.random.default_rng(2)
    model, (base, parameters) = UvmsModel(Robot.load(name).uvms), parameters_of(name)
    time = 0.05 * np.arange(61)
    rates = np.array([1.0, 0.7, 1.3, 2.0])
    q = np.array([3.1, 0.5, 1.5, 1.5]) + 0.3 * np.sin(time[:, None] * rates)
    q_dot = np.gradient(q, time, axis=0)
    q_ddot = np.gradient(q_dot, time, axis=0)
    dynamics = vehicle_dynamics(base, [each.links for each in parameters], UNIT,
                                arm_motion(model, q, q_dot, q_ddot))
    wrench = np.tile(0.2 * rng.normal(size=6), (61, 1))
    own = np.zeros((2, OWN))
    own[:, :9] = 0.1 * rng.normal(size=(2, 9))
    own[:, 9:15] = 0.2 * rng.normal(size=(2, 6))
    start = np.array([0, 20])
    motion = simulated(dynamics, wrench, start, 21, own)
    # A step is the mean of the rates at both its ends, to second order.
    rates = []
    for sample, x in ((start, motion.state[:, 0]), (start + 2, motion.state[:, 1])):
        at = dynamics.at(sample)
        left = wrench[sample] + own[:, 9:15] - at.force(
            x[:, None, 3:], gravity_in_body(x)[:, None])[:, 0]
        rates.append(state_rate(x, times(np.linalg.inv(at.composite.inertia), left)))
    np.testing.assert_allclose((motion.state[:, 1] - motion.state[:, 0]) / 0.1,
                               np.mean(rates, axis=0), atol=0.02)
    for k in (0, len(parameters) // 2, len(parameters) - 1):
        theta, h = np.zeros(len(parameters)), 1e-4
        theta[k] = h
        ends = [simulated(dynamics.with_parameters(sign * theta), wrench, start, 21, own,
                          sensitive=False).state for sign in (1.0, -1.0)]
        np.testing.assert_allclose(motion.sensitivity[..., k], (ends[0] - ends[1]) / (2 * h),
                                   rtol=1e-3, atol=1e-5)
    for j in range(OWN):
        h = np.zeros(OWN)
        h[j] = 1e-4
        ends = [simulated(dynamics, wrench, start, 21, own + sign * h, sensitive=False).state
                for sign in (1.0, -1.0)]
        np.testing.assert_allclose(motion.sensitivity[..., len(parameters) + j],
                                   (ends[0] - ends[1]) / 2e-4, rtol=1e-3, atol=1e-5)
