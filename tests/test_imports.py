"""Who may know whom: the order of the rooms, from what knows nothing to what knows all."""

import ast
import functools
import graphlib
import tomllib
from pathlib import Path

import pytest
from conftest import SMOKE
from support.pages import PACKAGE

import uvms_drake

FILES = sorted(PACKAGE.rglob("*.py"))

ROOMS = (
    ("common",),
    ("model",),
    ("plant", "control", "sensing", "actuation", "mission", "baselines"),
    ("tube",),
    ("visual",),
    ("station",),
    ("certificate",),
    ("report", "loop"),
    ("campaign", "identification"),
    ("setup", "benchmark"),
    ("papers",),
    ("command",),
)
"""A room imports what is in rooms to the left of it. Those side by side do not know each other: the
controller must not see the true plant, nor the plant its controller."""
FLOOR = {room: floor for floor, rooms in enumerate(ROOMS) for room in rooms}


@functools.cache
def imported(path: Path, typing: bool = True) -> set[str]:
    """Returns every module that a file imports, wherever it does so.

    Args:
        path: The file.
        typing: Whether imports under `if TYPE_CHECKING:` count.
    """
    names = set()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    skipped = set() if typing else {
        id(inner) for node in ast.walk(tree) if isinstance(node, ast.If)
        and getattr(node.test, "id", None) == "TYPE_CHECKING" for inner in ast.walk(node)}
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative imports hide where a name comes from"
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def rooms_that(path: Path) -> set[str]:
    """Returns the rooms of the package that a file imports from."""
    found = {name.split(".")[1] for name in imported(path) if name.startswith("uvms_drake.")}
    return found & set(FLOOR)


def room_of(path: Path) -> str:
    """Returns the room that a file stands in; empty for the two at the top."""
    parts = path.relative_to(PACKAGE).parts
    return parts[0] if len(parts) > 1 else ""


def test_every_folder_is_a_room_of_the_order_and_the_smoke_subset_has_files_of_the_tests():
    folders = {room_of(path) for path in FILES} - {"", "scenarios", "models"}
    assert folders == set(FLOOR)
    assert [name for name in SMOKE if not (Path(__file__).parent / name).is_file()] == []


@pytest.mark.parametrize("room", FLOOR)
def test_a_room_knows_only_what_stands_below_it(room):
    files = [path for path in FILES if room_of(path) == room]
    assert len(files) > 1
    for path in files:
        for other in rooms_that(path) - {room}:
            assert FLOOR[other] < FLOOR[room], f"{path.relative_to(PACKAGE)} imports {other}"


def entry_of(module: str, room: str) -> str | None:
    """Returns the file or sub-room of a room that a module is in, if it is in that room."""
    return module.removeprefix(f"{room}.").split(".")[0] if module.startswith(f"{room}.") else None


def arrows_in(folder: Path) -> dict[str, set[str]]:
    """Returns, for each file and sub-room of a room, the others in that room that it imports.

    Imports for the type checker alone do not count.
    """
    room = ".".join(("uvms_drake", *folder.relative_to(PACKAGE).parts))
    arrows: dict[str, set[str]] = {}
    for path in sorted(folder.rglob("*.py")):
        own = path.relative_to(folder).parts[0].removesuffix(".py")
        if own != "__init__":
            entries = {entry_of(name, room) for name in imported(path, typing=False)}
            arrows.setdefault(own, set()).update(entries - {own, None})
    return {own: others & arrows.keys() for own, others in arrows.items()}


@pytest.mark.parametrize("folder", sorted({path.parent for path in FILES} - {PACKAGE}),
                         ids=lambda folder: str(folder.relative_to(PACKAGE)))
def test_no_arrow_runs_back_up_between_the_files_and_sub_rooms_of_a_room(folder):
    graphlib.TopologicalSorter(arrows_in(folder)).prepare()  # Raises on a circle, and names it.


def file_of(module: str) -> Path | None:
    """Returns the file of a module of the package; None for a folder's `__init__` or a name."""
    path = PACKAGE.parent.joinpath(*module.split(".")).with_suffix(".py")
    return path if path in FILES else None


def files_imported(path: Path) -> set[Path]:
    """Returns the files of the package that a file imports, for the type checker alone, too."""
    return {found for name in imported(path) if (found := file_of(name)) is not None} - {path}


def test_no_file_imports_its_caller():
    graphlib.TopologicalSorter({path: files_imported(path) for path in FILES}).prepare()


def test_one_file_alone_knows_of_a_paper():
    """A scenario imports one by its key `modules`; else only the command line names it."""
    outside = [path for path in FILES if room_of(path) != "papers"]
    assert [str(path.relative_to(PACKAGE)) for path in outside if "papers" in rooms_that(path)] == [
        "command/paper.py"]


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_drake_is_imported_from_the_modules_that_own_the_names(path):
    """`pydrake.all` takes twice as long to import as the modules that are needed."""
    assert not any(name == "pydrake.all" or name.startswith("pydrake.all.")
                   for name in imported(path))
    assert "*" not in {name.rsplit(".", 1)[-1] for name in imported(path)}


def test_what_the_package_offers_is_there():
    """Names by `import uvms_drake as uv`: sorted, each of them there, loaded when it is used."""
    assert list(uvms_drake.__all__) == sorted(uvms_drake.__all__, key=str.lower)
    for name in uvms_drake.__all__:
        assert getattr(uvms_drake, name) is not None
    assert {name for name in dir(uvms_drake) if not name.startswith("__")} == {*uvms_drake.__all__}
    with pytest.raises(AttributeError, match="has no attribute 'make_otter'"):
        uvms_drake.make_otter  # noqa: B018


def test_the_wheel_has_every_package():
    root = Path(__file__).parents[1]
    listed = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]
    folders = {".".join(path.parent.relative_to(root).parts)
               for path in (root / "uvms_drake").rglob("__init__.py")}
    assert set(listed["packages"]) == folders | {"uvms_drake.models"}


def test_the_examples_import_little_from_inside_the_package():
    """A script's names are by `uv` and by a paper; parts of the plant and of the replay are not.

    The scripts that tune the gains of the baselines and draw the animation are tools.
    """
    deep = [f"{path.name}: {line}" for path in sorted((PACKAGE.parent / "examples").glob("*.py"))
            if path.name not in ("tune_baselines.py", "animation.py")
            for line in path.read_text("utf-8").splitlines() if line.startswith("from uvms_drake.")
            and not line.startswith("from uvms_drake.papers import")]
    assert len(deep) <= 5, "\n".join(deep)
