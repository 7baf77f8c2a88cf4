"""Tests of `uvms_drake.sensing.navigation`: its bounds, reached and kept, and each part."""

from dataclasses import replace
from math import erf, exp, pi, sqrt

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from support.runs import simulated
from support.scripts import Script

import uvms_drake as uv
from uvms_drake.sensing.navigation import (
    CHANNELS,
    Channel,
    Drift,
    Dvl,
    LostFixes,
    Navigation,
    _rates,
    channel_rows,
    triangle,
)

SIZE = 10
QUIET = Navigation(**{key: Channel(50.0, 0.0, 0.0) for key in CHANNELS}, drift=Drift(0.0, 0.0),
                   dvl=Dvl(noise=np.zeros(3), growth=0.0))
SPEED = np.linspace(0.1, 0.5, 2 * SIZE)


def still(time):
    return np.zeros(2 * SIZE)


def rolling(time):
    return SPEED * time


def run(settings, times, model, state=still, seed=0):
    """Returns the measured state (T, 20) at times."""
    builder = DiagramBuilder()
    script = builder.AddSystem(Script(state=state))
    signals = uv.Signals()
    port = settings.add_to(builder, model, script.get_output_port(), signals, seed)
    assert list(signals) == ["measured_state", "fix_age"]
    builder.ExportOutput(port, "measured")
    simulator = Simulator(builder.Build())
    out = []
    for time in times:
        simulator.AdvanceTo(time)
        out.append(simulator.get_system().get_output_port().Eval(simulator.get_context()))
    return np.array(out)


def test_without_errors_it_is_the_delayed_samples_of_the_state(model):
    settings = replace(QUIET, position=Channel(10.0, 0.0, 0.25), turning=Channel(20.0, 0.0, 0.0))
    times = np.linspace(0.5013, 1.4983, 61)
    rows, k = np.arange(2 * SIZE), np.floor(times * 50.0 + 1e-9) / 50.0
    expected = np.array([np.where(rows < 3, np.floor((t - 0.25) * 10.0) / 10.0, s)
                         for t, s in zip(times, k, strict=True)])
    expected[:, 13:16] = (np.floor(times * 20.0) / 20.0)[:, None]
    np.testing.assert_allclose(run(settings, times, model, rolling), SPEED * expected, atol=1e-12)


def test_the_errors_keep_to_the_bounds_and_nearly_reach_them(model):
    """Of every component, for a motion whose speed is known: |x̂ − x| ≤ ε + v (δ + h)."""
    settings = replace(Navigation(), dvl=Dvl(lost=1.0), drift=Drift(0.05, 0.02), noise_multiple=1.0)
    seed = max(range(200), key=lambda seed: np.min(np.abs(_rates(seed)[1])))
    times = np.linspace(0.0, 9.0, 1124)
    error, age = np.zeros((2, 2 * SIZE))
    for key, rows in channel_rows(SIZE).items():
        channel = getattr(settings, key)
        error[rows] = channel.noise
        age[rows] = 0.0 if channel.propagated else channel.latency + 1.0 / channel.rate
    error[:3] += min(settings.drift.bound, settings.drift.rate * times[-1])
    dvl = settings.dvl  # Its growth over the longest gap.
    error[SIZE: SIZE + 3] += np.asarray(dvl.noise) + dvl.growth * dvl.most / dvl.rate
    largest = np.max(np.abs(run(settings, times, model, still, seed)), axis=0)
    assert np.all(largest <= error + 1e-12)
    assert np.all(largest >= 0.8 * error)
    times = times[:300]
    moved = np.abs(run(settings, times, model, rolling, seed) - np.outer(times, SPEED))
    assert np.all(moved <= error + SPEED * age + 1e-9)


def test_noise_is_gaussian_cut_to_its_multiple(model):
    settings = replace(QUIET, noise_multiple=1.5, attitude=Channel(1000.0, 0.01, 0.0))
    times = np.arange(2000) / 1000.0 + 5e-4
    noise = run(settings, times, model)[:, 3:6] / 0.01
    assert np.max(np.abs(noise)) == 1.5
    inside = erf(1.5 / sqrt(2.0))
    variance = inside - 2.0 * 1.5 * exp(-1.125) / sqrt(2.0 * pi) + 1.5**2 * (1.0 - inside)
    assert np.std(noise) == pytest.approx(sqrt(variance), rel=0.04)
    assert np.max(np.abs(np.corrcoef(noise.T) - np.eye(3))) < 0.08
    assert abs(np.corrcoef(noise[1:, 0], noise[:-1, 0])[0, 1]) < 0.08


