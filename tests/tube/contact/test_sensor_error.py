"""Tests of `uvms_drake.tube.contact.sensor_error`: a felt contact against the dynamics."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from support.force_reading import reading_off

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.tube.contact import sensor_error
from uvms_drake.tube.contact.sensor_error import (
    MeasuredForceBounds,
    SensorEffect,
    contact_input_remainder,
    ripple,
    sensor_effect_of,
)
from uvms_drake.tube.contact.sensor_gains import (
    norms_over_joints,
    suprema_of,
    tip_jacobian_and_gain,
)
from uvms_drake.tube.contact.sensor_gains_proof import Claimed
from uvms_drake.tube.estimates import CertificateSettings, no_estimates
from uvms_drake.tube.row_gains import instant_gains
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.joint_search import second_over_joints, supremum_over_joints

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
    found = (tip_jacobian_and_gain(model, config[:, 6:])[1] @ wrench[..., None])[..., 0]
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-12)


FORCE = MeasuredForceBounds(size=50.0, rate=80.0, ripple=5.0, tangential_rate=40.0,
                            tangential_ripple=2.0, tool_angle=0.25,
                            reading=reading_off(2.7, 0.05, 0.02, 0.01))
NOTHING = reading_off(0.0, 0.0, 0.02, 0.01)
DECLARED = ConstraintSet(q_lower=LOWER, q_upper=UPPER, roll=0.15, pitch=0.15, tip_pitch=0.4,
                         nu1=0.15, nu2=0.1, qdot=0.3)
K, SIGMA, STEP = 50.0, 40.0, 2.5e-4


@pytest.fixture(scope="module", autouse=True)
def searched_once(model) -> Iterator[None]:
    """Suprema of DECLARED and the tool's angle of FORCE, which do not depend on the forces."""
    sizes, box = norms_over_joints(model, DECLARED, FORCE.tool_angle)
    claimed = Claimed(suprema_of(supremum_over_joints(sizes, *box)), False, no_estimates)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sensor_error, "claimed_suprema", lambda *_, **__: claimed)
        yield


@pytest.fixture(scope="module")
def sensor_effect(model, searched_once) -> SensorEffect:
    return sensor_effect_of(model, DECLARED, FORCE, K, SIGMA)


def held_readings(force: np.ndarray) -> np.ndarray:
    """Returns what a sensor with the lag and the period of FORCE makes of a signal (T, ...)."""
    kept, every = np.exp(-STEP / FORCE.lag), round(FORCE.period / STEP)
    seen, held, out = force[0], force[0], np.empty_like(force)
    for i, now in enumerate(force):
        held = seen if i % every == 0 else held
        out[i] = held
        seen = kept * seen + (1.0 - kept) * now
    return out


