"""Tests of `uvms_drake.common.errors`."""

import numpy as np
import pytest

import uvms_drake as uv
from uvms_drake.common.errors import require, symmetric_matrix, unit_vector, vector, within


@pytest.mark.parametrize("value", [np.eye(6), np.arange(100.0)])
def test_the_message_is_one_line_for_any_array(value):
    message = str(uv.InvalidParameter("key", value, "small"))
    assert "\n" not in message
    assert message.endswith(": must be small")
    assert len(message) < 300


def test_what_is_allowed_is_one_line_too():
    """Arrays in it break lines as they like."""
    error = uv.InvalidParameter("key", 1.0, f"within {np.linspace(-1.0, 1.0, 40)},\n   see there")
    assert "\n" not in str(error)
    assert "  " not in error.allowed
    assert str(error).endswith(f": must be {error.allowed}")
    assert error.allowed.startswith("within [-1. -0.948")
    assert error.allowed.endswith("1. ], see there")


def test_within_prepends_the_path_from_outside_in():
    with pytest.raises(uv.InvalidParameter) as caught, within("bodies"), within("link1"):
        require(False, "volume", -1, "positive")
    assert caught.value.key == "bodies.link1.volume"
    assert str(caught.value) == "bodies.link1.volume = -1: must be positive"


def test_vector_returns_a_float_copy():
    given = np.array([1, 2, 3])
    returned = vector("v", given, 3)
    assert returned.dtype == float
    assert not np.shares_memory(returned, given)
    np.testing.assert_array_equal(returned, given)


@pytest.mark.parametrize(
    "value", [[1.0, 2.0], [[1.0, 2.0, 3.0]], 1.0, [1.0, np.nan, 0.0], [1.0, 2.0, np.inf],
              ["a", "b", "c"], None, [[1.0], [2.0, 3.0]]])
def test_vector_refuses_all_but_finite_numbers_of_the_size(value):
    with pytest.raises(uv.InvalidParameter, match=r"^key = .*: must be 3 finite numbers$"):
        vector("key", value, 3)


def test_symmetric_matrix_says_that_a_matrix_is_not_symmetric():
    with pytest.raises(uv.InvalidParameter, match=r"definite 2×2 matrix \(it is not symmetric\)"):
        symmetric_matrix("K", [[1.0, 0.1], [0.0, 1.0]], 2, definite=True)


def test_only_a_semidefinite_demand_accepts_a_singular_matrix():
    singular = np.diag([1.0, 0.0])
    np.testing.assert_array_equal(symmetric_matrix("K", singular, 2, definite=False), singular)
    with pytest.raises(uv.InvalidParameter, match="positive definite"):
        symmetric_matrix("K", singular, 2, definite=True)


def test_symmetric_matrix_tolerates_rounding_and_removes_it():
    K = np.array([[2.0, 1.0 + 1e-12], [1.0, 2.0]])
    returned = symmetric_matrix("K", K, 2, definite=True)
    np.testing.assert_array_equal(returned, returned.T)
    np.testing.assert_allclose(returned, K, rtol=1e-12)


def test_a_unit_vector_has_three_components_and_length_one():
    np.testing.assert_array_equal(unit_vector("n", [0.6, 0.0, -0.8]), [0.6, 0.0, -0.8])
    for value in ([2.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.6, 0.8], [np.nan, 0.0, 1.0]):
        with pytest.raises(uv.InvalidParameter, match=r"^n = \["):
            unit_vector("n", value)
