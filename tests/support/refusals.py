"""Bad input as a table: each row an override and what its one line says."""

import re

import pytest

from support.scenarios import error_of


def refusals(scenario: str, rows: dict[str, str]):
    """Returns a test that refuses each override (`key=value`) by one line that has the text.

    A key of several overrides separates them by `; `. In a test file:
    `test_bad_input = refusals("girona500_contact", {"mpc.horizon=0": "mpc.horizon: ..."})`.
    """
    @pytest.mark.parametrize(("overrides", "text"), rows.items(), ids=list(rows))
    def test(overrides, text):
        assert re.search(text, error_of(scenario, overrides.split("; ")))
    return test
