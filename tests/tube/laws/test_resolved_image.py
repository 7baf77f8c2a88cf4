"""Tests of the image of the tube of `uvms_drake.tube.laws.resolved`."""

import numpy as np
import pytest

from uvms_drake.control.laws import Resolved
from uvms_drake.control.laws.law import pair_of
from uvms_drake.tube.laws.resolved import tube_image
from uvms_drake.tube.laws.resolved_remainders import remainders
from uvms_drake.tube.row_gains import input_gain
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.search_problem import nominal_motion

K, SIGMA, D = 20.0, 5.0, 0.1
WEIGHTS = np.array([0.1, 0.1, 0.1, 0.05, 0.1, 0.1, 1.0, 0.5, 0.8, 1.0])
WEIGHTED_GAINS = (0.64, 1.15)
"""Largest ‖J_pŴ‖ and ‖J_oŴ‖, from samples."""
QUICK = {"samples": 40, "forces": False}
"""Few samples."""

pytestmark = pytest.mark.usefixtures("few_searches")
U_LIMITS = np.array([0.4, 0.3, 0.35, 0.4, 0.5, 0.4, 6.0, 8.0, 8.0, 6.0])


@pytest.fixture(scope="module")
def small_set() -> ConstraintSet:
    return ConstraintSet(
        q_lower=np.array([-0.4, 0.6, -0.1, -0.8]), q_upper=np.array([0.4, 1.3, 0.72, 0.8]),
        roll=0.15, pitch=0.15, tip_pitch=0.4, nu1=0.25, nu2=0.2, qdot=0.3, force_max=32.0)


@pytest.fixture(scope="module")
def images(model, small_set, few_searches):
    """Images of a ball and of an ellipsoid."""
    return [tube_image(model, small_set, U_LIMITS, d_bound=D, gains=gains, k=K, sigma=SIGMA,
                       safety_factor=1.1, seed=0, weights=weights, **QUICK)
            for gains, weights in (((1.74, 1.88), np.ones(10)), (WEIGHTED_GAINS, WEIGHTS))]


@pytest.fixture(scope="module")
def image(images):
    return images[0]


@pytest.mark.parametrize(("k", "sigma"), [(20.0, 5.0), (5.0, 20.0), (7.0, 7.0), (40.0, 1.0)])
def test_the_input_gain_is_the_integral_of_the_impulse_response(k, sigma):
    t = np.linspace(0.0, 40.0 / min(k, sigma), 400_001)
    if k == sigma:
        response = (2.0 * k - k**2 * t) * np.exp(-k * t)
    else:
        response = (k**2 * np.exp(-k * t) - sigma**2 * np.exp(-sigma * t)) / (k - sigma)
    assert input_gain(k, sigma) == pytest.approx(np.trapezoid(np.abs(response), t), rel=1e-4)


def test_the_rest_is_what_the_law_itself_leaves(model, small_set):
    """The law as `AncillaryFeedback` computes it, at the state that the errors stand for."""
    rng = np.random.default_rng(1)
    config, zeta = small_set.sample(model, 6, rng)
    for q_bar, z_bar in zip(config, zeta, strict=True):
        u_bar = U_LIMITS * rng.uniform(-1.0, 1.0, 10)
        e, r = 1e-3 * rng.normal(size=10), 1e-3 * rng.normal(size=10)
        y_bar, J_bar, _ = model.task_motion(q_bar, z_bar)
        q = model.configuration(y_bar + e)
        J = model.task_jacobian(q)
        z = np.linalg.solve(J, J_bar @ z_bar - SIGMA * e) + r
        acceleration = u_bar + model.drift(q_bar, z_bar)
        now = pair_of(model, np.concatenate([q, z]), np.concatenate([q_bar, z_bar]))
        u = Resolved(K, SIGMA).command(
            model, now, lambda value=acceleration: value, lambda value=u_bar: value).u
        p = np.linalg.solve(J, e)
        M = model.mass_matrix(model.kinematics(q))
        tau_bar = model.mass_matrix(model.kinematics(q_bar)) @ u_bar
        linear = -(K + SIGMA) * r + SIGMA**2 * p
        expected = np.concatenate([
            z - z_bar - r + SIGMA * p, (q - q_bar)[3:5], u - u_bar - linear,
            M @ u - tau_bar - M @ linear])
        found = remainders(
            model, nominal_motion(model, q_bar, z_bar), u_bar, e, r, K, SIGMA)
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=2e-5)


