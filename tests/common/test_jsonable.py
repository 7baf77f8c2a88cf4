"""Numbers, arrays and values that are not finite in JSON."""

import json
from dataclasses import asdict, dataclass

import numpy as np

from uvms_drake.common.jsonable import from_jsonable, jsonable

VALUE = {"a": np.array([1.0, np.nan]), "b": (np.int64(2), -np.inf), "c": {"d": [np.inf, "x", None]}}


def test_numbers_that_are_not_finite_become_null():
    assert jsonable(VALUE) == {"a": [1.0, None], "b": [2, None], "c": {"d": [None, "x", None]}}


@dataclass
class Part:
    """One of each type of a field."""

    size: float
    name: str | None
    rows: np.ndarray


@dataclass
class Whole:
    """A part in each place."""

    parts: tuple[Part, ...]
    sizes: dict[str, dict[str, float]]
    part: Part | None
    count: int = 3


def test_or_they_keep_their_names_and_come_back_in_their_types():
    assert jsonable(VALUE, names=True) == {
        "a": [1.0, "nan"], "b": [2, "-inf"], "c": {"d": ["inf", "x", None]}}
    part = Part(np.inf, None, np.array([[1.0, -np.inf]]))
    whole = Whole((part,), {"a": {"b": np.inf}}, None)
    plain = json.loads(json.dumps(jsonable(asdict(whole), names=True), allow_nan=False))
    again = from_jsonable(Whole, plain)
    assert (again.sizes, again.part, again.count) == (whole.sizes, None, 3)
    (found,) = again.parts
    assert (found.size, found.name) == (np.inf, None)
    np.testing.assert_array_equal(found.rows, part.rows)
    assert from_jsonable(Whole, {key: plain[key] for key in ("parts", "sizes", "part")}).count == 3
