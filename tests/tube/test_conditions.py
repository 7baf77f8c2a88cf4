"""Tests of `uvms_drake.tube.conditions`."""

import math
from dataclasses import FrozenInstanceError

import pytest

from uvms_drake.tube.conditions import Condition


def test_a_condition_is_a_row_of_a_table():
    row = Condition("ab, above J̄G", 2.0, ">", 3.0, theorem="t")
    assert (row.holds, row.margin) == (False, -1.0)
    assert str(row) == "ab, above J̄G: 2 > 3 does not hold"
    assert str(Condition("x", 2.0, "<=", 2.0, theorem="t")) == "x: 2 <= 2 holds"
    assert not Condition("x", 2.0, "<", 2.0, theorem="t").holds
    assert Condition("x", 2.0, "<", 2.5, theorem="t").margin == 0.5
    for relation in ("<", "<=", ">", ">="):
        assert not Condition("x", math.nan, relation, 1.0, theorem="t").holds
    with pytest.raises(FrozenInstanceError):
        row.left = 4.0
