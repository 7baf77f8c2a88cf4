"""Tests of the constants of the tube, those of the paper too."""


import numpy as np
import pytest
from support.tiny_robots import drill, drill_attitude_norm, oblique, turret

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.papers.nikou2018 import transpose  # noqa: F401  registers its constants
from uvms_drake.tube.constants import (
    QUANTITIES,
    Constant,
    Quantity,
    checked_constants,
    estimate_constants,
    norms,
    register_constant,
)
from uvms_drake.tube.search.constraint_set import ConstraintSet

BOUNDS = ConstraintSet(
    q_lower=np.array([-0.4, 0.6, -0.1, -0.8]), q_upper=np.array([0.4, 1.3, 0.72, 0.8]), roll=0.3,
    pitch=0.15, tip_pitch=0.4, nu1=0.25, nu2=0.2, qdot=0.3, force_max=32.0)
NAMES = ("J_max", "J_position_max", "J_attitude_max", "Jx_max", "J_dot_max", "J_inv_max",
         "Jx_inv_max", "L_c", "L_c_chi", "L_1", "L_1_chi", "L_2")


@pytest.fixture(scope="module")
def estimated(model) -> dict[str, Constant]:
    return estimate_constants(model, BOUNDS, NAMES, samples=300, safety_factor=1.05)


@pytest.fixture(scope="module")
def state(model) -> tuple[np.ndarray, np.ndarray]:
    """Three states, one of them deep in the wall."""
    config, zeta = BOUNDS.sample(model, 50, np.random.default_rng(4))
    order = np.argsort(model.kinematics(config).chi[:, 0])
    return config[order[[0, 25, -1]]], zeta[order[[0, 25, -1]]]


def fresh(count: int, model, seed: int) -> tuple[np.ndarray, np.ndarray]:
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


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_no_fresh_sample_beats_a_constant(model, estimated, name):
    values = norms(name, model, *fresh(2000 if name.startswith("L_") else 10_000, model, seed=7))
    assert np.max(values) <= estimated[name].sampled_value < estimated[name].value
    assert estimated[name].sampled_value < 2.0 * np.max(values)
    assert estimated[name].value == pytest.approx(1.05 * estimated[name].sampled_value)


@pytest.mark.long
def test_constants_of_the_same_matrix_are_ordered_and_none_is_refuted(model, estimated):
    value = {name: constant.sampled_value for name, constant in estimated.items()}
    assert 1.0 / value["J_inv_max"] < 1.0 / value["Jx_inv_max"] * value["Jx_max"]
    assert value["J_position_max"] < value["J_max"] < value["Jx_max"]
    assert value["J_attitude_max"] < value["J_max"]
    assert value["J_max"] < np.hypot(value["J_position_max"], value["J_attitude_max"])
    assert value["L_c_chi"] <= value["L_c"] and value["L_1_chi"] <= value["L_1"]
    for estimate in checked_constants(model, BOUNDS, tuple(estimated.values()), 3):
        assert 0.9 < estimate.ratio <= 1.0, estimate.name


def test_the_turret_has_the_norm_that_is_written_down():
    """‖J_pos‖² is 1 + L² for turning the vehicle, and L² more with the joint: 1 + 2 L²."""
    bounds = ConstraintSet(np.array([-1.0]), np.array([1.0]), 0.1, 0.1, 0.5, 0.1, 0.1, 0.1)
    found = estimate_constants(
        turret(0.7), bounds, ("J_position_max",), samples=50, safety_factor=1.0)
    assert found["J_position_max"].value == pytest.approx(np.sqrt(1.0 + 2.0 * 0.7**2))


@pytest.mark.parametrize(("pitch", "tip_pitch"), [(0.6, 0.4), (0.4, 0.6)])
def test_the_drill_has_the_norm_that_is_written_down(pitch, tip_pitch):
    bounds = ConstraintSet(np.array([-1.0]), np.array([1.0]), 0.2, pitch, tip_pitch, 0.1, 0.1, 0.1)
    found = estimate_constants(drill(), bounds, ("J_attitude_max",), samples=50, safety_factor=1.0)
    assert found["J_attitude_max"].value == pytest.approx(drill_attitude_norm(0.4), rel=1e-4)


def test_products_are_derivatives_along_the_extended_task_and_the_motion(model, state, derivative):
    config, zeta = state
    y, w = model.task_pose(config), np.random.default_rng(5).normal(size=10)
    found = {name: QUANTITIES[name].product(model, config, zeta, w) for name in NAMES}
    c = derivative(lambda s: (model.kinematics(
        model.configuration(y + s * w)).J_chi @ zeta[..., None])[..., 0], 1e-4)
    np.testing.assert_allclose(found["L_c"], c, atol=1e-7)
    f = derivative(lambda s: model.drift(model.configuration(y + s * w), zeta), 2e-5)
    np.testing.assert_allclose(found["L_1"], f, rtol=1e-4, atol=1e-2)
    f = derivative(lambda s: model.drift(config, zeta + s * w), 2e-5)
    np.testing.assert_allclose(found["L_2"], f, rtol=1e-4, atol=1e-3)
    rate = configuration_rate(config, zeta)
    J_dot = derivative(lambda s: model.kinematics(config + s * rate).J_chi)
    np.testing.assert_allclose(found["J_dot_max"], J_dot @ w, atol=1e-7)
    back = model.kinematics(config).J_chi @ found["J_inv_max"][..., None]
    np.testing.assert_allclose(back[..., 0], np.tile(w[:6], (3, 1)))


@pytest.mark.parametrize("name", NAMES)
def test_products_have_derivatives_by_complex_steps(model, state, name, derivative):
    config, zeta = state
    along, w = np.random.default_rng(6).normal(size=(3, 10)), np.full(10, 0.3)

    def moved(s):
        return QUANTITIES[name].product(
            model, config + s * along[0], zeta + s * along[1], w + s * along[2])

    found = moved(1e-30j).imag / 1e-30
    np.testing.assert_allclose(
        found, derivative(moved, 1e-4), rtol=1e-4, atol=2e-3 * np.max(np.abs(found)))


def test_another_robot_has_its_constants_too():
    bounds = ConstraintSet(-np.ones(2), np.ones(2), 0.3, 0.3, 0.9, 0.1, 0.1, 0.1)
    names = ("J_inv_max", "Jx_inv_max", "L_c", "L_2")
    found = estimate_constants(oblique(), bounds, names, samples=100, safety_factor=1.1)
    assert tuple(found) == names
    assert all(np.isfinite(constant.value) for constant in found.values())


def test_the_name_of_a_constant_is_given_once():
    register_constant("J_max", QUANTITIES["J_max"])
    with pytest.raises(InvalidParameter, match="register_constant = 'J_max': must be another name"):
        register_constant("J_max", Quantity(lambda model, config, zeta, w: w))
