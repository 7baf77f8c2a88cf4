"""Writes the folder of a robot that is found in a URDF or SDFormat file."""

import os
import shutil
import tempfile
from pathlib import Path

from uvms_drake.command.interrupt import PROGRAM
from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.model.robot_import.importer import import_robot


def write_robot(file: Path, robot: Path) -> int:
    """Writes a robot's folder, which must not be there yet, and prints the notes of the import.

    Args:
        file: URDF or SDFormat, as it was found.
        robot: The folder.

    Returns:
        Exit status.

    Raises:
        InvalidParameter: The file is no robot, or the folder cannot be written; nothing is left.
    """
    name = robot.name
    require(name.isidentifier() and name.isascii(), "--from", str(robot),
            "a folder by the name of the robot: letters, digits and _")
    require(not os.path.lexists(robot), "--from", str(robot), "a folder that is not there yet")
    imported = import_robot(file, name)
    try:
        write_robot_folder(imported.files, robot)
    except OSError as error:
        raise InvalidParameter("--from", str(robot),
                               f"a path that can be written to ({error.strerror})") from None
    print(imported.notes.format())
    print(f"written to {robot}, with this list in README.md; '{PROGRAM} robot {robot}' shows it")
    return 0


def write_robot_folder(files: dict[str, bytes], robot: Path) -> None:
    """Writes files into a folder that appears when all of them are there."""
    robot.parent.mkdir(parents=True, exist_ok=True)
    staging = Path(tempfile.mkdtemp(prefix=f".{robot.name}-", dir=robot.parent))
    try:
        staging.chmod(0o755)
        for name, content in files.items():
            (staging / name).parent.mkdir(parents=True, exist_ok=True)
            (staging / name).write_bytes(content)
        staging.rename(robot)
    except BaseException:
        shutil.rmtree(staging, ignore_errors=True)
        raise
