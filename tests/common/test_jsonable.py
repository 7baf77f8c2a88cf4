"""Numbers, arrays and values that are not finite in JSON."""

import json

import numpy as np

from uvms_drake.common.jsonable import jsonable, restored

VALUE = {"a": np.array([1.0, np.nan]), "b": (np.int64(2), -np.inf), "c": {"d": [np.inf, "x", None]}}


def test_numbers_that_are_not_finite_become_null():
    assert jsonable(VALUE) == {"a": [1.0, None], "b": [2, None], "c": {"d": [None, "x", None]}}


def test_or_they_keep_their_names_and_come_back():
    plain = jsonable(VALUE, names=True)
    assert plain == {"a": [1.0, "nan"], "b": [2, "-inf"], "c": {"d": ["inf", "x", None]}}
    again = restored(json.loads(json.dumps(plain, allow_nan=False)))
    assert again["b"] == [2, -np.inf]
    assert again["c"]["d"] == [np.inf, "x", None]
    assert np.isnan(again["a"][1])
