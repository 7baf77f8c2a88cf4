"""Dry joints: the law by its pieces, the robot that slows down, sticks and breaks away."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator

from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.plant.joint_friction import STRIBECK, JointFriction, friction_torque
from uvms_drake.plant.model_error import ModelError
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.step_size import friction_rate

FRICTION = JointFriction(coulomb=np.array([0.5, 2.0]), static=np.array([0.8, 1.0]))
CONFIG = np.array([-3.0, 0.0, 0.0, 0.1, -0.2, 0.3, 0.1, 0.9, 0.4, 0.2])


def test_it_is_coulombs_torque_against_a_fast_joint_and_the_static_one_at_break_away():
    for sign in (1.0, -1.0):
        np.testing.assert_allclose(friction_torque(FRICTION, sign * np.array([9.0, 0.5])),
                                   -sign * np.array([0.5, 2.0]), rtol=1e-12)
        np.testing.assert_allclose(friction_torque(FRICTION, sign * np.full(2, FRICTION.creep)),
                                   -sign * np.array([0.8, 2.0]), rtol=1e-12)
    one = friction_torque(FRICTION, np.array([FRICTION.creep + STRIBECK, 0.0]))
    np.testing.assert_allclose(one, [-(0.5 + 0.3 * np.exp(-1.0)), 0.0], rtol=1e-12)


def test_it_takes_power_and_has_no_jump_and_no_steeper_slope_than_is_said():
    rates = np.linspace(-0.3, 0.3, 60001)
    torque = friction_torque(FRICTION, np.stack([rates, rates], axis=1))
    assert np.all(torque * rates[:, None] <= 0.0)
    assert np.max(np.abs(torque)) <= FRICTION.largest + 1e-12
    slopes = np.max(np.abs(np.diff(torque, axis=0)), axis=0) / (rates[1] - rates[0])
    np.testing.assert_allclose(slopes, FRICTION.slopes(2), rtol=1e-3)


def plant_with(friction):
    uvms = make_uvms_plant("girona500_arm5e", surface=None, disturbance=ConstantDisturbance(),
                           error=ModelError(joint_friction=friction))
    simulator = Simulator(uvms)
    ResetIntegratorFromFlags(simulator, "runge_kutta3", 2e-3)
    simulator.get_mutable_integrator().set_fixed_step_mode(True)
    return uvms, simulator, simulator.get_mutable_context()


def acceleration(uvms, context, zeta, tau):
    set_state(uvms, context, np.concatenate([CONFIG, zeta]))
    uvms.GetInputPort("tau").FixValue(context, tau)
    return uvms.GetOutputPort("acceleration").Eval(context).copy()


def test_the_robot_feels_it_as_a_torque_of_its_joints(model):
    """The same acceleration as without friction under τ less by it."""
    friction = JointFriction(coulomb=np.array([0.5, 1.0, 1.5, 2.0]))
    rng = np.random.default_rng(2)
    dry, wet = plant_with(friction), plant_with(JointFriction())
    for _ in range(3):
        zeta, tau = 0.2 * rng.normal(size=10), rng.normal(size=10)
        torque = np.append(np.zeros(6), friction_torque(friction, zeta[6:]))
        np.testing.assert_allclose(acceleration(dry[0], dry[2], zeta, tau),
                                   acceleration(wet[0], wet[2], zeta, tau + torque), atol=1e-10)


def test_a_joint_sticks_below_the_static_torque_and_breaks_away_above_it(model):
    """The torque of the equilibrium holds the others; a joint that sticks creeps."""
    friction, duration = JointFriction(np.array([1.0]), np.array([2.0]), creep=0.05), 0.2
    rest = model.inverse_dynamics(model.kinematics(CONFIG), np.zeros(10), np.zeros(10))
    turned = []
    for push in (1.8, 2.6):
        uvms, simulator, context = plant_with(friction)
        set_state(uvms, context, np.concatenate([CONFIG, np.zeros(10)]))
        uvms.GetInputPort("tau").FixValue(context, rest + push * np.eye(10)[9])
        simulator.AdvanceTo(duration)
        turned.append(uvms.GetOutputPort("state").Eval(context)[9] - CONFIG[9])
    assert 0.0 < turned[0] <= friction.creep * duration
    assert turned[1] > 5.0 * friction.creep * duration


def test_its_rate_is_that_of_the_loops_own_acceleration_by_the_rates():
    scenario = load_scenario("girona500_ideal")
    model = load_model(scenario)
    friction = JointFriction(coulomb=np.array([0.3, 0.2, 0.1, 0.05]))
    scenario.model_error = replace(scenario.model_error, joint_friction=friction)
    rate = friction_rate(scenario, model, CONFIG)
    M, zeta = model.mass_matrix(model.kinematics(CONFIG)), 0.5 * friction.creep * np.eye(10)[9]
    slope = [np.linalg.solve(M, np.append(np.zeros(6), friction_torque(
        friction, zeta[6:] + h * np.eye(4)[3]))) for h in (1e-7, -1e-7)]
    assert abs(slope[0] - slope[1])[9] / 2e-7 == pytest.approx(rate, rel=0.05)
    assert friction_rate(load_scenario("girona500_ideal"), model, CONFIG) == 0.0
