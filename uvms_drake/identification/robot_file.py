"""A robot's `hydrodynamics.yaml` with identified numbers in place of its own, the rest as it is."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml  # type: ignore[import-untyped]

from uvms_drake.model.description.hydrodynamics_file import (
    BodyHydrodynamics,
    HydrodynamicParameters,
)

FILE = "hydrodynamics.yaml"


def with_numbers(text: str, before: HydrodynamicParameters, after: HydrodynamicParameters) -> str:
    """Returns the text of a file with the numbers that have changed; comments stay.

    Args:
        text: Text of the file, which gives `before`.
        before: Its parameters.
        after: The new ones, of the same bodies.
    """
    bodies = _entry(yaml.compose(text, Loader=yaml.SafeLoader), "bodies")
    edits = [edit for name, body in after.bodies.items()
             for edit in _edits(_entry(bodies, name), before.bodies[name], body)]
    for start, end, number in sorted(edits, reverse=True):
        text = f"{text[:start]}{number}{text[end:]}"
    return text


def _edits(node: Any, before: BodyHydrodynamics, after: BodyHydrodynamics
           ) -> Iterator[tuple[int, int, str]]:
    """Yields start, end and new text of each number of a body that has changed."""
    pairs = [(node, name, getattr(before, name), getattr(after, name))
             for name in ("displaced_volume", "center_of_buoyancy")]
    for group, names in (("added_mass", ("matrix",)), ("drag", ("linear", "quadratic"))):
        olds, news = getattr(before, group), getattr(after, group)
        pairs += [(item, name, getattr(old, name), getattr(new, name))
                  for item, old, new in zip(_items(node, group), olds, news, strict=True)
                  for name in names]
    for inside, name, old, new in pairs:
        if not np.array_equal(old, new):
            value = _entry(inside, name)
            number = _rounded(np.asarray(new, dtype=float))
            if value is None:  # A default, zero: in front, in flow style or in a line.
                first = inside.value[0][0].start_mark
                end = ", " if inside.flow_style else f"\n{' ' * first.column}"
                yield (first.index, first.index, f"{name}: {number}{end}")
            else:
                yield value.start_mark.index, _end(value), str(number)


def _end(node: Any) -> int:
    """Returns the end of a node's last number: that of a block is where the next key begins."""
    while isinstance(node, yaml.SequenceNode) and not node.flow_style:
        node = node.value[-1]
    end: int = node.end_mark.index
    return end


def _entry(node: Any, name: str) -> Any:
    """Returns the value of a key of a mapping, or None."""
    return next((value for key, value in node.value if key.value == name), None)


def _items(node: Any, name: str) -> list[Any]:
    found = _entry(node, name)
    return [] if found is None else list(found.value)


def _rounded(number: np.ndarray) -> Any:
    """Returns nested lists of numbers with six digits."""
    if number.ndim:
        return [_rounded(each) for each in number]
    return float(f"{float(number):.6g}")


def source_of(folder: Path) -> str:
    """Returns the text of a robot's file."""
    return (folder / FILE).read_text(encoding="utf-8")
