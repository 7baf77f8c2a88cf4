"""The folders of robots, and the files in them that describe the robot."""

from collections.abc import Iterable
from pathlib import Path

from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.common.program import FOLDER
from uvms_drake.model.description import thruster_file

KINDS = ("sdf", "urdf")


def models_dir() -> Path:
    """Returns the folder of the robots: inside an installed package, or beside it in a checkout."""
    package = FOLDER
    installed = package / "models"
    return installed if installed.is_dir() else package.parent / "models"


def shipped_robots() -> list[str]:
    """Returns the names of the robots that come with the package."""
    return sorted(path.parent.name for path in models_dir().glob("*/package.xml"))


def model_dir(model: str) -> Path:
    """Returns the folder of a robot, given the name of a shipped one or a path.

    The robot's name is that of the folder: of `.` and of a path ending in `..` the real one, and of
    a link the name of its target, if no file has the link's.
    """
    shipped = shipped_robots()
    if model in shipped:
        return models_dir() / model
    folder = Path(model)
    known = f"one of {', '.join(shipped)}, or a folder with <name>.sdf or <name>.urdf, " \
            "hydrodynamics.yaml and package.xml"
    require(bool(model) and folder.is_dir(), "model", model, known)
    if folder.name in ("", ".."):
        folder = folder.resolve()
    if not _robot_files(folder) and _robot_files(folder.resolve()):
        folder = folder.resolve()
    found = _robot_files(folder)
    if len(found) > 1:
        raise InvalidParameter("model", model, f"a folder with one robot's file: "
                               f"{' and '.join(path.name for path in found)} are both there")
    missing = [] if found else [f"{folder.name}.sdf or {folder.name}.urdf"]
    missing += [name for name in ("hydrodynamics.yaml", "package.xml")
                if not (folder / name).is_file()]
    if missing:
        others = ", ".join(path.name for path in unread_files(folder, found))
        raise InvalidParameter(
            "model", model, f"{known}: {' and '.join(missing)} "
            f"{'is' if len(missing) == 1 else 'are'} not there" + (
                f", but {others}" if others else ""))
    return folder


def robot_file(folder: Path) -> Path:
    """Returns the file of the dry robot in its folder, SDFormat or URDF."""
    return [*_robot_files(folder), folder / f"{folder.name}.sdf"][0]


def _robot_files(folder: Path) -> list[Path]:
    paths = [folder / f"{folder.name}.{kind}" for kind in KINDS]
    return [path for path in paths if path.is_file()]


def unread_files(folder: Path, read: Iterable[Path]) -> list[Path]:
    """Returns the files of a robot's folder that look like a robot's, but are not read."""
    known = {*(path.resolve() for path in read), *((folder / name).resolve() for name in (
        "hydrodynamics.yaml", thruster_file.FILE))}
    return [path for path in sorted(folder.iterdir())
            if path.suffix.lower() in (".sdf", ".urdf", ".xacro", ".yaml", ".yml")
            and path.resolve() not in known]
