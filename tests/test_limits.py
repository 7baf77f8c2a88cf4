"""Tests of `uvms_drake.control.limits`."""

from dataclasses import replace

import numpy as np
import pytest

from uvms_drake.control.limits import DeclaredTube, Limits, tighten
from uvms_drake.errors import InvalidParameter

LIMITS = Limits(nu1=0.25, nu2=0.2, qdot=0.3, pitch=0.31, tip_pitch=0.8,
                u=np.array([0.4, 0.3, 0.3, 0.4, 0.4, 0.4, 6.0, 8.0]))
TUBE = DeclaredTube(e=0.01, z=0.04, pitch=0.02,
                    u=np.array([0.1, 0.1, 0.1, 0.2, 0.2, 0.2, 0.5, 0.7]))
Q_LOWER, Q_UPPER = np.array([-0.5, -1.3]), np.array([1.4, 0.7])


def test_the_tube_is_taken_from_every_limit():
    rest = tighten(LIMITS, TUBE, Q_LOWER, Q_UPPER)
    assert rest.nu1 == pytest.approx(0.21)
    assert rest.nu2 == pytest.approx(0.16)
    assert rest.qdot == pytest.approx(0.26)
    assert rest.pitch == pytest.approx(0.29)
    assert rest.tip_pitch == pytest.approx(0.79)
    np.testing.assert_allclose(rest.u, [0.3, 0.2, 0.2, 0.2, 0.2, 0.2, 5.5, 7.3])
    np.testing.assert_allclose(rest.q_lower, [-0.49, -1.29])
    np.testing.assert_allclose(rest.q_upper, [1.39, 0.69])


def test_the_worst_deviation_in_the_tube_reaches_the_limit_and_does_not_exceed_it():
    """For a velocity on the tightened ball and 100 deviations of norm z: z is not too small."""
    rest = tighten(LIMITS, TUBE, Q_LOWER, Q_UPPER)
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(100, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    nominal = rest.nu1 * directions[0]
    real = np.linalg.norm(nominal + TUBE.z * directions, axis=1)
    assert np.max(real) == pytest.approx(LIMITS.nu1)  # directions[0] is the worst
    assert np.all(real <= LIMITS.nu1 + 1e-12)


def test_without_a_tube_the_limits_stay():
    rest = tighten(LIMITS, DeclaredTube(u=np.zeros(8)), Q_LOWER, Q_UPPER)
    assert (rest.nu1, rest.nu2, rest.qdot) == (LIMITS.nu1, LIMITS.nu2, LIMITS.qdot)
    assert (rest.pitch, rest.tip_pitch) == (LIMITS.pitch, LIMITS.tip_pitch)
    np.testing.assert_array_equal(rest.u, LIMITS.u)
    np.testing.assert_array_equal(rest.q_lower, Q_LOWER)


@pytest.mark.parametrize(("limits", "tube", "key"), [
    ({"nu1": 0.04}, {}, "limits.nu1"),
    ({"nu2": 0.03}, {}, "limits.nu2"),
    ({"qdot": -1.0}, {}, "limits.qdot"),
    ({"qdot": np.inf}, {}, "limits.qdot"),
    ({"pitch": 0.02}, {}, "limits.pitch"),
    ({"pitch": 1.6}, {}, "limits.pitch"),
    ({"tip_pitch": 0.01}, {}, "limits.tip_pitch"),
    ({"tip_pitch": np.pi / 2}, {}, "limits.tip_pitch"),
    ({"nu1": np.nan}, {}, "limits.nu1"),
    ({"u": np.full(8, 0.15)}, {}, "limits.u"),
    ({"u": np.ones(3)}, {}, "limits.u"),
    ({}, {"u": np.zeros(10)}, "tube.u"),
    ({}, {"u": np.array([0, 0, 0, 0, 0, 0, 0, -0.1])}, "tube.u"),
    ({}, {"z": -0.1}, "tube.z"),
    ({}, {"e": np.nan}, "tube.e"),
    ({"tip_pitch": 1.5}, {"e": 1.0}, "tube.e"),
    ({}, {"pitch": np.inf}, "tube.pitch"),
])
def test_what_leaves_nothing_or_means_nothing_is_named(limits, tube, key):
    with pytest.raises(InvalidParameter) as caught:
        tighten(replace(LIMITS, **limits), replace(TUBE, **tube), Q_LOWER, Q_UPPER)
    assert caught.value.key == key
