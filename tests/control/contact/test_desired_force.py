"""Tests of `uvms_drake.control.contact.desired_force`."""

import numpy as np
import pytest

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.contact.desired_force import DesiredForce

N = np.array([0.0, 0.6, 0.8])


def outputs(wanted: np.ndarray | None) -> tuple[np.ndarray, float]:
    system = DesiredForce(N, 12.0, 30.0)
    context = system.CreateDefaultContext()
    if wanted is not None:
        system.GetInputPort("desired_force").FixValue(context, wanted)
    along = system.GetOutputPort("along").Eval(context)
    return system.GetOutputPort("accepted_force").Eval(context), float(along[0])


@pytest.mark.parametrize(("force", "accepted"), [(20.0, 20.0), (40.0, 30.0), (-5.0, 0.0)])
def test_a_force_along_the_direction_is_cut_to_what_can_be_given(force: float, accepted: float):
    wrench, along = outputs(np.append(force * N, np.zeros(3)))
    assert along == pytest.approx(accepted)
    assert wrench == pytest.approx(np.append(accepted * N, np.zeros(3)))


def test_what_is_across_the_direction_is_left_out():
    wrench, along = outputs(np.append(10.0 * N + 3.0 * np.array([1.0, 0.0, 0.0]), np.ones(3)))
    assert along == pytest.approx(10.0)
    assert wrench == pytest.approx(np.append(10.0 * N, np.zeros(3)))


def test_without_a_wish_or_with_one_that_is_none_the_default_holds():
    assert outputs(None)[1] == outputs(np.full(6, np.nan))[1] == 12.0


def test_a_default_beyond_the_largest_is_refused():
    with pytest.raises(InvalidParameter, match="default"):
        DesiredForce(N, 31.0, 30.0)
