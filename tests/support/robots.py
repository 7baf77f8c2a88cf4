"""The template of a robot, with mistakes."""

import shutil
from pathlib import Path

from uvms_drake.model.description.robot_files import model_dir

TEMPLATE = "box_uvms"


def altered(folder: Path, *changes: tuple[str, str, str]) -> Path:
    """Returns a copy of the template in `folder`, texts replaced: (suffix of the file, old, new).

    Every place where the old text stands is changed; it must be there.
    """
    robot = folder / TEMPLATE
    shutil.copytree(model_dir(TEMPLATE), robot)
    for suffix, old, new in changes:
        (file,) = robot.glob(f"*{suffix}")
        text = file.read_text(encoding="utf-8")
        assert old in text, (suffix, old)
        file.write_text(text.replace(old, new), encoding="utf-8")
    return robot


def without_an_arm(folder: Path) -> Path:
    """Returns a copy of the template whose arm is part of the vehicle: n = 0."""
    tip = '<frame name="tip" attached_to="forearm">'
    return altered(folder, (".sdf", tip, tip.replace("forearm", "vehicle")),
                   (".sdf", 'type="revolute"', 'type="fixed"'))
