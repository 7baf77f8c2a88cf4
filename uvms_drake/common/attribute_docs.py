"""Descriptions of the attributes of a class, and their place in the text that `help` prints.

The description of an attribute is the string below it, which Python does not keep: it is read from
the source of the class and of those that it inherits from.
"""

import ast
import inspect
import sys
from collections.abc import Iterable
from functools import cache

PACKAGE = __name__.split(".")[0]


@cache
def describe_attributes(kind: type) -> None:
    """Adds the descriptions of the attributes of a class to its docstring."""
    found = attribute_docs([base for base in kind.__mro__
                            if base.__module__.split(".")[0] == PACKAGE])
    if found:
        lines = [f"    {name}: {text}" for name, text in found.items()]
        kind.__doc__ = "\n".join([inspect.getdoc(kind) or "", "", "Attributes:", *lines])


def attribute_docs(bases: Iterable[type]) -> dict[str, str]:
    """Returns the descriptions by attribute of some classes, the first of which goes first."""
    found: dict[str, str] = {}
    for base in reversed(list(bases)):
        found |= _described(base.__module__).get(base.__qualname__, {})
    return found


@cache
def _described(module: str) -> dict[str, dict[str, str]]:
    """Returns the descriptions by class and attribute, of the classes of a module."""
    try:
        with open(getattr(sys.modules[module], "__file__", None) or "", encoding="utf-8") as file:
            tree = ast.parse(file.read())
    except OSError:  # Without a source there are none.
        return {}
    return {node.name: _attributes(node) for node in tree.body if isinstance(node, ast.ClassDef)}


def _attributes(node: ast.ClassDef) -> dict[str, str]:
    found = {}
    for above, below in zip(node.body, node.body[1:], strict=False):
        target = (above.target if isinstance(above, ast.AnnAssign) else
                  above.targets[0] if isinstance(above, ast.Assign) else None)
        if (isinstance(target, ast.Name) and isinstance(below, ast.Expr)
                and isinstance(below.value, ast.Constant) and isinstance(below.value.value, str)):
            found[target.id] = inspect.cleandoc(below.value.value).replace("\n", "\n        ")
    return found
