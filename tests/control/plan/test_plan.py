"""Tests of `uvms_drake.control.plan.plan`."""

import numpy as np
import pytest
from pydrake.math import RollPitchYaw

import uvms_drake as uv
from uvms_drake.control.contact.safe_region import apex
from uvms_drake.control.plan.plan import (
    Plan,
    advance,
    advance_derivatives,
    advance_one,
    between_knots,
    stopping_distance,
)
from uvms_drake.model.surface.surface_class import SurfaceClass

H = 0.2  # s
SPEEDS = np.repeat([0.21, 0.16, 0.26], [3, 3, 4])  # m/s, rad/s: nominal limits of the scenarios
ACCELERATIONS = np.repeat([0.25, 1.0], [6, 4])  # m/s², rad/s²


def by_small_steps(config: np.ndarray, zeta: np.ndarray, zeta_dot: np.ndarray,
                   duration: float) -> np.ndarray:
    """Returns 𝔮 after `duration`: midpoint steps on the rotation matrix, extrapolated."""
    def integrate(steps: int) -> tuple[np.ndarray, np.ndarray]:
        dt = duration / steps
        R, p = RollPitchYaw(config[3:6]).ToRotationMatrix().matrix(), config[:3].copy()
        for i in range(steps):
            middle = zeta + (i + 0.5) * dt * zeta_dot
            half = _turn(0.5 * dt * middle[3:6])
            p = p + dt * R @ half @ middle[:3]
            R = R @ _turn(dt * middle[3:6])
        return p, R
    (p1, R1), (p2, R2) = integrate(200), integrate(400)
    p, R = (4.0 * p2 - p1) / 3.0, (4.0 * R2 - R1) / 3.0
    rpy = [np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(R[2, 0]), np.arctan2(R[1, 0], R[0, 0])]
    return np.concatenate(
        [p, rpy, config[6:] + duration * zeta[6:] + 0.5 * duration**2 * zeta_dot[6:]])


def _turn(v: np.ndarray) -> np.ndarray:
    """Returns exp S(v) by Rodrigues' formula."""
    angle = np.linalg.norm(v)
    x, y, z = v / angle
    S = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * S + (1.0 - np.cos(angle)) * S @ S


def random_plan(seed: int, intervals: int = 6, start_time: float = 3.4) -> Plan:
    """Returns a plan as fast as the limits allow: ‖ν₁‖, ‖ν₂‖ at the knots and |ν̇| in between."""
    rng = np.random.default_rng(seed)
    config = rng.uniform(-1.0, 1.0, size=10) * np.array([2, 2, 2, 0.3, 0.3, 3, 1, 1, 0.5, 3])
    zeta = rng.uniform(-1.0, 1.0, size=(intervals + 1, 10))
    for block in (slice(0, 3), slice(3, 6), slice(6, 10)):
        zeta[:, block] /= np.linalg.norm(zeta[:, block], axis=1)[:, None]
    zeta *= SPEEDS
    zeta_dot = np.diff(zeta, axis=0) / H
    zeta_dot = zeta_dot / np.max(np.abs(zeta_dot) / ACCELERATIONS)
    return Plan.from_accelerations(start_time, H, config, zeta[0], zeta_dot)


@pytest.mark.parametrize("seed", range(5))
def test_one_step_is_exact_to_1e_7_at_the_speeds_of_the_vehicle(seed):
    plan = random_plan(seed)
    for k in range(len(plan.zeta_dot)):
        exact = by_small_steps(plan.config[k], plan.zeta[k], plan.zeta_dot[k], H)
        np.testing.assert_allclose(plan.config[k + 1], exact, rtol=0.0, atol=1e-7)


def test_the_acceleration_at_a_knot_is_that_of_the_interval_before():
    """Even if the knot's time is off by rounding; at the very start it is the first interval's."""
    plan = random_plan(3)
    np.testing.assert_array_equal(plan.at(3.4)[2], plan.zeta_dot[0])
    for k in range(1, 7):
        for time in (3.4 + k * H, (17 + k) * H, np.nextafter(3.4 + k * H, 9.0)):
            np.testing.assert_array_equal(plan.at(time)[2], plan.zeta_dot[k - 1])
    for k in range(6):
        np.testing.assert_array_equal(plan.at(3.4 + k * H + 1e-6)[2], plan.zeta_dot[k])
        since = 3.4 + k * H
        np.testing.assert_array_equal(plan.at(since, since)[2], plan.zeta_dot[k])
        np.testing.assert_allclose(plan.at(since, since)[0], plan.at(since)[0], atol=1e-14)
        later = since + 0.5 * H
        np.testing.assert_array_equal(plan.at(later, since), plan.at(later))