@pytest.mark.parametrize("which", [0, 1], ids=["ball", "weighted"])
def test_no_disturbance_drives_the_cascade_beyond_the_image(model, small_set, images, which):
    """Bang-bang disturbances through the exact cascade, at nominal states held fixed.

    Random directions, and those of a single channel, which reach its own part of u alone.
    """
    image, weights = images[which], (np.ones(10), WEIGHTS)[which]
    rng = np.random.default_rng(2)
    config, zeta = small_set.sample(model, 60, rng)
    u, nominal = U_LIMITS * rng.uniform(-1.0, 1.0, zeta.shape), nominal_motion(model, config, zeta)
    direction = rng.normal(size=zeta.shape)
    direction[:10] = np.eye(10)
    direction *= weights / np.linalg.norm(direction, axis=1)[:, None]
    J = model.task_jacobian(config)
    e, r, dt, worst = np.zeros_like(zeta), np.zeros_like(zeta), 2e-3, np.zeros(10)
    switch = 2.0 * np.log(K / SIGMA) / (K - SIGMA)
    for step in range(1500):
        sign = -1.0 if step * dt > 3.0 - switch else 1.0
        r = r + dt * (-K * r + sign * D * direction)
        e = e + dt * (-SIGMA * e + (J @ r[..., None])[..., 0])
        if step % 20 == 0 or step * dt > 3.0 - switch:
            p = np.linalg.solve(J, e[..., None])[..., 0]
            du = remainders(model, nominal, u, e, r, K, SIGMA)[:, 12:22]
            du = du - (K + SIGMA) * r + SIGMA**2 * p
            worst = np.maximum(worst, np.max(np.abs(du) / image.radii.u, axis=0))
    assert np.max(worst) <= 1.0
    assert np.max(worst) > (0.4, 0.25)[which]  # and the image is not idle


def test_no_error_of_the_ellipsoid_tilts_the_vehicle_beyond_the_image(model, small_set, images):
    """𝔢_y = J_x(𝔮)𝔭, 𝔮 found by iteration; joints that are pushed hard leave the hull alone."""
    ball, image = (each.radii for each in images)
    rng = np.random.default_rng(4)
    config, _ = small_set.sample(model, 4000, rng)
    y = model.task_pose(config)
    p = rng.normal(size=y.shape)
    p *= WEIGHTS * D / (K * SIGMA) / np.linalg.norm(p, axis=1)[:, None]
    e = np.zeros_like(y)
    for _ in range(5):
        e = (model.task_jacobian(model.configuration(y + e)) @ p[..., None])[..., 0]
    tilt = np.max(np.abs(model.configuration(y + e) - config)[:, 3:5], axis=0)
    assert np.all(tilt <= [image.roll, image.pitch])
    assert max(image.roll, image.pitch) < 0.2 * min(ball.roll, ball.pitch)


def test_what_counts_is_the_product_of_bound_and_weights(model, small_set, images):
    """Also where no weight is 1; the shift and the rests of second order have products of both."""
    same = tube_image(
        model, small_set, U_LIMITS, d_bound=4.0 * D, k=K, sigma=SIGMA,
        gains=(0.25 * WEIGHTED_GAINS[0], 0.25 * WEIGHTED_GAINS[1]), safety_factor=1.1, seed=0,
        weights=0.25 * WEIGHTS, **QUICK)
    np.testing.assert_allclose(same.omega, images[1].omega, rtol=1e-6)
    for name in ("nu1", "nu2", "qdot", "z", "roll", "pitch", "u"):
        np.testing.assert_allclose(
            getattr(same.radii, name), getattr(images[1].radii, name), rtol=1e-6)


def test_a_slow_loop_has_no_image(model, small_set):
    """If the task turns faster than the law corrects, σ ≤ ω, nothing is bounded."""
    slow = tube_image(model, small_set, U_LIMITS, d_bound=D, gains=(1.74, 1.88), k=K, sigma=0.3,
                      safety_factor=1.1, seed=0, **QUICK)
    assert slow.omega > 0.3
    assert np.all(np.isinf(slow.radii.u))


def test_forces_have_an_image_only_if_they_are_wanted(model, small_set, image):
    forced = tube_image(model, small_set, U_LIMITS, d_bound=D, gains=(1.74, 1.88), k=K,
                         sigma=SIGMA, safety_factor=1.1, seed=0, **QUICK | {"forces": True})
    assert image.radii.tau is None
    # Few climbers, by chance; those of τ find motions for u, so that it is searched for better.
    ratio = forced.radii.u / image.radii.u
    assert np.min(ratio) > 0.95
    assert np.median(ratio) < 1.1
    M = model.mass_matrix(model.kinematics(small_set.sample(
        model, 200, np.random.default_rng(6))[0]))
    assert forced.radii.tau is not None
    assert np.all(  # 𝔲 alone makes that.
        forced.radii.tau > D * np.linalg.norm(M, axis=2).max(axis=0))
    assert "remainder of τ[0]" in {estimate.name for estimate in forced.check()}


def test_a_ball_has_a_proven_attitude_and_all_else_an_estimate(images):
    names = [{estimate.name for estimate in image.check()} for image in images]
    assert names[1] - names[0] == {"α", "remainder of φ", "remainder of θ"}
    assert {"ω", "remainder of ν₁", "remainder of u[9]"} <= names[0]