def test_the_position_drifts_at_its_rate_and_turns_round_at_its_bound():
    x = np.linspace(-3.3, 7.1, 400)
    folded = np.abs((x + 1.0) % 4.0 - 2.0)
    np.testing.assert_allclose(triangle(x), 1.0 - folded, atol=1e-9)
    drift, rates = Drift(0.01, 0.02), np.array([0.01, -0.005, 0.002])
    at = np.array([drift.at(t, rates) for t in np.linspace(0.0, 20.0, 2001)])
    np.testing.assert_allclose(at[100], rates, atol=1e-12)
    assert np.max(np.abs(np.diff(at, axis=0))) <= 0.01 * 0.01 + 1e-12
    np.testing.assert_allclose(np.max(np.abs(at), axis=0), [0.02, 0.02, 0.02], atol=1e-9)
    assert not np.any(Drift(1.0, 0.0).at(3.0, np.ones(3)))


@pytest.mark.parametrize("lost", [0.0, 0.3, 1.0])
def test_fixes_are_lost_as_often_as_is_said_and_never_for_longer_than_the_gap(lost):
    dvl = Dvl(lost=lost, gap=0.5)
    fixes = np.unique([dvl.last_fix((j + 0.5) / dvl.rate, 3) for j in range(2000)])
    gaps = np.diff(fixes) / dvl.rate
    assert np.max(gaps) == pytest.approx({0.0: 1.0, 0.3: 4.0, 1.0: 4.0}[lost] / dvl.rate)
    assert np.max(gaps) <= dvl.gap
    assert len(fixes) / 2000 == pytest.approx(0.25 + 0.75 * (1.0 - lost), abs=0.03)


def test_in_an_outage_and_after_it_the_last_fix_is_none_inside_of_it():
    """Of two outages that overlap and one apart; each begins at a fix, and a fix ends it."""
    dvl, outages = Dvl(rate=10.0, lost=0.3, gap=0.5), ((1.0, 2.0), (2.5, 1.5), (6.0, 1.0))
    lost = dvl
    for start, duration in outages:
        lost = LostFixes(start, duration).of(lost)
    for seed in range(20):
        for time in np.arange(0.0, 9.0, 0.05) + 1e-6:
            last = lost.last_fix(time, seed) / dvl.rate
            assert not any(start + 1e-9 < last < start + duration - 1e-9
                           for start, duration in outages)
            before = min((start for start, duration in outages if start < dvl.last_fix(
                time, seed) / dvl.rate < start + duration - 1e-9), default=time)
            if before == time:
                assert last == dvl.last_fix(time, seed) / dvl.rate
            else:
                assert last <= before + 1e-9


def test_the_velocity_goes_on_from_the_last_fix_with_the_accelerometers_bias(model):
    """A straight line from fix to fix, as steep as the bias; a new noise at each of them."""
    dvl = Dvl(rate=10.0, gap=0.4, lost=1.0, noise=np.full(3, 0.01), growth=0.05)
    settings = replace(QUIET, dvl=dvl, velocity=Channel(100.0, 0.0, 0.0))
    times = np.arange(200) / 100.0 + 5e-3
    error = run(settings, times, model, seed=4)[:, SIZE: SIZE + 3].reshape(5, 40, 3)
    slopes = np.diff(error, axis=1) * 100.0
    np.testing.assert_allclose(slopes, np.broadcast_to(
        0.05 * _rates(4)[1], slopes.shape), atol=1e-9)
    assert np.min(np.abs(slopes)) > 0.0
    assert np.max(np.abs(slopes)) <= 0.05
    assert np.min(np.abs(np.diff(error[:, 0], axis=0))) > 1e-5
    assert not np.any(run(settings, times, model, seed=4)[:, :SIZE])


def test_the_loop_begins_at_the_measured_state():
    """The first plan starts at the measured state; the run continues with the measurements."""
    record = simulated("girona500_ideal", 0.4, "sensing=[!Navigation {position: {noise: 0.001}}]")
    measured = record.signals["measured_state"]
    np.testing.assert_array_equal(record.nominal_state[0], measured[0])
    off = np.max(np.abs(measured - record.state), axis=0)
    assert np.all(off > 0.0)
    assert np.all(off[:3] < 0.01)
