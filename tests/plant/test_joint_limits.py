"""Stops and motors of joints: energy, peaks by hand, and a run that meets neither."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from support.scripts import use_fixed_steps

import uvms_drake as uv
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.joint_limits import STOP, JointLimits, motor_torque, stop_torque
from uvms_drake.plant.model_check import sound_robot
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state

ROBOT = "girona500_arm5e"
LIMITS = JointLimits(
    lower=np.array([-0.5, -np.inf]), upper=np.array([1.0, 0.3]), speed=np.array([0.4, 0.2]),
    effort=np.array([30.0, np.inf]), inertia=np.array([2.0, 0.5]))


def test_within_the_limits_the_torque_is_the_commanded_one_to_the_bit():
    q, rates, torque = np.array([0.9999, 0.3]), np.array([-0.4, 0.19]), np.array([29.9, 1e6])
    np.testing.assert_array_equal(
        motor_torque(LIMITS, rates, torque) + stop_torque(LIMITS, q, rates), torque)


def test_a_motor_gives_no_more_than_its_torque_and_none_beyond_its_speed():
    """B = E/(100Λ) = 0.15 rad/s; against its motion it gives all of its torque."""
    for rate, largest in ((0.0, 30.0), (0.4, 30.0), (0.475, 15.0), (0.55, 0.0), (9.0, -30.0)):
        rates = np.array([rate, 9.0])
        most, least = (motor_torque(LIMITS, rates, np.full(2, sign * 1e3)) for sign in (1, -1))
        np.testing.assert_allclose(most, [largest, 1e3], atol=1e-9)
        np.testing.assert_allclose(least, [-30.0, -1e3])
        np.testing.assert_allclose(motor_torque(LIMITS, -rates, np.full(2, -1e3)), -most)


def test_a_stop_takes_energy_and_never_pulls():
    """A mass that hits it comes back slower, after the depth of a damped oscillator."""
    q, rate, h = 1.0, 0.3, 1e-5
    depths, work = [], 0.0
    for _ in range(200_000):
        torque = stop_torque(LIMITS, np.array([q, 0.0]), np.array([rate, 0.0]))[0]
        assert torque <= 0.0
        rate += h * torque / LIMITS.inertia[0]
        q += h * rate
        work += h * torque * rate
        depths.append(q - 1.0)
        if q < 1.0:
            break
    omega, zeta = STOP
    damped = omega * np.sqrt(1.0 - zeta**2)
    deepest = 0.3 / omega * np.exp(-zeta * omega * np.arccos(zeta) / damped)
    assert max(depths) == pytest.approx(deepest, rel=0.01)
    assert -0.3 < rate < -0.05
    assert work == pytest.approx(0.5 * LIMITS.inertia[0] * (rate**2 - 0.3**2), rel=1e-3)


@pytest.mark.parametrize("robot", [ROBOT, "bluerov2_alpha5"])
def test_a_joint_that_is_driven_for_ever_stays_at_its_stop(robot):
    """By any torque: no further than that of its motor takes it, and no faster than it turns."""
    model = UvmsModel(sound_robot(robot).uvms)
    plant = make_uvms_plant(robot)
    for sign, stop in ((1.0, model.q_upper), (-1.0, model.q_lower)):
        simulator = Simulator(plant)
        use_fixed_steps(simulator)
        context = simulator.get_mutable_context()
        start = np.concatenate([np.zeros(6), stop - sign * 0.1, np.zeros(model.size)])
        set_state(plant, context, start)
        tau = np.append(np.zeros(6), np.full(model.num_joints, sign * 500.0))
        plant.GetInputPort("tau").FixValue(context, tau)
        for time in np.arange(0.1, 1.5, 0.1):
            simulator.AdvanceTo(time)
            state = plant.GetOutputPort("state").Eval(context)
            assert np.all(sign * (state[6:model.size] - stop) < 0.1), (time, state[6:model.size])
            assert np.all(np.abs(state[model.size + 6:]) < 3.0)


def test_a_joint_of_a_file_has_its_efforts_speeds_and_stops():
    plant = make_uvms_plant(ROBOT)
    limits = plant.GetSubsystemByName("joints")._limits
    np.testing.assert_array_equal(limits.effort, [50.0, 70.0, 35.0, 14.0])
    np.testing.assert_array_equal(limits.speed, [0.3, 0.3, 0.3, 0.5])
    model = UvmsModel(sound_robot(ROBOT).uvms)
    np.testing.assert_array_equal(limits.lower, model.q_lower)
    M = model.mass_matrix(model.kinematics(np.zeros(model.size)))
    np.testing.assert_allclose(limits.inertia, 1.0 / np.diag(np.linalg.inv(M))[6:], rtol=1e-6)


@pytest.mark.long
def test_a_robot_in_a_run_with_a_wave_keeps_its_joints():
    """Before stops and motors a wave turned them radians past their stops at 30 rad/s."""
    run = uv.simulate(uv.load_scenario("girona500_real_loop", [
        "duration=6.0", "mpc.hover=1.0", "waves=[{period: 6.0}]"]))
    model = run.model
    q = run.state[:, 6:model.size]
    assert np.all(q < model.q_upper + 0.05) and np.all(q > model.q_lower - 0.05)
