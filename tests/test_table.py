"""Tests of `uvms_drake.certificate.table`; the whole table is looked at in test_certify."""

from dataclasses import replace

import numpy as np
import pytest

from uvms_drake.certificate.certificate import Certificate
from uvms_drake.certificate.conditions import Condition
from uvms_drake.certificate.table import HELP, format_certificate, verdict

EMPTY = Certificate(scenario="s", law="resolved", k=1.0, sigma=1.0, d_bound=0.1, files={},
                    inputs="", versions={})


def test_the_first_failed_condition_is_the_verdict():
    certificate = replace(EMPTY, conditions=(
        Condition("fine", 1.0, ">", 0.0), Condition("tube in limits.u[1]", 0.5, "<", 0.3),
        Condition("worse", 9.0, "<", 0.0)))
    assert verdict(certificate).startswith(
        "void: tube in limits.u[1]: 0.5 < 0.3 does not hold by 0.2; what would help: ")
    assert format_certificate(certificate).count("DOES NOT HOLD") == 2


def test_a_number_that_is_none_fails_without_an_amount():
    line = verdict(replace(EMPTY, conditions=(Condition("x", np.nan, "<=", 0.0),)))
    assert line == "void: x: nan <= 0 does not hold"


@pytest.mark.parametrize("beginning", HELP)
def test_every_advice_is_given(beginning):
    line = verdict(replace(EMPTY, conditions=(Condition(beginning + "...", 1.0, "<", 0.0),)))
    assert line.endswith(HELP[beginning])
