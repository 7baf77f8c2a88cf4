"""Values in the types of JSON, which has no arrays, no inf and no NaN."""

import math
from typing import Any

import numpy as np

_NAMES = ("inf", "-inf", "nan")


def jsonable(value: Any, *, names: bool = False) -> Any:
    """Returns the value with lists for arrays and tuples, all the way down.

    Args:
        value: Dictionaries with names for keys, sequences, arrays, numbers and text.
        names: Whether a number that is not finite becomes its name, which `restored` reads. If not,
            it becomes None.
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


def restored(value: Any) -> Any:
    """Returns the value with numbers for "inf", "-inf" and "nan", all the way down."""
    if isinstance(value, dict):
        return {key: restored(item) for key, item in value.items()}
    if isinstance(value, list):
        return [restored(item) for item in value]
    return float(value) if value in _NAMES else value
