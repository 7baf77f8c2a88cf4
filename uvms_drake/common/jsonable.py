"""Values in the types of JSON, which has no arrays, no inf and no NaN."""

import builtins
import dataclasses
import json
import math
import types
import typing
from pathlib import Path
from typing import Any

import numpy as np


def jsonable(value: Any, *, names: bool = False) -> Any:
    """Returns the value with lists for arrays and tuples, all the way down.

    Args:
        value: Dictionaries with names for keys, sequences, arrays, numbers and text.
        names: Whether a number that is not finite becomes its name, which `from_jsonable` reads. If
            not, it becomes None.
    """
    if isinstance(value, dict):
        return {key: jsonable(item, names=names) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [jsonable(item, names=names) for item in value]
    if isinstance(value, np.generic):
        return jsonable(value.item(), names=names)
    if isinstance(value, float) and not math.isfinite(value):
        return str(value) if names else None
    return value


def write_json(data: Any, path: Path) -> None:
    """Writes data as a file of JSON; a number that is not finite is null."""
    text = json.dumps(jsonable(data), indent=1, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def from_jsonable(kind: Any, value: Any) -> Any:
    """Returns the value of a type of which `jsonable` made `value`, with `names`.

    Args:
        kind: A dataclass, whose fields are of such types, too; `tuple[X, ...]`, `dict[str, X]`, an
            array, a number or text, or any of these or None.
        value: Its data.
    """
    inner = typing.get_args(kind)
    if isinstance(kind, types.UnionType):
        return None if value is None else from_jsonable(inner[0], value)
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        return kind(**{key: from_jsonable(hints[key], item) for key, item in value.items()})
    match typing.get_origin(kind) or kind:
        case builtins.tuple:
            return tuple(from_jsonable(inner[0], item) for item in value)
        case builtins.dict:
            return {key: from_jsonable(inner[1], item) for key, item in value.items()}
        case np.ndarray:
            return np.array(value, dtype=float)
        case builtins.float:
            return float(value)  # Of a name, too.
    return value
