"""Tests of `tube.actuation.thruster_feedforward` against differences of what the rows carry."""

import numpy as np
import pytest

from uvms_drake.control.laws.tip_rows import tip_rows
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.tube.actuation.row_feedforward import row_feedforward
from uvms_drake.tube.actuation.thruster_feedforward import (
    Plans,
    ThrusterFeedforward,
    _motions,
    _named,
    values_at,
)
from uvms_drake.tube.rows.remainders import (
    configuration_of,
    output_bias,
    output_jacobian,
)
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.search_problem import input_within

BOUNDS = ConstraintSet(
    q_lower=np.array([-0.2, 1.0, 0.2, -0.3]), q_upper=np.array([0.2, 1.2, 0.45, 0.3]), roll=0.1,
    pitch=0.1, tip_pitch=0.4, nu1=0.15, nu2=0.1, qdot=0.8)
PLANS = Plans(0.14, 0.09, 0.5, np.repeat([0.5, 20.0], [6, 4]), np.full(10, 4.0))
SIX, FIVE = np.arange(6), np.array([0, 1, 2, 4, 5])
BLOCKS = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 10)
STEP = 1e-5


@pytest.fixture(scope="module")
def point() -> np.ndarray:
    return np.random.default_rng(3).uniform(-1.0, 1.0, (1, 36))


def found(model, point, driven=SIX, off=None) -> ThrusterFeedforward:
    off = np.zeros((6, 0)) if off is None else off
    return _named(values_at(point, model, BOUNDS, tip_rows(model), PLANS, driven, off)[0], 10)


def norms(vector: np.ndarray) -> list[float]:
    return [float(np.linalg.norm(vector[block])) for block in BLOCKS]


def planned(model, point):
    """Returns 𝔮, ζ, ζ̄ and ζ̄̇ (10,) of a point."""
    config, zeta, zeta_bar, share = _motions(point, model, BOUNDS, PLANS)
    rate = model.drift(config, zeta_bar) + input_within(
        model, config, zeta_bar, share, PLANS.u, PLANS.rate)
    return config[0], zeta[0], zeta_bar[0], rate[0]


def carried(model, config, zeta, rate):
    """Returns f̄ = ÿ̄ + h̄ (10,) of a plan, with the loads of the law."""
    rows, kinematics = tip_rows(model), model.kinematics(config)
    J = output_jacobian(model, config, kinematics, rows)
    y_ddot = J @ rate + output_bias(config, kinematics, zeta, rows)
    tau = model.inverse_dynamics(kinematics, zeta, rate)
    loads = row_feedforward(model, config, zeta, rows, tip_acceleration=y_ddot[6:], wrench=tau[:6])
    return y_ddot + np.append(loads.vehicle, loads.tip)


def test_a_plan_carries_its_acceleration_and_its_loads(model, point):
    config, _, zeta, rate = planned(model, point)
    loads = found(model, point)
    np.testing.assert_allclose(loads.plan, norms(carried(model, config, zeta, rate)), rtol=1e-6)
    later = [carried(model, config + step * configuration_rate(config, zeta), zeta + step * rate,
                     rate) for step in (-STEP, STEP)]
    np.testing.assert_allclose(
        loads.plan_rate, norms((later[1] - later[0]) / (2.0 * STEP)), rtol=1e-4, atol=1e-6)


def test_errors_of_the_outputs_make_loads_as_their_derivatives_say(model, point):
    """Newton's method finds the real state of an error; the loads of many directions fill norms."""
    config, zeta, _, rate = planned(model, point)
    rows, nominal = tip_rows(model), model.kinematics(config)
    J = output_jacobian(model, config, nominal, rows)
    held = (J @ rate + output_bias(config, nominal, zeta, rows))[6:]
    tau = model.inverse_dynamics(nominal, zeta, rate)

    def off(x, x_dot):
        real = configuration_of(model, rows, config, nominal, x)
        J_real = output_jacobian(model, real, model.kinematics(real), rows)
        moved = np.linalg.solve(J_real, J @ zeta + x_dot)
        loads = row_feedforward(model, real, moved, rows, tip_acceleration=held, wrench=tau[:6])
        return np.append(loads.vehicle - loads.vehicle_map @ tau[:6],
                         loads.tip - loads.tip_map @ tau[6:])

    loads, rng = found(model, point), np.random.default_rng(0)
    for column, block in ((0, slice(0, 3)), (1, slice(3, 6)), (2, slice(6, 10))):
        for k in (0, 1):
            largest = np.zeros(4)
            for _ in range(12):
                x = np.zeros((2, 10))
                x[k, block] = rng.normal(size=len(range(10)[block]))
                x *= STEP / np.linalg.norm(x)
                step = x.copy()
                if k == 1 and column == 2:  # ẋ_s = J_sq ẋ_q
                    step[1, 6:] = J[6:, 6:] @ x[1, 6:]
                slope = (off(*step) - off(*-step)) / (2.0 * STEP)
                largest = np.maximum(largest, norms(slope))
            claim = loads.by_error[:, column + 5 * k]
            assert np.all(largest <= claim * (1.0 + 1e-4) + 1e-7)
            assert np.all(largest >= 0.6 * claim - 1e-7), (column, k, largest / claim)


def test_the_maps_turn_with_the_robot(model, point):
    config, zeta, _, _ = planned(model, point)

    def A(step):
        at = config + step * configuration_rate(config, zeta)
        return row_feedforward(model, at, zeta, tip_rows(model), tip_acceleration=np.zeros(4),
                         wrench=np.zeros(6)).vehicle_map

    turning = (A(STEP) - A(-STEP)) / (2.0 * STEP) @ np.linalg.inv(A(0.0))
    expected = [[np.linalg.norm(turning[i, j], 2) for j in BLOCKS[:2]] for i in BLOCKS[:2]]
    np.testing.assert_allclose(found(model, point).turning[:2, :2], expected, rtol=1e-4)


def test_an_axis_without_thrusters_is_left_out(model, point):
    six, five = (found(model, point, driven) for driven in (SIX, FIVE))
    assert five.plan[0] != six.plan[0]
    np.testing.assert_allclose(five.plan[2:], six.plan[2:])
    np.testing.assert_array_less(0.0, five.by_wrench[2, :2])


def test_thrusters_that_are_off_push_the_rows(model, point):
    off = np.zeros((6, 2))
    off[0, 0], off[2, 1] = 3.0, 4.0
    config = planned(model, point)[0]
    J = output_jacobian(model, config, model.kinematics(config), tip_rows(model))
    M = model.mass_matrix(model.kinematics(config))
    expected = sum(np.array(norms(J @ np.linalg.solve(M, np.append(column, np.zeros(4)))))
                   for column in off.T)
    np.testing.assert_allclose(found(model, point, off=off).by_thrusters, expected, rtol=1e-9)


def test_the_input_of_a_force_follows_the_posture(model, point):
    config, zeta, _, rate = planned(model, point)
    tau = model.inverse_dynamics(model.kinematics(config), zeta, rate)

    def u(q):
        return np.linalg.solve(
            model.mass_matrix(model.kinematics(np.append(config[:6], q))), tau)

    slopes = np.array([(u(config[6:] + unit) - u(config[6:] - unit)) / (2.0 * STEP)
                       for unit in STEP * np.eye(4)])
    np.testing.assert_allclose(
        found(model, point).by_posture, np.linalg.norm(slopes, axis=0), rtol=1e-4, atol=1e-8)