def test_between_the_knots_the_plan_is_a_motion():
    """𝔮̄̇ = Γ(𝔮̄)ζ̄ to 1e-6, and the velocity is linear in time."""
    plan, step = random_plan(4), 1e-3
    for time in 3.4 + np.linspace(0.01, 6 * H - 0.01, 41) + 1e-4:
        if abs((time - 3.4) / H - round((time - 3.4) / H)) < 0.02:
            continue  # The stencil must not reach over a knot.
        config, zeta, zeta_dot = plan.at(time)
        before, after = plan.at(time - step), plan.at(time + step)
        rate = (after[0] - before[0]) / (2.0 * step)
        np.testing.assert_allclose(rate, uv.configuration_rate(config, zeta), atol=1e-6)
        np.testing.assert_allclose(after[1] - before[1], 2.0 * step * zeta_dot, atol=1e-14)


def test_the_shifted_plan_goes_on_where_the_plan_was_and_one_interval_further():
    plan, last = random_plan(5), np.linspace(-0.1, 0.1, 10)
    shifted = plan.shifted(last)
    assert shifted.start_time == pytest.approx(3.4 + H)
    for time in np.linspace(3.4 + H + 0.01, 3.4 + 6 * H, 23):
        for old, new in zip(plan.at(time), shifted.at(time), strict=True):
            np.testing.assert_allclose(new, old, atol=1e-12)
    np.testing.assert_array_equal(shifted.zeta_dot[-1], last)
    np.testing.assert_allclose(shifted.zeta[-1], plan.zeta[-1] + H * last, atol=1e-15)
    end = by_small_steps(plan.config[-1], plan.zeta[-1], last, H)
    np.testing.assert_allclose(shifted.config[-1], end, rtol=0.0, atol=1e-7)


def test_one_configuration_in_plain_numbers_advances_as_a_stack_does():
    rng = np.random.default_rng(4)
    for _ in range(20):
        config, zeta, zeta_dot = rng.uniform(-1.0, 1.0, (3, 10))
        np.testing.assert_allclose(advance_one(config, zeta, zeta_dot, H),
                                   advance(config, zeta, zeta_dot, H), atol=1e-15)


def test_the_derivatives_of_a_step_are_those_of_differences(derivative):
    plan = random_plan(5)
    found = advance_derivatives(plan.config[:-1], plan.zeta[:-1], plan.zeta_dot, H)
    arguments = [plan.config[:-1], plan.zeta[:-1], plan.zeta_dot]
    for i, by_argument in enumerate(found):
        for j, direction in enumerate(np.eye(10)):
            def moved(s, i=i, d=direction):
                changed = [value + (s * d if i == which else 0.0)
                           for which, value in enumerate(arguments)]
                return advance(*changed, H)

            np.testing.assert_allclose(by_argument[..., j], derivative(moved), atol=1e-9)


# Against random parabolas and a safe region -------------------------------------------------------


@pytest.mark.parametrize("jerk", [-3.0, 0.0, 3.0])
def test_what_an_acceleration_that_changes_adds(jerk):
    """Between the knots (2/81) h³j, attained by jt²(h − t)/6; of the way of an interval h³j/12."""
    h = 0.2
    t = np.linspace(0.0, h, 3001)
    bulge = jerk * t**2 * (h - t) / 6.0
    assert np.max(np.abs(bulge)) == pytest.approx(2.0 / 81.0 * h**3 * abs(jerk))
    for x0, v0, a0 in np.random.default_rng(5).uniform(-1.0, 1.0, (200, 3)):
        x = x0 + v0 * t + 0.5 * a0 * t**2 + jerk / 6.0 * t**3
        most = max(x[0], x[-1], between_knots(x0, v0, h)) + 2.0 / 81.0 * h**3 * abs(jerk)
        assert np.max(x) <= most + 1e-12
        v = v0 + a0 * h + 0.5 * jerk * h**2
        assert abs(x[-1] - x0 - 0.5 * h * (v0 + v)) == pytest.approx(h**3 * abs(jerk) / 12.0)


def test_where_the_tube_is_thicker_than_what_the_wall_forgives_there_is_no_approach():
    distance = stopping_distance(45.0, 1.0, 20e3, 2.4e-3)
    assert distance == pytest.approx(43.0 / 20e3 - 4.8e-3)
    assert distance < 0.0


def test_a_tip_that_swings_back_reduces_the_distance():
    """After a reading of 0 N + ν of a tip that retreats with 0.1 m/s at c₊ = 2 s/m."""
    surface = SurfaceClass(np.array([1.0, 0.0, 0.0]), 2000.0, dissipation=2.0)
    point, velocity = np.zeros((1, 3)), np.array([[-0.1, 0.0, 0.0]])
    edge = apex(surface, point, velocity, np.array([1.0, 0.0, 0.0]), 45.0, 1.0)[0]
    distance = stopping_distance(45.0, 1.0, 2000.0, 2.4e-3, retreat=0.2)
    assert distance == pytest.approx(edge - 2.0 * 2.4e-3)
    assert distance < stopping_distance(45.0, 1.0, 2000.0, 2.4e-3)
    assert stopping_distance(45.0, 1.0, 2000.0, 0.0, retreat=1.0) == -np.inf
