"""Tests of `tube.actuation.lagged_wrench`: rows whose command comes late, against simulation."""

import numpy as np
import pytest

from uvms_drake.tube.actuation.lagged_wrench import (
    LaggedWrenchTube,
    means_over_ages,
    moments_of_ages,
)
from uvms_drake.tube.loops.row_loop import RowLoop
from uvms_drake.tube.rows.disturbance_gains import ATTITUDE, VEHICLE

K, SIGMA, LAG, PERIOD = 4.0, 3.0, 0.06, 0.02
TURNS = 0.6  # 1/s


def test_the_means_over_ages_are_those_of_a_distribution():
    """Ages of `held` and one that is distributed by the lag, by quadrature."""
    turning, held, lag = np.array([[0.4, 0.1], [0.3, 0.8]]), 0.05, 0.2
    values, vectors = np.linalg.eig(turning)
    more, step = (np.arange(40_000) + 0.5) * 2e-4, 2e-4
    ages, weight = held + more, np.exp(-more / lag) / lag * step
    back = np.linalg.inv(vectors)
    expected = [(vectors * (weight @ each(ages[:, None] * values, ages[:, None]))) @ back
                for each in (lambda x, a: np.exp(x) - 1.0, lambda x, a: (np.exp(x) - 1.0) / (x / a)
                             - a)]
    for found, wanted in zip(means_over_ages(turning, held, lag), expected, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-5)
    assert np.isinf(means_over_ages(turning, held, 2.0)[0]).all()
    grown = np.exp(ages[:, None] * values)
    expected = [(vectors * (weight @ (ages[:, None]**power * grown))) @ back for power in (1, 2)]
    for found, wanted in zip(moments_of_ages(turning, held, lag), expected, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-5)
    assert np.isinf(moments_of_ages(turning, held, 2.0)[0]).all()


def bounds(level, level_rate, smooth):
    """Returns the bounds of e and ė of the first block, by parts that are called a plan's."""
    rows = object.__new__(LaggedWrenchTube)
    loop = RowLoop(K, SIGMA, lag=LAG, period=PERIOD)
    one = np.array([1.0, 0.0])
    rows._K, rows._hold = np.diag([TURNS, 0.0]), PERIOD
    rows._turned, rows._turned_rate = means_over_ages(rows._K, PERIOD, LAG)
    more = {"disturbance": 1.0, "feed_forward": 2.0, "feed_forward_rate": PERIOD + LAG}
    rows._gains = {name: np.array([*loop.gains[name], loop.gains[name].command + each])
                   for name, each in more.items()}
    rows._level, rows._level_rate, rows._smooth = level * one, level_rate * one, smooth * one
    rows._by_arm, rows._tip_w, rows._tip_w_rate = np.zeros(2), 0.0, 0.0
    rows._contact = np.zeros(2)
    rows._known = {VEHICLE: {}, ATTITUDE: {}}
    return sum(part[0] for part in rows._sources(np.zeros(6)).values())


def late_row(rng, level, level_rate, smooth):
    """Returns max |e| and |ė| of ë = w + A(τ_v − τ), τ of w, a level and what is smooth."""
    steps = 10
    step, ticks = PERIOD / steps, 500
    omega, other, third = rng.uniform(0.5, 12.0, 3)
    every, phase = rng.integers(3, 60), rng.uniform(0.0, 6.0)
    sign = 1.0
    e = rate = worst = fast = 0.0
    phi = 0.0
    given = held = None
    time = 0.0
    for tick in range(ticks):
        sign = -sign if tick % every == 0 else sign
        for i in range(steps):
            A = np.exp(TURNS / omega * np.sin(omega * time + phase))
            # A level that jumps, and varies at no more than its rate in between, of what is in A.
            x = sign * level * (1.0 - 0.5 * level_rate / (level * third) * (
                1.0 + np.sin(third * time)))
            w = -(K + SIGMA) * rate - K * SIGMA * e
            tau = w / A + x / A + phi
            if i == 0:
                held = tau
            given = tau if given is None else given
            given += (held - given) * -np.expm1(-step / LAG)
            acceleration = w + A * (given - tau)
            rate += step * acceleration
            e += step * rate
            phi += step * smooth / A * np.sign(np.sin(other * time))
            time += step
            worst, fast = max(worst, abs(e)), max(fast, abs(rate))
    return np.array([worst, fast])


@pytest.mark.parametrize(("level", "level_rate", "smooth", "reached"), [
    (1.0, 0.0, 0.0, 0.5), (1e-6, 0.0, 1.0, 0.5), (0.5, 0.3, 0.6, 0.3)])
def test_no_row_whose_command_comes_late_goes_beyond_its_bound(level, level_rate, smooth, reached):
    """A turns; its level jumps, and what is smooth goes up and down, at all frequencies."""
    rng = np.random.default_rng(0)
    # x is A times the level's torque: that varies by what A turns, besides.
    bound = bounds(level, level_rate + TURNS * level, smooth)[:2]
    found = np.max([late_row(rng, level, level_rate, smooth) for _ in range(6)], axis=0)
    assert np.all(found < bound)
    assert np.all(found > reached * bound)
