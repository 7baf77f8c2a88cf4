"""The YAML files of a robot's folder, read alike: what is wrong is said with the file's path."""

from collections.abc import Callable
from copy import deepcopy
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar

from pydrake.common.yaml import yaml_load_typed

from uvms_drake.common.errors import InvalidParameter

T = TypeVar("T")

KEPT = 16
"""Number of texts whose content is remembered: PyYAML takes longer than to build the rest of a
station, and the runs of a campaign read the same robot again and again."""


@lru_cache(maxsize=KEPT)
def _content(schema: type, text: str) -> Any:
    return yaml_load_typed(schema=schema, data=text)


def load_robot_file(path: Path, key: str, schema: type[T], check: Callable[[T], None]) -> T:
    """Reads and checks a YAML file; the key of an error starts with its path.

    Args:
        path: Of the file.
        key: What the file is about, for one that cannot be read.
        schema: Dataclass of its content.
        check: Raises `InvalidParameter` for the first value that has no meaning.
    """
    try:
        text = path.read_text(encoding="utf-8")
        content: T = deepcopy(_content(schema, text))  # type: ignore[arg-type]  # It is hashable.
        check(content)
    except InvalidParameter as error:
        raise InvalidParameter(f"{path}: {error.key}", error.value, error.allowed) from None
    except Exception as error:  # PyYAML's and Drake's own, of many types.
        reason = " ".join(str(error).split()) or "an entry is empty"
        reason = reason.replace('in "<unicode string>", ', "at ")
        raise InvalidParameter(key, str(path), f"readable: {reason}") from None
    return content
