"""Numbers of keys: pure functions, those of NumPy's own generators."""

import numpy as np
import pytest

from uvms_drake.common.keyed_random import generator_of, normal_numbers, uniform_number


@pytest.mark.parametrize("seed", [0, 7, 2**33 + 1])
@pytest.mark.parametrize("key", [(2,), (2, 0, 3), (1, 2**40 + 3)])
def test_numbers_are_those_of_a_generator_of_the_key(seed, key):
    expected = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=key)))
    assert np.array_equal(normal_numbers(seed, key, 7), expected.standard_normal(7))
    assert uniform_number(seed, key) == generator_of(seed, key).uniform()


def test_numbers_do_not_depend_on_what_was_drawn_before():
    first = normal_numbers(3, (4, 9), 2).copy()
    normal_numbers(3, (4, 10), 2)
    normal_numbers(3, (4, 9), 5)
    normal_numbers.cache_clear()
    assert np.array_equal(normal_numbers(3, (4, 9), 2), first)
    assert not np.array_equal(normal_numbers(3, (4, 10), 2), first)


def test_numbers_cannot_be_changed_by_their_user():
    with pytest.raises(ValueError, match="read-only"):
        normal_numbers(3, (4, 9), 2)[0] = 1.0
