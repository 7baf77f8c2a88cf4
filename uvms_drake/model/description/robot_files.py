"""The folders of robots and the files in them, read and checked: the source of a plant."""

import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from pydrake.multibody.parsing import PackageMap, Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex

from uvms_drake.common.errors import InvalidFile, InvalidParameter, ScenarioError, require
from uvms_drake.common.program import FOLDER
from uvms_drake.common.schema import load_file, read_text
from uvms_drake.model.description import thruster_file
from uvms_drake.model.description.hydrodynamics_file import HydrodynamicParameters, unequal_entries
from uvms_drake.model.description.plausibility import Findings, check_description, unread_notes
from uvms_drake.model.description.thruster_file import ThrusterParameters
from uvms_drake.model.description.visuals import Locate, settle_visuals
from uvms_drake.model.description.xml_tree import Node, read_xml, write_xml

KINDS = ("sdf", "urdf")
INCLUDED = "uvms_drake_included"
"""Package that has the files which a robot's file includes, while it is parsed."""


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


@dataclass
class RobotFiles:
    """Content of the files of a robot, before it is in a plant."""

    folder: Path
    file: Path
    """The SDFormat or URDF file."""
    hydrodynamics: HydrodynamicParameters
    thrusters: ThrusterParameters | None
    """None if they are not known."""
    text: str = ""
    """The file as Drake reads it: without collision shapes and elements that it would ignore."""
    included: dict[str, str] = field(default_factory=dict)
    """Files that it includes, likewise, by a name in the package `INCLUDED`."""
    notes: list[str] = field(default_factory=list)
    """Notes: no mistakes, but worth knowing."""
    read: list[Path] = field(default_factory=list)
    """The file and those that it includes."""


def read_robot_files(folder: Path) -> RobotFiles:
    """Returns the files of a robot's folder, which is as `model_dir` returns it.

    Raises:
        InvalidFile: The files cannot be used; has all that is wrong with them.
    """
    # All files are read, whatever is wrong with one of them.
    file, complaints = robot_file(folder), []
    try:
        reader = _Reader(folder)
        main = reader.read(file)
        complaints += reader.complaints
    except InvalidFile as error:
        complaints += error.complaints
    hydrodynamics, thrusters = HydrodynamicParameters(), None
    try:
        hydrodynamics = load_file(folder / "hydrodynamics.yaml", HydrodynamicParameters)
    except InvalidFile as error:
        complaints += error.complaints
    try:
        if (path := folder / thruster_file.FILE).is_file():
            thrusters = load_file(path, ThrusterParameters)
    except InvalidFile as error:
        complaints += error.complaints
    if complaints:
        raise InvalidFile(complaints)
    # Notes: no mistakes, but worth knowing.
    notes = [*reader.notes,
             *(f"hydrodynamics.yaml: {each}" for each in unequal_entries(hydrodynamics)),
             *(f"{path.name} is not read: the robot's file is {file.name}" for path in unread_files(
                 folder, reader.read_files))]
    return RobotFiles(folder, file, hydrodynamics, thrusters, main, reader.included, notes,
                      reader.read_files)


