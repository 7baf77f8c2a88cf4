"""Disturbances of time alone: the bound, the closed forms, and a state that is in the Context."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from uvms_drake.plant.disturbance import (
    ConstantDisturbance,
    RandomDisturbance,
    SinusoidalDisturbance,
    ball_sample,
)

SIZE, BOUND = 7, 0.3
KINDS = [ConstantDisturbance(BOUND), SinusoidalDisturbance(BOUND, frequency=1.7, phase=0.4),
         RandomDisturbance(BOUND, bandwidth=3.0)]
WEIGHTS = np.array([0.1, 0.3, 0.05, 0.7, 1.0, 0.9, 0.2])
"""Weights of the ellipsoid with the semi-axes BOUND times these."""


def record(config, times, seed=0, size=SIZE):
    """Returns d (len(times), size), simulated through `times`."""
    simulator = Simulator(config.system(size, seed))
    port = simulator.get_system().GetOutputPort("disturbance")
    simulator.get_mutable_context().SetTime(times[0])
    simulator.Initialize()
    values = []
    for time in times:
        simulator.AdvanceTo(time)
        values.append(port.Eval(simulator.get_context()).copy())
    return np.array(values)


@pytest.mark.parametrize("config", KINDS)
def test_the_bound_holds_at_twenty_thousand_times(config):
    """Exactly, so rounding must not exceed it either."""
    values = record(config, np.linspace(0.0, 500.0, 20_000))
    norms = np.linalg.norm(values, axis=1)
    assert np.max(norms) <= BOUND
    assert np.max(norms) > 0.8 * BOUND


@pytest.mark.long
@pytest.mark.parametrize("config", KINDS)
def test_so_does_that_of_an_ellipsoid_and_of_each_component(config):
    weighted = replace(config, weights=WEIGHTS)
    values = record(weighted, np.linspace(0.0, 500.0, 20_000))
    norms = np.linalg.norm(values / WEIGHTS, axis=1)
    assert 0.8 * BOUND < np.max(norms) <= BOUND
    np.testing.assert_allclose(weighted.norm(values), norms, rtol=1e-12)
    assert np.all(np.max(np.abs(values), axis=0) <= BOUND * WEIGHTS)
    np.testing.assert_allclose(
        values, WEIGHTS * record(config, np.linspace(0.0, 500.0, 20_000)), rtol=1e-12, atol=1e-15)


def test_the_sinusoid_is_the_papers_with_the_two_norm_as_its_bound():
    times = np.linspace(0.0, 9.0, 50)
    values = record(SinusoidalDisturbance(BOUND, frequency=1.7, phase=0.4), times)
    expected = np.outer(BOUND * np.sin(1.7 * times + 0.4), np.ones(SIZE) / np.sqrt(SIZE))
    np.testing.assert_allclose(values, expected, rtol=1e-13)


def test_samples_fill_the_ball_uniformly():
    """For uniform samples ‖x‖ⁿ is uniform on [0, 1] and the mean is zero."""
    samples = np.array([ball_sample(3, 5, i) for i in range(4000)])
    radii = np.sort(np.linalg.norm(samples, axis=1)) ** 3
    np.testing.assert_allclose(radii, np.linspace(0.0, 1.0, 4000), atol=0.03)
    np.testing.assert_allclose(np.mean(samples, axis=0), 0.0, atol=0.03)


def test_a_random_disturbance_passes_through_its_samples_with_zero_slope():
    bandwidth, h = 2.0, 1e-5
    knots = np.arange(1, 9) / (2.0 * bandwidth)
    times = np.sort(np.concatenate([knots - h, knots, knots + h]))
    before, at, after = record(RandomDisturbance(BOUND, bandwidth), times, 4).reshape(
        8, 3, SIZE).swapaxes(0, 1)
    samples = BOUND * np.array([ball_sample(SIZE, 4, i) for i in range(1, 9)])
    np.testing.assert_allclose(at, samples, atol=1e-15)
    np.testing.assert_allclose((at - before) / h, 0.0, atol=1e-3)
    np.testing.assert_allclose((after - at) / h, 0.0, atol=1e-3)


def test_most_of_the_power_of_a_random_disturbance_is_below_the_bandwidth():
    bandwidth, step = 1.5, 0.02
    values = record(RandomDisturbance(BOUND, bandwidth), np.arange(0.0, 400.0, step))
    power = np.sum(np.abs(np.fft.rfft(values, axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(len(values), step)
    assert np.sum(power[frequency <= bandwidth]) > 0.9 * np.sum(power)
    assert np.sum(power[frequency <= 0.5 * bandwidth]) < 0.9 * np.sum(power)


def test_a_simulation_may_start_at_any_time():
    config = RandomDisturbance(BOUND, 2.0)
    late = np.linspace(3.1, 5.0, 20)
    np.testing.assert_allclose(
        record(config, late), record(config, np.concatenate([[0.0], late]))[1:], atol=1e-14)


def test_a_cloned_context_continues_identically():
    system = RandomDisturbance(BOUND, 2.0).system(SIZE, 9)
    port = system.GetOutputPort("disturbance")
    simulator = Simulator(system)
    simulator.AdvanceTo(3.3)
    twin = Simulator(system, simulator.get_context().Clone())
    for time in (3.3, 3.4, 3.5, 4.1, 7.0):
        values = []
        for each in (simulator, twin):
            each.AdvanceTo(time)
            values.append(port.Eval(each.get_context()).copy())
        np.testing.assert_array_equal(*values)
