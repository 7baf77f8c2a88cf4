"""Results that take long, kept between runs by a hash of their inputs."""

import functools
import hashlib
import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from uvms_drake.common.program import FOLDER


def cache_dir() -> Path:
    """Returns $XDG_CACHE_HOME/uvms_drake, or ~/.cache/uvms_drake."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "uvms_drake"


def cached(key: Any, compute: Callable[[], Any]) -> Any:
    """Returns `compute()`, or its last result for the same key.

    A cache that is corrupt is ignored and made again; one that cannot be written is no error.

    Args:
        key: All that the result depends on, as JSON data; this package's source is added.
        compute: Returns JSON data.
    """
    found = stored(key)
    if found is not None:
        return found
    value = compute()
    store(key, value)
    return value


def stored(key: Any) -> Any:
    """Returns the value that is kept for a key, as of `cached`; None if there is none."""
    text, path = _entry(key)
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        return found["value"] if found["key"] == json.loads(text) else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def store(key: Any, value: Any) -> None:
    """Keeps a value, JSON data, for a key, as of `cached`."""
    text, path = _entry(key)
    _write(path, json.dumps({"key": json.loads(text), "value": value}))


def _entry(key: Any) -> tuple[str, Path]:
    """Returns the text of a key with this package's source, and the path of its file."""
    text = json.dumps([source_digest(), key], sort_keys=True)
    return text, cache_dir() / f"{hashlib.sha256(text.encode()).hexdigest()}.json"


@functools.cache
def source_digest(*others: str, without: tuple[str, ...] = ()) -> str:
    """Returns the SHA-256 of the package's Python files, and of the table by which it reads robots.

    Args:
        others: Patterns of further files, such as `*.yaml` for scenarios and gains.
        without: Rooms that do not count.
    """
    digest = hashlib.sha256()
    for path in sorted({path for pattern in ("*.py", "elements.yaml", *others)
                        for path in FOLDER.rglob(pattern)}):
        name = path.relative_to(FOLDER)
        if name.parts[0] not in without:
            digest.update(str(name).encode() + path.read_bytes())
    return digest.hexdigest()


def _write(path: Path, text: str) -> None:
    """Writes a file whole or not at all."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
        os.replace(name, path)
    except OSError:
        pass
