"""Tests of the constants of the tube, those of the paper too, and of `climb`, which maximises."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support.tiny_robots import drill, drill_attitude_norm, oblique, turret

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.frames.euler import wrap_angle
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.papers.nikou2018.transpose import DRIFT, VELOCITY, drift_matrices, velocity_matrices
from uvms_drake.tube.constants import (
    JACOBIAN,
    QUANTITIES,
    RATE,
    Constant,
    Quantity,
    estimate_constants,
    rate_matrices,
    register_constant,
    sampled_values,
)
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.local_search import climb

pytestmark = pytest.mark.long

BOUNDS = ConstraintSet(
    q_lower=np.array([-0.4, 0.6, -0.1, -0.8]), q_upper=np.array([0.4, 1.3, 0.72, 0.8]), roll=0.3,
    pitch=0.15, tip_pitch=0.4, nu1=0.25, nu2=0.2, qdot=0.3, force_max=32.0)
GROUPS = (JACOBIAN, RATE, VELOCITY, DRIFT)
NAMES = tuple(QUANTITIES)
OF_JACOBIAN, OF_RATE, OF_VELOCITY, OF_DRIFT = (
    tuple(name for name, item in QUANTITIES.items() if item.group is group) for group in GROUPS)


@pytest.fixture(scope="module")
def estimated(model) -> dict[str, Constant]:
    return estimate_constants(model, BOUNDS, NAMES, samples=1500)


@pytest.fixture(scope="module")
def state(model) -> tuple[np.ndarray, np.ndarray]:
    """Three states, one of them deep in the wall."""
    config, zeta = BOUNDS.sample(model, 50, np.random.default_rng(4))
    order = np.argsort(model.kinematics(config).chi[:, 0])
    return config[order[[0, 25, -1]]], zeta[order[[0, 25, -1]]]


def fresh(model, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns states of the set drawn without its own sampler: uniform, all by rejection."""
    rng = np.random.default_rng(seed)
    parts: list[np.ndarray] = []
    while sum(map(len, parts)) < count:
        config = np.zeros((5000, 10))
        config[:, 3:] = rng.uniform(*BOUNDS.box, size=(5000, 7))
        chi = model.kinematics(config).chi
        config[:, 0] = rng.uniform(-0.01, 0.033, 5000) - chi[:, 0]
        parts.append(config[np.abs(chi[:, 4]) <= BOUNDS.tip_pitch])
    config = np.concatenate(parts)[:count]
    blocks = []
    for size, radius in ((3, BOUNDS.nu1), (3, BOUNDS.nu2), (4, BOUNDS.qdot)):
        direction = rng.normal(size=(count, size))
        blocks.append(radius * direction / np.linalg.norm(direction, axis=1, keepdims=True)
                      * rng.uniform(size=(count, 1)) ** 0.1)
    return config, np.concatenate(blocks, axis=1)


@pytest.mark.parametrize(("names", "count"), [
    (OF_JACOBIAN, 40_000), (OF_RATE + OF_VELOCITY, 12_000), (OF_DRIFT, 4000)])
def test_no_fresh_sample_beats_a_constant(model, estimated, names, count):
    config, zeta = fresh(model, count, seed=7)
    for name, values in sampled_values(model, config, zeta, names).items():
        if QUANTITIES[name].is_infimum:
            assert np.min(values) >= estimated[name].sampled_value > estimated[name].value, name
        else:
            assert np.max(values) <= estimated[name].sampled_value < estimated[name].value, name


def test_local_maximisation_improves_on_the_samples(model, estimated):
    config, zeta = BOUNDS.sample(model, 1500, np.random.default_rng(0))
    for name, values in sampled_values(model, config, zeta, NAMES).items():
        sampled = estimated[name].sampled_value
        if QUANTITIES[name].is_infimum:
            assert sampled < np.min(values), name
        else:
            assert sampled > np.max(values), name
    assert estimated["J_dot_max"].sampled_value > 1.05 * np.max(
        sampled_values(model, config, zeta, ("J_dot_max",))["J_dot_max"])


