"""Random numbers that are pure functions of a seed and of a key, such as the index of a sample."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np


def generator_of(seed: int, key: Sequence[int]) -> np.random.Generator:
    """Returns the generator of a seed and a key, at its beginning."""
    return np.random.Generator(np.random.Philox(
        np.random.SeedSequence(seed, spawn_key=tuple(key))))


@lru_cache(maxsize=1024)
def normal_numbers(seed: int, key: tuple[int, ...], count: int) -> np.ndarray:
    """Returns the first Gaussian numbers (count,) of a seed and a key, read-only."""
    numbers = generator_of(seed, key).standard_normal(count)
    numbers.setflags(write=False)
    return numbers


@lru_cache(maxsize=1024)
def uniform_number(seed: int, key: tuple[int, ...]) -> float:
    """Returns the first number from 0 to 1 of a seed and a key."""
    return float(generator_of(seed, key).uniform())