def rows_after(delta: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns e, ė and 𝔯 (T, ...) of the cascade 𝔯̇ = −k𝔯 + δ, ė = −σe + 𝔯, from zero."""
    e, r, out = np.zeros_like(delta[0]), np.zeros_like(delta[0]), []
    grow, fade = np.exp(-SIGMA * STEP), np.exp(-K * STEP)
    for now in delta:
        steady = now / K
        r_next = steady + (r - steady) * fade
        e = e * grow + (1.0 - grow) / SIGMA * 0.5 * (r + r_next)
        r = r_next
        out.append((e, r - SIGMA * e, r))
    return tuple(map(np.array, zip(*out, strict=True)))


def adversarial(A: np.ndarray, n: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Returns errors e (T, 3) of a force that does its worst to one row of A (3, 3).

    Ripples by the sign of the row's response to them; slow parts and errors in one direction.
    """
    time = STEP * np.arange(round(0.8 / STEP))
    pulses = np.eye(160)[np.minimum(np.arange(len(time)) // 20, 159)]
    late = rows_after(held_readings(pulses) - pulses)[0][-1]  # of a unit force in each 5 ms
    sign = np.repeat(np.sign(late), 20)[: len(time), None]
    along, across = row @ n, row - (row @ n) * n
    normal = np.sign(along) * (FORCE.ripple * sign) * n
    aside = FORCE.tangential_ripple * sign * across / np.linalg.norm(across)
    ramp = time[:, None] * (-np.sign(along) * FORCE.rate * n
                            - FORCE.tangential_rate * across / np.linalg.norm(across))
    force = normal + aside + ramp
    return held_readings(force) - force + FORCE.error * row / np.linalg.norm(row)


def test_no_force_of_the_class_moves_the_tip_further_and_one_moves_it_nearly_so_far(
        model, sensor_effect):
    """Robots that stand still, so that nothing but the sensor's errors pushes."""
    rng, worst = np.random.default_rng(7), np.zeros(3)
    for q in rng.uniform(LOWER, UPPER, (20, 4)):
        config = np.concatenate([np.zeros(6), q])
        J_E = model.kinematics(config).J_links[-1]
        A = (J_E @ tip_jacobian_and_gain(model, q)[1])[:3, :3]
        off, about = FORCE.tool_angle * np.sqrt(rng.uniform()), rng.uniform(0.0, 2.0 * np.pi)
        n = np.array([np.cos(off), np.sin(off) * np.cos(about), np.sin(off) * np.sin(about)])
        e, speed, _ = rows_after(adversarial(A, n, n @ A) @ A.T)
        worst = np.maximum(worst, [np.max(np.abs(e @ n)), np.max(np.abs(speed @ n)),
                                   np.max(np.linalg.norm(e, axis=1))])
    bounds = np.array([sensor_effect.depth, sensor_effect.depth_speed, sensor_effect.position])
    assert np.all(worst <= bounds)
    assert worst[0] > 0.6 * bounds[0], worst / bounds


def test_the_joints_are_pushed_as_far_as_their_own_bounds_say(model, sensor_effect):
    rng, worst = np.random.default_rng(8), np.zeros(3)
    for q in rng.uniform(LOWER, UPPER, (8, 4)):
        B = tip_jacobian_and_gain(model, q)[1][6:, :3]
        row = B[2]
        e, speed, r = rows_after(adversarial(B[:3], np.array([1.0, 0.0, 0.0]), row) @ B.T)
        worst = np.maximum(worst, [np.max(np.linalg.norm(each, axis=1)) for each in (e, speed, r)])
    bounds = np.array([sensor_effect.p[2], sensor_effect.z[2], sensor_effect.r[2]])
    assert np.all(worst <= bounds)
    assert worst[0] > 0.5 * bounds[0], worst / bounds


def test_a_source_that_is_not_there_takes_nothing_and_the_parts_add_up(model):
    quiet = replace(FORCE, rate=0.0, ripple=0.0, tangential_rate=0.0, tangential_ripple=0.0,
                    size=0.0)
    still = sensor_effect_of(model, replace(DECLARED, nu2=1e-9, qdot=1e-9), quiet, K, SIGMA)
    for parts, total in ((still.budget["depth"], still.depth),
                         (still.budget["position"], still.position)):
        assert sum(parts.values()) == pytest.approx(total)
        assert parts["static reading"] == pytest.approx(total)
    nothing = sensor_effect_of(
        model, DECLARED, replace(quiet, reading=NOTHING), K, SIGMA)
    assert nothing.position == nothing.orientation == nothing.tip_speed == 0.0
    assert not np.any(np.concatenate([nothing.r, nothing.p, nothing.z, nothing.u, nothing.w]))
    # Rows whose axes turn while the robot moves are pushed by 𝔯, whatever the force does.
    moving = sensor_effect_of(model, DECLARED, quiet, K, SIGMA)
    assert still.position < moving.position < 1.2 * still.position
    assert still.orientation < moving.orientation < 1.2 * still.orientation
    # A tip that turns while a reading is held pushes the rows, and the input takes the reading.
    turning = sensor_effect_of(model, DECLARED, replace(
        quiet, reading=NOTHING, size=50.0), K, SIGMA)
    gains = instant_gains(K, SIGMA)
    np.testing.assert_allclose(turning.w / turning.p, (1.0 + gains.input) / gains.position)


def test_the_input_of_a_contact_differs_by_no_more_than_its_rest(model):
    """Between two poses of a tube, 𝔲 and τ for the same force in Σ_I."""
    joints, orientation, size = 1e-3, 2e-3, 45.0
    rest, check = contact_input_remainder(
        model, DECLARED, size, joints, orientation, CertificateSettings(safety_factor=1.0))
    assert 0.99 < check()[0].ratio < 1.01
    remainders = np.split(rest, 2)
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

    def forces_for(config: np.ndarray) -> np.ndarray:
        J_p = model.kinematics(config).J_chi[:, :3]
        return np.einsum("mci,mc->mi", J_p, contact[:, :3])

    for rest, difference in zip(remainders, (
            acceleration_for(model, real, contact) - acceleration_for(model, nominal, contact),
            forces_for(real) - forces_for(nominal)), strict=True):
        largest = np.abs(difference).max(axis=0)
        assert np.all(largest <= 1.01 * rest + 1e-9)
        assert np.all(largest >= 0.3 * rest)


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
        second = second_over_joints(values, lower, upper)
        assert np.all(second <= found + 1e-3)
        assert second[0] > -0.05 * size
        assert second[1] == pytest.approx(2.0 * size)


TIME = np.sort(np.random.default_rng(0).uniform(0.0, 5.0, 200))


@pytest.mark.parametrize("rate", [0.0, 0.7, 5.0])
def test_it_is_half_of_what_two_instants_differ_by_beyond_the_rate(rate):
    signal = np.random.default_rng(1).normal(size=(200, 2)).cumsum(axis=0)
    differ = np.linalg.norm(signal[:, None] - signal[None], axis=2) - rate * np.abs(
        TIME[:, None] - TIME[None])
    assert ripple(TIME, signal, rate) == pytest.approx(0.5 * np.max(differ))


def test_a_slow_signal_with_a_square_wave_has_the_size_of_the_wave():
    signal = 3.0 * np.sin(TIME) + 0.25 * np.sign(np.sin(40.0 * TIME))
    assert ripple(TIME, signal[:, None], 3.0) == pytest.approx(0.25, rel=0.1)
    assert ripple(TIME, 3.0 * np.sin(TIME)[:, None], 3.0) == 0.0
