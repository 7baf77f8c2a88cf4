"""Readings that a working sensor repeats: drawn noise against the computed probability."""

import numpy as np
import pytest

from uvms_drake.sensing.force_fault_detector import (
    repeat_probability,
    run_of_frozen,
)
from uvms_drake.sensing.force_sensor import ForceSensor
from uvms_drake.sensing.wrist_sensor import quantised

SIGMA = np.array([0.25, 0.25, 0.25, 0.005, 0.005, 0.005])


def repeats(sigma, multiple, resolution, force, count=20_000):
    """Returns whether each of `count` drawn readings of a constant force repeats the last one."""
    unit = np.random.default_rng(4).standard_normal((count, 6))
    noise = sigma * np.clip(unit, -multiple, multiple)
    readings = quantised(force + noise, resolution)
    return np.all(readings[1:] == readings[:-1], axis=1)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5])
@pytest.mark.parametrize(("multiple", "step"), [(3.0, 4.0), (3.0, 2.5), (1.5, 1.6), (1.0, 0.9)])
def test_no_force_makes_drawn_readings_repeat_more_often_than_computed(multiple, step, share):
    """Wherever the force is between two steps; σ and r of three components are as given."""
    r = step * SIGMA
    bound = repeat_probability(SIGMA, multiple, r)
    found = np.mean(repeats(SIGMA, multiple, r, share * r))
    assert found <= bound + 4.0 * np.sqrt(bound / 20_000)


@pytest.mark.parametrize("force_step", [0.01, 0.0625, 0.2, 0.5])
def test_no_run_of_a_working_sensor_is_that_of_a_frozen_one(force_step):
    """Of the shipped noise, and steps of the torque alike: the longest drawn run is shorter."""
    r = force_step / 0.25 * SIGMA
    frozen = run_of_frozen(repeat_probability(SIGMA, 3.0, r))
    same = repeats(SIGMA, 3.0, r, 0.5 * r)
    ends = np.flatnonzero(np.append(~same, True))
    longest = np.max(np.diff(ends, prepend=-1))
    assert longest < frozen <= 11


def test_a_sensor_that_is_as_quiet_as_a_frozen_one_has_no_such_run():
    """Without noise, or with a resolution that hides all of it; one noisy component is enough."""
    assert run_of_frozen(repeat_probability(np.zeros(6), 3.0, np.zeros(6))) == 0
    assert run_of_frozen(repeat_probability(SIGMA, 3.0, 6.0 * SIGMA)) == 0
    one = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.005])
    assert run_of_frozen(repeat_probability(one, 3.0, np.zeros(6))) == 5
    quiet = ForceSensor(noise=np.zeros(6)).reading(30.0, 0.5)
    assert quiet.repeated == 1.0
