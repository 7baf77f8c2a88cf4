"""A plane with a smooth height."""

from dataclasses import replace

import numpy as np
import pytest
from support.shapes import SHAPES

BUMPY = SHAPES["bumpy"]


def heights(shape):
    """Returns a square of heights (801, 801), sides of 40 times the shortest wavelength."""
    line = np.linspace(-20.0, 20.0, 801) * shape.wavelength
    return shape.height(np.stack(np.meshgrid(line, line), axis=-1)), line[1] - line[0]


@pytest.mark.parametrize("seed", range(3))
def test_height_slope_and_curvature_are_within_what_is_declared(seed):
    shape = replace(BUMPY, seed=seed)
    (height, slope), step = heights(shape)
    assert 0.5 * shape.amplitude < np.max(np.abs(height)) <= shape.amplitude
    steepest = np.max(np.linalg.norm(slope, axis=-1))
    assert 0.5 * shape.slope < steepest <= shape.slope
    turn = np.linalg.norm(np.diff(slope, axis=0), axis=-1) / step
    assert 0.3 * shape.curvature < np.max(turn) <= shape.curvature


def test_no_wave_is_shorter_than_declared_or_longer_than_four_times_that():
    """By Fourier: all of the height's power is between the two."""
    (height, _), step = heights(BUMPY)
    window = np.hanning(801)
    power = np.abs(np.fft.fft2(height * window * window[:, None]))**2
    frequency = np.fft.fftfreq(801, step)
    wavelength = 1.0 / np.maximum(np.hypot(frequency, frequency[:, None]), 1e-9)
    outside = (wavelength < 0.9 * BUMPY.wavelength) | (wavelength > 4.8 * BUMPY.wavelength)
    assert np.sum(power[outside]) < 1e-3 * np.sum(power)


def test_a_seed_is_a_wall():
    (once, _), (again, _) = (heights(replace(BUMPY, seed=7))[0] for _ in range(2))
    (other, _), _ = heights(replace(BUMPY, seed=8))
    np.testing.assert_array_equal(once, again)
    assert abs(np.corrcoef(once.ravel(), other.ravel())[0, 1]) < 0.2


def test_twice_the_amplitude_is_the_same_wall_twice_as_high():
    (height, slope), _ = heights(BUMPY)
    (double, steeper), _ = heights(replace(BUMPY, amplitude=2.0 * BUMPY.amplitude))
    np.testing.assert_allclose(double, 2.0 * height, atol=1e-15)
    np.testing.assert_allclose(steeper, 2.0 * slope, atol=1e-13)
