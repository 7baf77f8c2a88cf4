"""Functions with derivatives of their own in Drake's hands."""

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from uvms_drake.common.differentiable import differentiable


def spiral(x):
    """Returns (x₀x₁, x₀ + 3x₁) and the Jacobian."""
    return np.array([x[0] * x[1], x[0] + 3.0 * x[1]]), np.array([[x[1], x[0]], [1.0, 3.0]])


def test_values_are_the_functions_and_derivatives_follow_the_chain_rule():
    x, inner = np.array([2.0, -0.5]), np.array([[1.0, 2.0, 0.0], [0.0, -1.0, 4.0]])
    f = differentiable(spiral)
    np.testing.assert_array_equal(f(x), [-1.0, 0.5])
    chained = f(InitializeAutoDiff(x, inner).ravel())
    np.testing.assert_array_equal(ExtractValue(chained).ravel(), [-1.0, 0.5])
    np.testing.assert_allclose(ExtractGradient(chained), spiral(x)[1] @ inner)