def test_the_worst_state_is_in_the_set_and_has_the_value(model, estimated):
    for name, constant in estimated.items():
        config, zeta = constant.worst["config"][None], constant.worst["zeta"][None]
        assert BOUNDS.contains(model, config, zeta)[0], name
        value = sampled_values(model, config, zeta, (name,))[name][0]
        assert value == pytest.approx(constant.sampled_value, rel=1e-9), name


def test_the_safety_factor_is_on_the_safe_side(estimated):
    for name, constant in estimated.items():
        assert (constant.how, constant.samples, constant.safety_factor) == ("estimated", 1500, 1.05)
        factor = 1.0 / 1.05 if name == "J_min" else 1.05
        assert constant.value == pytest.approx(factor * constant.sampled_value)


def test_constants_of_the_same_matrix_are_ordered(estimated):
    value = {name: constant.sampled_value for name, constant in estimated.items()}
    assert np.sqrt(value["J_min"]) < 1.0 / value["Jx_inv_max"] * value["Jx_max"]
    assert value["J_position_max"] < value["J_max"] < value["Jx_max"]
    assert value["J_attitude_max"] < value["J_max"]
    assert value["J_max"] < np.hypot(value["J_position_max"], value["J_attitude_max"])
    assert value["L_c_chi"] <= value["L_c"] and value["L_1_chi"] <= value["L_1"]


def test_the_seed_decides(model):
    names = ("J_max", "L_c")
    first, again, other = (estimate_constants(model, BOUNDS, names, samples=200, seed=seed)
                           for seed in (3, 3, 4))
    for name in names:
        assert first[name].to_data() == again[name].to_data()
        assert first[name].to_data() != other[name].to_data()


def test_a_constant_survives_json(estimated):
    for constant in estimated.values():
        back = Constant.from_data(json.loads(json.dumps(constant.to_data())))
        assert back.to_data() == constant.to_data()
        assert np.array_equal(back.worst["config"], constant.worst["config"])


def test_the_turret_has_the_norm_that_is_written_down():
    """‖J_pos‖² is 1 + L² for turning the vehicle, and L² more with the joint: 1 + 2 L²."""
    bounds = ConstraintSet(np.array([-1.0]), np.array([1.0]), 0.1, 0.1, 0.5, 0.1, 0.1, 0.1)
    found = estimate_constants(turret(0.7), bounds, ("J_position_max",), samples=50)
    assert found["J_position_max"].sampled_value == pytest.approx(np.sqrt(1.0 + 2.0 * 0.7**2))


@pytest.mark.parametrize(("pitch", "tip_pitch"), [(0.6, 0.4), (0.4, 0.6)])
def test_the_drill_has_the_norm_that_is_written_down(pitch, tip_pitch):
    bounds = ConstraintSet(np.array([-1.0]), np.array([1.0]), 0.2, pitch, tip_pitch, 0.1, 0.1, 0.1)
    found = estimate_constants(drill(), bounds, ("J_attitude_max",), samples=50)
    assert found["J_attitude_max"].sampled_value == pytest.approx(
        drill_attitude_norm(0.4), rel=1e-4)


def test_derivatives_in_y_are_those_along_the_extended_task(model, state, derivative):
    config, zeta = state
    y = model.task_pose(config)
    by_y = velocity_matrices(model, config, zeta) | drift_matrices(model, config, zeta)
    for i in range(10):
        moved = np.eye(10)[i]
        c = derivative(lambda s, v=moved: (model.kinematics(
            model.configuration(y + s * v)).J_chi @ zeta[..., None])[..., 0], 1e-4)
        np.testing.assert_allclose(by_y["c_y"][..., i], c, atol=1e-8)
        f = derivative(lambda s, v=moved: model.drift(
            model.configuration(y + s * v), zeta), 2e-5)
        np.testing.assert_allclose(by_y["f_y"][..., i], f, rtol=1e-4, atol=1e-2)


