"""Bad input as a table: each row an override and what its one line says."""

import re
from collections.abc import Callable

import pytest

import uvms_drake as uv
from uvms_drake.common.errors import InvalidParameter, ScenarioError

OBJECT = re.compile(r"array\(|\w\(\w+=|object at 0x|\bnp\.|Path\(|<class|<function")
"""Text of an object of Python, which no message has."""


def refusals(scenario: str, rows: dict[str, str], use: Callable = lambda loaded: None):
    """Returns a test that refuses each override (`key=value`) by one line that has the text.

    A key of several overrides separates them by `; `. In a test file:
    `test_bad_input = refusals("girona500_contact", {"mpc.horizon=0": "mpc.horizon: ..."})`.
    What is refused later is found by `use` of the loaded scenario, `uv.make_station` for example.
    """
    @pytest.mark.parametrize(("overrides", "text"), rows.items(), ids=list(rows))
    def test(overrides, text):
        with pytest.raises((InvalidParameter, ScenarioError), match=text) as caught:
            use(uv.load_scenario(scenario, overrides.split("; ")))
        assert "\n" not in str(caught.value)
        assert not OBJECT.search(str(caught.value))
    return test
