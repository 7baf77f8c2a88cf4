"""Functions with derivatives of their own, for Drake's solvers."""

from collections.abc import Callable

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff


def differentiable(function: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
                   ) -> Callable[[np.ndarray], np.ndarray]:
    """Returns a function for `AddConstraint` and, with a single component, `AddCost`.

    Args:
        function: Function from a point (d,) to values (m,) and their Jacobian (m, d).
    """
    def evaluate(x: np.ndarray) -> np.ndarray:
        """Returns the values, with their gradient if `x` has one."""
        if x.dtype != object:
            return function(x)[0]
        values, jacobian = function(ExtractValue(x).ravel())
        chained: np.ndarray = InitializeAutoDiff(values, jacobian @ ExtractGradient(x))
        return chained.ravel()
    return evaluate
