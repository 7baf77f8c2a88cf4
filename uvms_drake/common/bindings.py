"""Names of the costs and constraints of a `MathematicalProgram`."""

from typing import Any


def named(binding: Any, name: str) -> Any:
    """Returns a binding of a cost or constraint, with this description of its evaluator."""
    binding.evaluator().set_description(name)
    return binding
