"""Random numbers that are pure functions of a seed and of a key, such as the index of a sample.

The numbers of a key (k₁ … k_m) are those of NumPy's

    Generator(Philox(SeedSequence(seed, spawn_key=(k₁ … k_m)))),

to the last bit. To make these three objects takes ten times as long as to draw a few numbers, so
numbers are drawn for many last entries k_m of the key at once, by one generator. The state that a
`SeedSequence` gives to the generator is computed for all of them in one pass: it is specified by
M. E. O'Neill (2015, `seed_seq_fe`), and NumPy guarantees that it stays the same (NEP 19).
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Literal

import numpy as np

BLOCK = 64
"""Number of consecutive last entries of a key whose numbers are drawn at once."""

_POOL = 4
_INITIAL_A, _FACTOR_A = 0x43B0D7E5, 0x931E8875
_INITIAL_B, _FACTOR_B = 0x8B51F9DD, 0x58F38DED
_FACTOR_LEFT, _FACTOR_RIGHT = np.uint32(0xCA01F9DD), np.uint32(0x4973F715)
_SHIFT = np.uint32(16)


def generator_of(seed: int, key: Sequence[int]) -> np.random.Generator:
    """Returns the generator of a seed and a key, at its beginning."""
    return np.random.Generator(np.random.Philox(
        np.random.SeedSequence(seed, spawn_key=tuple(key))))


def normal_numbers(seed: int, key: tuple[int, ...], index: int, count: int) -> np.ndarray:
    """Returns the first Gaussian numbers (count,) of the key (*key, index), index below 2³²."""
    block, place = divmod(index, BLOCK)
    numbers: np.ndarray = _block("normal", seed, key, count, block)[place]
    return numbers


def uniform_number(seed: int, key: tuple[int, ...], index: int) -> float:
    """Returns the first number from 0 to 1 of the key (*key, index), index below 2³²."""
    block, place = divmod(index, BLOCK)
    return float(_block("uniform", seed, key, 1, block)[place, 0])


@lru_cache(maxsize=1024)
def _block(kind: Literal["normal", "uniform"], seed: int, key: tuple[int, ...], count: int,
           block: int) -> np.ndarray:
    """Returns the numbers (BLOCK, count) of consecutive last entries of the key."""
    states = philox_keys(seed, key, np.arange(block * BLOCK, (block + 1) * BLOCK))
    bits = np.random.Philox(0)
    generator = np.random.Generator(bits)
    draw: Callable[[int], np.ndarray] = (
        generator.standard_normal if kind == "normal" else generator.random)
    state, zero, out = bits.state, np.zeros(_POOL, dtype=np.uint64), np.empty((BLOCK, count))
    for numbers, words in zip(out, states, strict=True):
        bits.state = {**state, "state": {"counter": zero, "key": words}, "buffer": zero,
                      "buffer_pos": _POOL, "has_uint32": 0, "uinteger": 0}
        numbers[:] = draw(count)
    out.setflags(write=False)
    return out


def philox_keys(seed: int, key: tuple[int, ...], last: np.ndarray) -> np.ndarray:
    """Returns Philox's keys (K, 2) of (*key, last) for each of the last entries (K,), below 2³²."""
    first = _words(seed)
    words = [*first, *[0] * (_POOL - len(first))]
    words += [word for entry in key for word in _words(entry)]
    entropy = [np.full(1, word, dtype=np.uint32) for word in words] + [last.astype(np.uint32)]
    with np.errstate(over="ignore"):  # All arithmetic is modulo 2³².
        return _generated(_mixed(entropy)).view(np.uint64)


def _words(number: int) -> list[int]:
    """Returns the 32-bit words of an integer, the lowest first; one word for zero."""
    words = [number & 0xFFFFFFFF]
    while number := number >> 32:
        words.append(number & 0xFFFFFFFF)
    return words


class _Hash:
    """Hash of words, whose constant changes with every one."""

    def __init__(self, initial: int, factor: int):
        self._constant, self._factor = initial, factor

    def __call__(self, word: np.ndarray) -> np.ndarray:
        mixed = word ^ np.uint32(self._constant)
        self._constant = self._constant * self._factor & 0xFFFFFFFF
        mixed = mixed * np.uint32(self._constant)
        return mixed ^ mixed >> _SHIFT


def _mixed(entropy: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Returns the pool of a `SeedSequence` with these words, arrays that broadcast."""
    hashed = _Hash(_INITIAL_A, _FACTOR_A)
    pool = [hashed(word) for word in entropy[:_POOL]]

    def mix(word: np.ndarray, other: np.ndarray) -> np.ndarray:
        mixed: np.ndarray = _FACTOR_LEFT * word - _FACTOR_RIGHT * other
        return mixed ^ mixed >> _SHIFT

    for source in range(_POOL):
        for target in range(_POOL):
            if source != target:
                pool[target] = mix(pool[target], hashed(pool[source]))
    for word in entropy[_POOL:]:
        for target in range(_POOL):
            pool[target] = mix(pool[target], hashed(word))
    return pool


def _generated(pool: Sequence[np.ndarray]) -> np.ndarray:
    """Returns four words (K, 4) of the state of a pool with words (K,)."""
    hashed = _Hash(_INITIAL_B, _FACTOR_B)
    return np.stack([hashed(word) for word in pool], axis=-1)
