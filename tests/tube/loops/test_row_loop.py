"""Tests of `tube.loops.row_loop`, against closed forms and a simulation of all pulses."""

import numpy as np
import pytest
from support.transfer import largest

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.tube.loops.row_gains import instant_gains
from uvms_drake.tube.loops.row_loop import RowLoop

STEPS = 8
"""Pulses in a period."""


@pytest.mark.parametrize(("k", "sigma"), [(1.5, 0.4), (20.0, 10.0), (5.0, 5.0)])
def test_without_lag_and_clock_it_is_the_row_of_the_closed_form(k, sigma):
    row, expected = RowLoop(k, sigma), instant_gains(k, sigma)
    gains, system = row.gains, row._system
    np.testing.assert_allclose(system.loop.flow_gain(system.delta), expected[:3], rtol=3e-3)
    np.testing.assert_allclose(gains["disturbance"], expected[:3])
    found = system.loop.flow_moment(system.delta)  # up to two periods more
    assert np.all((found > row.moment) & (found < 1.2 * np.array(row.moment)))
    assert gains["disturbance"].position >= 1.0 / (k * sigma)
    np.testing.assert_array_equal(gains["feed_forward"], 0.0)


@pytest.mark.parametrize("lag", [0.15, 0.3])
@pytest.mark.parametrize("rate", [0.0, 2.0])
def test_behind_a_lag_it_is_the_transfer_function(lag, rate):
    """The formulas of the module, typed again; each term of them matters."""
    k, sigma, T = 2.0, 0.6, lag
    D = [T, 1.0, k + sigma, k * sigma]
    gains = RowLoop(k, sigma, observer=rate, lag=lag).gains
    if rate:
        D_observed = np.polymul([1.0, rate], D)
        by_delta = [T, 1.0 + rate * T, 0.0]
    else:
        D_observed, by_delta = D, [T, 1.0]
    assert gains["disturbance"].position == pytest.approx(largest(by_delta, D_observed), rel=3e-3)
    assert gains["disturbance"].velocity == pytest.approx(
        largest([*by_delta, 0.0], D_observed), rel=3e-3)
    assert gains["feed_forward"].position == pytest.approx(largest([T, 0.0], D), rel=3e-3)
    assert gains["feed_forward_rate"].position == pytest.approx(largest([T], D), rel=3e-3)
    assert gains["feed_forward"].command == pytest.approx(
        largest([T * (k + sigma), T * k * sigma, 0.0], D), rel=3e-3)


@pytest.mark.parametrize("lag", [0.0, 0.3])
def test_a_wave_is_as_large_as_the_transfer_function(lag):
    k, sigma, rate, omega = 2.0, 0.6, 2.0, 1.05
    s = 1j * omega
    e = s * (lag * s + 1.0 + lag * rate) / (
        (s + rate) * (lag * s**3 + s**2 + (k + sigma) * s + k * sigma))
    found = RowLoop(k, sigma, rate, lag).wave(omega)
    np.testing.assert_allclose(found[:2], [abs(e), abs(s * e)], rtol=1e-6)
    assert found.command == pytest.approx(abs((k + sigma) * s * e + k * sigma * e + rate / (
        s + rate)), rel=1e-6)
    sampled = RowLoop(k, sigma, rate, lag, period=0.002).wave(omega)
    np.testing.assert_allclose(sampled, found, rtol=0.01)
    assert np.isinf(RowLoop(20.0, 5.0, lag=0.3).wave(omega)).all()


def test_it_is_unstable_beyond_rouths_limit():
    k, sigma = 20.0, 5.0
    limit = (k + sigma) / (k * sigma)
    assert RowLoop(k, sigma, lag=0.99 * limit).stable
    beyond = RowLoop(k, sigma, lag=1.01 * limit)
    assert not beyond.stable
    assert all(np.isinf(peak).all() for peak in beyond.gains.values())


