"""The robot of `tests/field_cases`, a URDF with two joints and thrusters, with mistakes."""

import shutil
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "field_cases" / "diver"
NAME = FOLDER.name


def diver(folder: Path, *changes: tuple[str, str, str], **files: str) -> Path:
    """Returns a copy of the robot in `folder`, texts replaced, and files beside it.

    Args:
        folder: Where to write.
        changes: Suffix of the file's name, the old text, which must be there, and the new one.
        files: Text of further files by name, with a double underscore for the point.
    """
    robot = folder / NAME
    shutil.copytree(FOLDER, robot)
    for suffix, old, new in changes:
        (file,) = robot.glob(f"*{suffix}")
        text = file.read_text(encoding="utf-8")
        assert old in text, (suffix, old)
        file.write_text(text.replace(old, new), encoding="utf-8")
    for name, text in files.items():
        (robot / name.replace("__", ".")).write_text(text, encoding="utf-8")
    return robot
