"""Robots of tests with mistakes: the template, and those of `tests/field_cases`.

Field cases are robots of other people's files that were taken wrongly.
"""

import shutil
from pathlib import Path

from uvms_drake.model.description.robot_files import model_dir

TEMPLATE = "box_uvms"
FIELD_CASES = Path(__file__).parents[1] / "field_cases"
DIVER = FIELD_CASES / "diver"


def copied(case: str | Path, folder: Path, *changes: tuple[str, str, str], **files: str) -> Path:
    """Returns a copy of a robot in `folder`, texts replaced, and files beside it.

    Args:
        case: The robot's folder, in `FIELD_CASES` or anywhere.
        folder: Where to write.
        changes: Suffix of the file's name, the old text, which must be there and is changed
            wherever it stands, and the new one.
        files: Text of further files by name, with a double underscore for the point.
    """
    robot = folder / Path(case).name
    shutil.copytree(FIELD_CASES / case, robot)
    for suffix, old, new in changes:
        (file,) = robot.glob(f"*{suffix}")
        text = file.read_text(encoding="utf-8")
        assert old in text, (suffix, old)
        file.write_text(text.replace(old, new), encoding="utf-8")
    for name, text in files.items():
        (robot / name.replace("__", ".")).write_text(text, encoding="utf-8")
    return robot


def altered(folder: Path, *changes: tuple[str, str, str]) -> Path:
    """Returns a copy of the template, see `copied`."""
    return copied(model_dir(TEMPLATE), folder, *changes)


def diver(folder: Path, *changes: tuple[str, str, str], **files: str) -> Path:
    """Returns a copy of a URDF with two joints and thrusters, see `copied`."""
    return copied(DIVER, folder, *changes, **files)


def without_an_arm(folder: Path, *changes: tuple[str, str, str]) -> Path:
    """Returns a copy of the template whose arm is part of the vehicle: n = 0, see `copied`."""
    tip = '<frame name="tip" attached_to="forearm">'
    return altered(folder, (".sdf", tip, tip.replace("forearm", "vehicle")),
                   (".sdf", 'type="revolute"', 'type="fixed"'), *changes)