class _Reader:
    """Reads a robot's file and those that it includes."""

    def __init__(self, folder: Path):
        self.complaints: list[str] = []
        self.notes: list[str] = []
        self.included: dict[str, str] = {}
        self.read_files: list[Path] = []
        self._packages = PackageMap.MakeEmpty()
        try:
            self._packages.AddPackageXml(str(folder / "package.xml"))
        except Exception as error:  # Of several types.
            raise InvalidFile([f"{folder / 'package.xml'}: must have the name of the package: "
                               f"{_one_line(error)}"]) from None

    def read(self, file: Path) -> str:
        """Returns the text of a file as Drake reads it."""
        if file in self.read_files:
            raise InvalidFile([f"{file}: must not include itself"])
        self.read_files.append(file)
        try:
            root = read_xml(read_text(file), file)
        except ScenarioError as error:
            raise InvalidFile([f"{file}: {error}"]) from None
        kind = file.suffix[1:].lower()
        found = check_description(root, kind)
        if not found.complaints:
            def locate(uri: str) -> Path:
                return self._locate(uri, file.parent)

            settle_visuals(root, kind, locate, found)
            for include in [node for node in root.walk() if node.tag == "include"]:
                self._include(include, locate, found)
        self.complaints += [f"{file}: {each}" for each in found.complaints]
        self.notes += [f"{file.name}: {each}" for each in [*unread_notes(found), *found.notes]]
        return write_xml(root)

    def _include(self, node: Node, locate: Locate, found: Findings) -> None:
        """Reads an included file, and has Drake find it as it was read."""
        (uri,) = node.all("uri")
        if node.attributes.get("merge") not in ("true", "1"):
            found.refuse(node, "", "include", uri.text, "merged: nested models are refused: "
                         "<include merge=\"true\">")
            return
        try:
            path = locate(uri.text.strip())
        except LookupError as error:
            found.refuse(node, "", "include", uri.text, f"a file: {error.args[0]}")
            return
        if path.suffix.lower() not in (".sdf", ".urdf") or not path.is_file():
            found.refuse(node, "", "include", uri.text, "an SDFormat or URDF file that is there")
            return
        name = f"{len(self.included)}_{path.stem}{path.suffix.lower()}"
        self.included[name] = ""  # Its place, before those that it includes.
        self.included[name] = self.read(path)
        uri.text = f"package://{INCLUDED}/{name}"

    def _locate(self, uri: str, folder: Path) -> Path:
        """Returns the file of a URI; raises `LookupError` with the reason if it names none."""
        scheme, _, rest = uri.partition("://")
        if not rest:
            return (folder / uri).resolve()
        if scheme == "file":
            return Path(rest)
        package, _, path = rest.partition("/")
        if scheme not in ("package", "model") or not self._packages.Contains(package):
            known = ", ".join(self._packages.GetPackageNames())
            raise LookupError(f"{scheme} {package} is unknown: package.xml is that of {known}")
        return Path(self._packages.GetPath(package)) / path


def parse_robot(plant: MultibodyPlant, files: RobotFiles) -> tuple[ModelInstanceIndex, list[str]]:
    """Adds a robot to a plant, and returns its instance and the warnings of Drake's parser.

    Raises:
        InvalidFile: Drake cannot read it, or takes another inertia than the file has.
    """
    instances, log = parse(plant, files.file, files.file.suffix[1:], files.text,
                           files.included)
    if len(instances) != 1:
        raise InvalidFile([f"{files.file}: must be one model, and has {len(instances)}"])
    return instances[0], [f"{files.file.name}: {each}" for each in log]


def parse(plant: MultibodyPlant, file: Path, kind: str, text: str, included: dict[str, str]
          ) -> tuple[list[ModelInstanceIndex], list[str]]:
    """Adds the models in a text to a plant, and returns them and the warnings of Drake's parser.

    Args:
        plant: Not finalized.
        file: Of the text, for messages.
        kind: "urdf" or "sdf".
        text: As Drake is to read it, lines as in the file.
        included: Files that it includes, likewise, by a name in the package `INCLUDED`.

    Raises:
        InvalidFile: Drake cannot read it, or takes another inertia than the text has.
    """
    parser, log = Parser(plant), list[str]()
    with TemporaryDirectory() as folder:
        parser.package_map().Add(INCLUDED, folder)
        for name, each in included.items():
            (Path(folder) / name).write_text(each, encoding="utf-8")

        def message_of(error: object) -> str:
            line = _one_line(error).replace(f"{folder}/", "")
            for text_itself in (f"<literal-string>.{kind}", "<data-string>"):
                line = line.replace(text_itself, file.name)
            return line

        try:
            with _heard(log):
                instances = parser.AddModelsFromString(text, kind)
        except Exception as error:  # RuntimeError, ValueError and others, by the mistake.
            raise InvalidFile([f"{file}: must be a readable robot: {message_of(error)}"]) from None
        log = [message_of(each) for each in log]
    # Warnings that Drake writes to its log only.
    replaced = [each for each in log if "inertia" in each]
    if replaced:
        raise InvalidParameter(
            str(file), "an inertia that Drake replaces", "one that a body can have, its "
            "principal moments about the centre of mass positive and none above the sum of the "
            f"others: {' '.join(replaced)}")
    return instances, log


@contextmanager
def _heard(log: list[str]) -> Iterator[None]:
    """Takes the warnings of Drake's parser, each once, in place of its log."""
    logger = logging.getLogger("drake")
    level = logger.level

    def heard(record: logging.LogRecord) -> bool:
        text = _one_line(record.getMessage())
        if record.levelno >= logging.WARNING and text not in log:
            log.append(text)
        return False

    logger.addFilter(heard)
    logger.setLevel(min(level, logging.WARNING))
    try:
        yield
    finally:
        logger.setLevel(level)
        logger.removeFilter(heard)


def _one_line(error: object) -> str:
    return " ".join(str(error).split())