def test_with_the_joints_held_chi_moves_and_q_does_not(model, state):
    """The first six columns of ∂𝔮/∂y move the vehicle alone."""
    config, _ = state
    y = model.task_pose(config)
    y[:, :6] += 1e-3
    moved = model.configuration(y)
    assert np.array_equal(moved[:, 6:], config[:, 6:])
    chi = model.kinematics(moved).chi - model.kinematics(config).chi
    np.testing.assert_allclose(wrap_angle(chi), 1e-3, rtol=1e-6)


def test_j_dot_is_the_rate_of_j(model, state, derivative):
    config, zeta = state
    rate = configuration_rate(config, zeta)
    expected = derivative(lambda s: model.kinematics(config + s * rate).J_chi)
    np.testing.assert_allclose(rate_matrices(model, config, zeta)["J_dot"], expected, atol=1e-8)


@pytest.mark.parametrize("group", GROUPS)
def test_a_product_is_the_matrix_times_the_vector(model, state, group):
    v = np.random.default_rng(5).normal(size=10)
    for name, matrix in group.matrices(model, *state).items():
        np.testing.assert_allclose(
            group.product(model, name, *state, v), matrix @ v, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_the_gradient_of_a_singular_value_is_its_derivative(model, state, name, derivative):
    quantity = QUANTITIES[name]
    config, zeta = state[0][1], state[1][1]
    direction = np.random.default_rng(6).normal(size=20)
    value, gradient = quantity.value_and_gradient(model, config, zeta)

    def along(s: float) -> float:
        moved = np.concatenate([config, zeta]) + s * direction
        return quantity.value_and_gradient(model, moved[:10], moved[10:])[0]
    assert along(0.0) == value
    assert gradient @ direction == pytest.approx(derivative(along, 1e-5), rel=1e-3, abs=1e-5)


def test_climb_finds_the_maximum_of_a_simple_function_at_a_corner(model):
    """Σ q is largest where all joints are at their upper limits, and speed on its sphere."""
    def value_and_gradient(config, zeta):
        gradient = np.concatenate([np.zeros(6), np.ones(4), np.ones(3), np.zeros(7)])
        return float(np.sum(config[6:]) + np.sum(zeta[:3])), gradient
    loose = replace(BOUNDS, roll=1.0, pitch=1.0, tip_pitch=1.5)
    config, zeta = loose.sample(model, 1, np.random.default_rng(0))
    value, config, zeta = climb(value_and_gradient, model, loose, config[0], zeta[0])
    assert value == pytest.approx(np.sum(BOUNDS.q_upper) + np.sqrt(3.0) * BOUNDS.nu1, rel=1e-3)
    assert loose.contains(model, config[None], zeta[None])[0]


def test_climb_never_returns_less_than_the_start(model):
    def deceptive(config, zeta):
        return float(-np.sum(config[6:] ** 2)), np.concatenate([np.zeros(6), np.ones(14)])
    config, zeta = BOUNDS.sample(model, 1, np.random.default_rng(0))
    assert climb(deceptive, model, BOUNDS, config[0], zeta[0])[0] >= deceptive(config[0], None)[0]


def test_another_robot_has_its_constants_too():
    bounds = ConstraintSet(-np.ones(2), np.ones(2), 0.3, 0.3, 0.9, 0.1, 0.1, 0.1)
    names = ("J_min", "Jx_inv_max", "L_c", "L_2")
    found = estimate_constants(oblique(), bounds, names, samples=100)
    assert tuple(found) == names
    assert all(np.isfinite(constant.value) for constant in found.values())


@pytest.mark.parametrize("arguments", [
    {"samples": 0}, {"safety_factor": 0.9}, {"safety_factor": np.nan}])
def test_arguments_without_meaning_are_reported(model, arguments):
    with pytest.raises(InvalidParameter, match=next(iter(arguments))):
        estimate_constants(model, BOUNDS, NAMES, **arguments)


def test_the_name_of_a_constant_is_given_once():
    register_constant("J_max", QUANTITIES["J_max"])
    with pytest.raises(InvalidParameter, match="register_constant = 'J_max': must be another name"):
        register_constant("J_max", Quantity(JACOBIAN, "J_x"))
    assert QUANTITIES["J_max"].matrix == "J"
