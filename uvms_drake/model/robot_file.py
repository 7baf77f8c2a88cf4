"""The YAML files of a robot's folder, read alike: what is wrong is said with the file's path."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from pydrake.common.yaml import yaml_load_typed

from uvms_drake.common.errors import InvalidParameter

T = TypeVar("T")


def load_robot_file(path: Path, key: str, schema: type[T], check: Callable[[T], None]) -> T:
    """Reads and checks a YAML file; the key of an error starts with its path.

    Args:
        path: Of the file.
        key: What the file is about, for one that cannot be read.
        schema: Dataclass of its content.
        check: Raises `InvalidParameter` for the first value that has no meaning.
    """
    try:
        content: T = yaml_load_typed(schema=schema, filename=str(path))
        check(content)
    except InvalidParameter as error:
        raise InvalidParameter(f"{path}: {error.key}", error.value, error.allowed) from None
    except Exception as error:  # PyYAML's and Drake's own, of many types.
        reason = " ".join(str(error).split()) or "an entry is empty"
        raise InvalidParameter(key, str(path), f"readable: {reason}") from None
    return content
