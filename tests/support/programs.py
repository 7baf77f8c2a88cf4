"""Checks of a `MathematicalProgram`: derivatives, and what it says of a plan."""

from typing import Any

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.solvers import MathematicalProgram


def names(bindings: list[Any]) -> list[str]:
    """Returns the names of bindings."""
    return [binding.evaluator().get_description() for binding in bindings]


def check_derivatives(program: MathematicalProgram, values: np.ndarray, step: float = 1e-5) -> int:
    """Compares the derivatives of costs and constraints that are functions with differences.

    Args:
        program: The program.
        values: Of all its variables.
        step: Of the central differences, of fourth order.

    Returns:
        Number of the functions.
    """
    checked = [*program.generic_costs(), *program.generic_constraints()]
    for binding in checked:
        evaluator = binding.evaluator()
        x = values[program.FindDecisionVariableIndices(binding.variables())]
        dual = evaluator.Eval(InitializeAutoDiff(x).ravel())
        value, jacobian = ExtractValue(dual).ravel(), ExtractGradient(dual)
        np.testing.assert_array_equal(value, evaluator.Eval(x))
        scale = 1.0 + np.max(np.abs(jacobian), axis=1)
        # A few directions that move all variables, and some of the variables alone.
        rng = np.random.default_rng(0)
        directions = [*rng.normal(size=(3, len(x))), *np.eye(len(x))[:: max(1, len(x) // 8)]]
        for e in directions:
            near, far = (evaluator.Eval(x + n * step * e) - evaluator.Eval(x - n * step * e)
                         for n in (1, 2))
            slope = (8.0 * near - far) / (12.0 * step)
            error = np.abs(jacobian @ e - slope)
            assert np.all(error <= 1e-6 * scale * np.linalg.norm(e)), (
                f"{evaluator.get_description()}: {error}")
    return len(checked)


def cost(program: MathematicalProgram, values: np.ndarray) -> float:
    """Returns the sum of all costs."""
    return float(sum(program.EvalBindings(program.GetAllCosts(), values)))


def excess(program: MathematicalProgram, values: np.ndarray, prefix: str = "") -> float:
    """Returns the largest violation of the constraints whose names have this prefix.

    A cone counts as it is evaluated, by its norm's excess over its bound.
    """
    out = 0.0
    for binding in program.GetAllConstraints():
        evaluator = binding.evaluator()
        if evaluator.get_description().startswith(prefix):
            value = program.EvalBinding(binding, values)
            lower, upper = evaluator.lower_bound(), evaluator.upper_bound()
            out = max(out, float(np.max(lower - value)), float(np.max(value - upper)))
    return out
