"""Errors of bad values: key, value, and allowed values."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

SHORTEST = 1e-4
"""Shortest period of a clock [s]."""


class InvalidParameter(ValueError):
    """A parameter has a value that its consumer cannot use.

    Attributes:
        key: Dotted path of the parameter, e.g. `surface.stiffness`.
        value: The offending value.
        allowed: Allowed values, as the end of "must be ...".
    """

    def __init__(self, key: str, value: object, allowed: str):
        self.key = key
        self.value = value
        self.allowed = " ".join(allowed.split())
        super().__init__(f"{key} = {shown(value)}: must be {self.allowed}")


def shown(value: object) -> str:
    """Returns a value as a scenario's file has it, in a line: of an object its tag."""
    if isinstance(value, np.ndarray) and value.ndim:
        text = np.array2string(value, separator=", ", threshold=12)
    elif isinstance(value, np.generic | np.ndarray):
        text = repr(value.item())
    elif isinstance(value, str | bytes | int | float | complex | None):
        text = repr(value)
    elif isinstance(value, Path):
        text = repr(str(value))
    elif isinstance(value, Mapping):
        text = "{" + ", ".join(f"{key}: {shown(each)}" for key, each in value.items()) + "}"
    elif isinstance(value, Sequence | set | frozenset):
        text = "[" + ", ".join(map(shown, value)) + "]"
    else:
        text = f"!{(value if isinstance(value, type) else type(value)).__name__}"
    return " ".join(text.split())


class InvalidFile(InvalidParameter):
    """A file that cannot be used, or several that belong together.

    Attributes:
        complaints: All that is wrong with it, a line each; the first one is the error's text.
    """

    def __init__(self, complaints: Sequence[str]):
        self.complaints = tuple(complaints)
        more = len(self.complaints) - 1
        super().__init__(self.complaints[0], None, "usable")
        self.args = (self.complaints[0] + (f" (and {more} more)" if more else ""),)


def require(condition: bool, key: str, value: object, allowed: str) -> None:
    """Raises `InvalidParameter` unless `condition` holds."""
    if not condition:
        raise InvalidParameter(key, value, allowed)


def shortened(text: str, most: int = 60) -> str:
    """Returns a text of at most `most` characters, a longer one without its middle."""
    half = (most - 5) // 2
    return text if len(text) <= most else f"{text[:half]} ... {text[-half:]}"


@contextmanager
def within(prefix: str) -> Iterator[None]:
    """Prepends `prefix.` to the key of an `InvalidParameter` raised inside the block."""
    try:
        yield
    except InvalidParameter as error:
        raise InvalidParameter(f"{prefix}.{error.key}", error.value, error.allowed) from None


def vector(key: str, value: object, size: int) -> np.ndarray:
    """Returns `value` as a finite float vector of the given size, or raises."""
    return _array(key, value, (size,), f"{size} finite numbers")


def unit_vector(key: str, value: object) -> np.ndarray:
    """Returns `value` as a vector (3,) of length 1, to 1e-6, or raises."""
    direction = vector(key, value, 3)
    require(bool(abs(np.linalg.norm(direction) - 1.0) < 1e-6), key, direction, "a unit vector")
    return direction


def _array(key: str, value: object, shape: tuple[int, ...], allowed: str) -> np.ndarray:
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InvalidParameter(key, value, allowed) from None
    require(array.shape == shape and bool(np.all(np.isfinite(array))), key, value, allowed)
    return array


def symmetric_matrix(key: str, value: object, size: int, *, definite: bool) -> np.ndarray:
    """Returns a symmetric positive definite (or semidefinite) matrix, or raises.

    Symmetry and semidefiniteness are checked to 1e-9 of the largest entry.
    """
    kind = "definite" if definite else "semidefinite"
    allowed = f"a symmetric positive {kind} {size}×{size} matrix"
    array = _array(key, value, (size, size), allowed)
    scale = max(float(np.max(np.abs(array))), 1e-300)
    require(bool(np.max(np.abs(array - array.T)) <= 1e-9 * scale), key, array,
            f"{allowed} (it is not symmetric)")
    smallest = float(np.linalg.eigvalsh(array)[0])
    enough = smallest > 0.0 if definite else smallest >= -1e-9 * scale
    require(enough, key, array, f"{allowed} (its smallest eigenvalue is {smallest:.3g})")
    return 0.5 * (array + array.T)


class ScenarioError(Exception):
    """A scenario cannot be used. The text is one line: file, key, value and allowed values."""


class RunFailed(RuntimeError):
    """A run was started and could not be carried through. The text is one line."""
