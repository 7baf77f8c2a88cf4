"""Tests of `uvms_drake.tube.settings`."""

import numpy as np
import pytest

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.tube.settings import CertificateSettings, PlanClass, PlanRows, check_settings


def test_the_defaults_are_fit():
    assert check_settings(CertificateSettings(), 4) is None


@pytest.mark.parametrize(("key", "value"), [
    ("constant_samples", 9), ("tube_samples", 0), ("terminal_samples", -5),
    ("safety_factor", 0.99), ("seed", -1)])
def test_what_means_nothing_is_named(key, value):
    with pytest.raises(InvalidParameter) as caught:
        check_settings(CertificateSettings(**{key: value}), 4)
    assert caught.value.key == key


def rows(size: float, joints: int = 2) -> PlanRows:
    return PlanRows(**{key: size * np.arange(1.0, 1 + (
        joints if key in ("joints", "qdot") else 3)) for key in vars(PlanRows())})


def test_rows_of_a_class_of_plans_are_in_the_order_of_the_loops():
    np.testing.assert_array_equal(rows(2.0).rows(), 2.0 * np.array(
        [1, 2, 3] * 3 + [1, 2] + [1, 2, 3] * 3 + [1, 2]))


@pytest.mark.parametrize(("plans", "key"), [
    (PlanClass(rows(1.0, 3), rows(1.0)), "plans.approach.joints"),
    (PlanClass(rows(1.0), rows(-1.0)), "plans.press.tip"),
    (PlanClass(rows(1.0), PlanRows()), "plans.press.tip"),
    (PlanClass(rows(1.0), rows(1.0), -0.1), "plans.start")])
def test_a_class_of_plans_without_a_meaning_is_named(plans, key):
    assert check_settings(CertificateSettings(plans=PlanClass(rows(1.0), rows(2.0))), 2) is None
    with pytest.raises(InvalidParameter) as caught:
        check_settings(CertificateSettings(plans=plans), 2)
    assert caught.value.key == key
