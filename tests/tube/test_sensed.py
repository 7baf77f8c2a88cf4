"""What a felt contact costs the tube, against the dynamics themselves."""

import numpy as np
import pytest

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.tube.sensed import (
    contact_gain,
    contact_input_rest,
    sensor_share,
    supremum_over_joints,
)

LOWER, UPPER = np.array([-0.4, 0.6, -0.1, -0.8]), np.array([0.4, 1.3, 0.72, 0.8])


def poses(count: int, seed: int) -> np.ndarray:
    """Returns configurations 𝔮 (count, 10) with joints in the box and any attitude."""
    rng = np.random.default_rng(seed)
    config = rng.uniform(-0.5, 0.5, (count, 10))
    config[:, 6:] = rng.uniform(LOWER, UPPER, (count, 4))
    return config


def acceleration_for(model: ContactModel, config: np.ndarray, contact: np.ndarray) -> np.ndarray:
    """Returns the difference that 𝔉 in the law makes to the acceleration: M⁻¹ of that of τ."""
    kinematics, rest = model.kinematics(config), np.zeros_like(config)
    tau = [model.inverse_dynamics(kinematics, rest, rest, contact=force)
           for force in (contact, np.zeros_like(contact))]
    return np.linalg.solve(model.mass_matrix(kinematics), (tau[0] - tau[1])[..., None])[..., 0]


def test_the_gain_is_that_of_the_inverse_dynamics(model):
    """𝔉 has its force in Σ_I and its torque along Euler rates: A(𝔬)ᵀ𝔉 is the wrench in the tip."""
    config = poses(40, 1)
    contact = np.random.default_rng(2).normal(size=(40, 6))
    wrench = (contact[:, None, :] @ model.kinematics(config).A_E)[:, 0]
    expected = acceleration_for(model, config, contact)
    found = (contact_gain(model, config[:, 6:]) @ wrench[..., None])[..., 0]
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_an_error_of_the_sensor_takes_no_more_than_its_share_and_nearly_so(model):
    weight = np.array([0.03] * 6 + [0.4] * 4)
    share = sensor_share(model, LOWER, UPPER, weight, 0.5, 0.02)
    gain = contact_gain(model, poses(4000, 4)[:, 6:]) / weight[:, None]
    worst = [np.linalg.svd(gain[..., part])[2][:, 0] for part in (slice(0, 3), slice(3, 6))]
    both = np.stack([np.concatenate([0.5 * worst[0], sign * 0.02 * worst[1]], axis=1)
                     for sign in (-1.0, 1.0)])
    taken = np.linalg.norm((gain @ both[..., None])[..., 0], axis=-1)
    assert 0.93 * share < taken.max() <= share


def test_the_share_is_linear_in_the_errors_and_inverse_in_the_weights(model):
    weight = np.array([0.03] * 6 + [0.4] * 4)
    share = sensor_share(model, LOWER, UPPER, weight, 0.5, 0.02)
    assert sensor_share(model, LOWER, UPPER, 2.0 * weight, 1.5, 0.06) == pytest.approx(1.5 * share)


def test_the_input_of_a_contact_differs_by_no_more_than_its_rest(model):
    """Between two poses of a tube, the input for the same force in Σ_I."""
    joints, orientation, size = 1e-3, 2e-3, 45.0
    rest = contact_input_rest(model, LOWER, UPPER, size, joints, orientation)
    rng, nominal = np.random.default_rng(5), poses(3000, 6)
    y = model.task_pose(nominal)
    error = rng.normal(size=y.shape)
    error[:, :3] = 0.0
    error[:, 3:6] *= orientation / np.linalg.norm(error[:, 3:6], axis=1, keepdims=True)
    error[:, 6:] *= joints / np.linalg.norm(error[:, 6:], axis=1, keepdims=True)
    real = model.configuration(y + error)
    contact = np.zeros((3000, 6))
    contact[:, :3] = rng.normal(size=(3000, 3))
    contact[:, :3] *= size / np.linalg.norm(contact[:, :3], axis=1, keepdims=True)
    difference = np.abs(acceleration_for(model, real, contact)
                        - acceleration_for(model, nominal, contact))
    assert np.all(difference.max(axis=0) <= 1.01 * rest)
    assert np.all(difference.max(axis=0) > 0.3 * rest)


def test_the_search_finds_the_maximum_of_a_known_function():
    """−‖q − c‖² and a corner's value, in boxes of one to five joints."""
    for size in (1, 3, 5):
        lower, upper = -np.ones(size), 2.0 * np.ones(size)
        centre = np.linspace(-0.7, 1.3, size)

        def values(q: np.ndarray, centre: np.ndarray = centre) -> np.ndarray:
            return np.stack([-np.sum((q - centre) ** 2, axis=1), q.sum(axis=1)], axis=1)

        found = supremum_over_joints(values, lower, upper)
        assert found[0] == pytest.approx(0.0, abs=1e-3)
        assert found[1] == pytest.approx(2.0 * size)
