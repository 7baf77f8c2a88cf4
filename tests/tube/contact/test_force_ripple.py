"""Tests of `uvms_drake.tube.contact.sensor_error`, against all pairs of instants."""

import numpy as np
import pytest

from uvms_drake.tube.contact.sensor_error import ripple

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