class Pulses:
    """A row in small steps, typed again: e, ė after each, of a source that is 1 in one of them."""

    def __init__(self, row: RowLoop, source: str, index: int, periods: int):
        self.row, dt = row, row.period / STEPS
        e = rate = a = predicted = seen = estimate = w = 0.0
        commands: list[float] = []  # by tick
        late = round(row.dead_time / dt)
        level, self.states = 0.0, []
        for i in range(periods * STEPS):
            pulse = float(i == index)
            level = level + dt * pulse if source.endswith("rate") else pulse
            tick = i % STEPS == 0
            if source == "feed_forward":  # held for the period
                level = float(i // STEPS == index // STEPS)
            delta = level if source == "disturbance" else 0.0
            f = level - 0.5 * dt * pulse * (source == "feed_forward_rate")
            f *= source.startswith("feed")
            if tick:
                v = -(row.k + row.sigma) * rate - row.k * row.sigma * e - estimate
                v += row.drag * rate
                commands.append(v + (level - dt * pulse if source.endswith("rate") else f))
                if row.observer:
                    mean = (rate - seen - predicted) / row.period
                    estimate += (1.0 - np.exp(-row.observer * row.period)) * (mean - estimate)
                    seen, predicted = rate, 0.0
            if i >= late and (i - late) % STEPS == 0:
                w = commands[(i - late) // STEPS]
            mean_a = w
            if row.lag:
                fade = np.exp(-dt / row.lag)
                mean_a = w + (a - w) * (1.0 - fade) * row.lag / dt
                a = w + (a - w) * fade
            predicted += dt * (mean_a - f)
            acceleration = mean_a - f + delta - row.drag * rate
            e += dt * rate + 0.5 * dt**2 * acceleration
            rate += dt * acceleration
            self.states.append((e, rate))


def simulated(row: RowLoop, source: str, periods: int) -> np.ndarray:
    """Returns the largest sums, over an instant of a period, of the sizes of all e and ė."""
    total = np.zeros((STEPS, 2))
    for index in range(1 if source == "feed_forward" else STEPS):
        states = np.array(Pulses(row, source, index, periods).states)
        total += np.sum(np.abs(states.reshape(-1, STEPS, 2)), axis=0)
    return np.max(total, axis=0)


@pytest.mark.parametrize("row", [
    RowLoop(4.0, 2.0, period=0.1), RowLoop(3.0, 1.5, observer=2.0, lag=0.05, period=0.1),
    RowLoop(3.0, 1.5, lag=0.15, period=0.1, dead_time=0.1),
    RowLoop(3.0, 1.5, observer=1.0, period=0.1, dead_time=0.025),
    RowLoop(1.2, 0.8, observer=0.8, lag=0.1, period=0.08, dead_time=0.12)])
def test_a_sampled_row_does_what_all_pulses_together_do(row):
    gains = row.gains
    for source in ("disturbance", "feed_forward", "feed_forward_rate"):
        np.testing.assert_allclose(gains[source][:2], simulated(
            row, source, round(20.0 / row.period)), rtol=0.05, err_msg=source)


def test_a_fast_clock_is_none():
    fast = RowLoop(4.0, 2.0, observer=2.0, lag=0.15, period=0.002).gains
    for source, peak in RowLoop(4.0, 2.0, observer=2.0, lag=0.15).gains.items():
        np.testing.assert_allclose(fast[source], peak, rtol=0.015)


@pytest.mark.parametrize(("settings", "message"), [
    ({"k": 0.0}, "k = 0.0: must be positive"), ({"lag": -0.1}, "lag = -0.1: must be zero or pos"),
    ({"dead_time": 0.1}, "dead_time = 0.1: must be zero, or positive with a positive period")])
def test_values_without_a_meaning_are_refused(settings, message):
    with pytest.raises(InvalidParameter, match=message):
        RowLoop(**{"k": 2.0, "sigma": 1.0, **settings})


HELD = [RowLoop(4.0, 2.0, period=0.1), RowLoop(3.0, 1.5, period=0.1, dead_time=0.025),
        RowLoop(3.0, 1.5, period=0.1, dead_time=0.125, drag=2.0)]
"""Rows behind a command that is held."""


def weighted(row: RowLoop, weight: np.ndarray, growth: float = 0.0) -> np.ndarray:
    """Returns e and ė, as `simulated` does, by a δ of these sizes in the steps of a period."""
    dt, count, total = row.period / STEPS, len(weight), np.zeros((len(weight), 2))
    for index in np.flatnonzero(weight):
        states = np.array(Pulses(row, "disturbance", index, 40 * (count // STEPS) + 100).states)
        states = states[: len(states) // count * count]
        age = dt * (np.arange(len(states)) - index)
        sizes = np.abs(states) * weight[index] * np.exp(growth * np.maximum(age, 0.0))[:, None]
        total += np.sum(sizes.reshape(-1, count, 2), axis=0)
    return np.max(total, axis=0)


@pytest.mark.parametrize("row", HELD)
def test_what_happens_while_a_command_is_held_counts_by_its_age(row):
    dt, growth = row.period / STEPS, 0.4
    late = round(row.dead_time / dt)
    steps = np.arange(STEPS)
    age = dt * (steps + 0.5) - (steps - late) // STEPS * row.period
    assert np.max(age) < row.period + row.dead_time
    for g in (0.0, growth):
        np.testing.assert_allclose(row.zoh_gains(g)[:2], weighted(row, age, g), rtol=0.05)
        np.testing.assert_allclose(
            row.grown(g)[:2], weighted(row, np.ones(STEPS), g), rtol=0.05)
    assert row.zoh_gains()[0] < (row.period + row.dead_time) * row.grown(0.0)[0]
    assert row.zoh_gains()[3] >= row.period + row.dead_time


def test_a_pulse_counts_until_the_command_of_its_tick_acts():
    row = HELD[1]
    steps = row.period / STEPS * np.arange(3 * STEPS)
    for until in (row.dead_time, row.period + row.dead_time):
        np.testing.assert_allclose(row.zoh_gains(pulses=3, until=until)[:2], weighted(
            row, 1.0 * (steps < until - 1e-9)), rtol=0.05)
    assert not HELD[0].zoh_gains(pulses=3, until=0.0)[:3].any()


def test_the_acceleration_of_a_row_is_one_of_its_gains():
    """Without a clock's time to react, an impulse of δ is in ë as it is: 1 and what follows."""
    fast, k = RowLoop(3.0, 3.0, period=1e-3), 3.0
    t = np.linspace(0.0, 10.0, 20_001)
    rest = np.trapezoid(np.abs((2.0 * k - k**2 * t) * np.exp(-k * t)), t)  # of g̈
    assert fast.grown(0.0)[3] == pytest.approx(1.0 + rest, rel=5e-3)
