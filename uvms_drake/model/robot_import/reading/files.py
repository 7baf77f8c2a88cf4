"""Finds the files that a robot's file names, by the rules of ROS and Gazebo, near that file."""

from collections.abc import Iterator
from pathlib import Path

LEVELS = 6
"""Number of folders above a file in which packages and models are sought."""


def resolve(uri: str, file: Path) -> Path | None:
    """Returns the file or folder that a URI names, None if it is not there.

    Args:
        uri: `package://NAME/...`, `model://NAME/...`, `file://...` or a path.
        file: The file that refers to it.
    """
    scheme, mark, rest = uri.partition("://")
    if not mark:
        places: Iterator[Path] = iter([file.parent / uri])
    elif scheme == "file":
        places = iter([Path(rest), file.parent / rest])
    else:
        name, _, path = rest.partition("/")
        places = (folder / path for folder in _packages(name, file))
    return next((place for place in places if place.exists()), None)


def _packages(name: str, file: Path) -> Iterator[Path]:
    """Yields the folders that a package or model of this name may be."""
    for folder in list(file.resolve().parents)[:LEVELS]:
        if folder.name == name or f"<name>{name}</name>" in _text(folder / "package.xml"):
            yield folder
        yield folder / name
        yield folder / "models" / name


def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8", errors="replace") if file.is_file() else ""


def model_file(place: Path) -> Path | None:
    """Returns the SDFormat or URDF file of a model: itself, or the newest one in its folder."""
    if place.is_file():
        return place
    return next((file for name in ("model.sdf", f"{place.name}.sdf", f"{place.name}.urdf")
                 if (file := place / name).is_file()), None)
