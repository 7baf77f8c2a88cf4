"""Numbers of keys against NumPy's own generators of the same seeds."""

import numpy as np
import pytest

from uvms_drake.common.keyed_random import (
    BLOCK,
    generator_of,
    normal_numbers,
    philox_keys,
    uniform_number,
)

SEEDS = (0, 7, 2**31 + 5, 2**33 + 1, 2**130 + 9)
KEYS = ((), (2,), (2, 0, 3), (1, 2**40 + 3))
INDICES = (0, 1, BLOCK - 1, BLOCK, 5 * BLOCK + 3, 2**32 - 1)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("key", KEYS)
def test_keys_are_those_of_a_seed_sequence(seed, key):
    for index in INDICES:
        sequence = np.random.SeedSequence(seed, spawn_key=(*key, index))
        expected = np.random.Philox(sequence).state["state"]["key"]
        assert np.array_equal(philox_keys(seed, key, np.array([index]))[0], expected)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("key", KEYS)
def test_numbers_are_those_of_a_generator_of_the_whole_key(seed, key):
    for index in INDICES:
        expected = generator_of(seed, (*key, index)).standard_normal(7)
        assert np.array_equal(normal_numbers(seed, key, index, 7), expected)
        assert uniform_number(seed, key, index) == generator_of(seed, (*key, index)).uniform()


def test_numbers_do_not_depend_on_what_was_drawn_before():
    first = normal_numbers(3, (4,), 9, 2).copy()
    normal_numbers(3, (4,), 9 + BLOCK, 2)
    normal_numbers(3, (4,), 9, 5)
    assert np.array_equal(normal_numbers(3, (4,), 9, 2), first)


def test_numbers_cannot_be_changed_by_their_user():
    with pytest.raises(ValueError, match="read-only"):
        normal_numbers(3, (4,), 9, 2)[0] = 1.0
