"""Who may know whom: the controller must not see the true plant, nor the plant its controller."""

import ast
from pathlib import Path

import pytest

import uvms_drake

PACKAGE = Path(uvms_drake.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))
FLOORS = {room: floor for floor, rooms in enumerate((
    ("common",), ("model",), ("plant", "control", "sensing", "actuation"), ("tube",), ("visual",),
    ("station", "scenarios"), ("certificate",), ("report",), ("campaign",), ("studies",),
    ("errata",), ("command",))) for room in rooms}
"""What stands on what: a room imports from lower floors only, not from its own."""


def imported(path: Path) -> set[str]:
    """Returns every module that a file imports, wherever it does so."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative imports hide where a name comes from"
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def reaches(path: Path, package: str) -> bool:
    return any(name == package or name.startswith(f"{package}.") for name in imported(path))


def room_of(module: str) -> str | None:
    """Returns the room of a module of the package, or None of any other."""
    names = module.split(".")
    return names[1] if names[0] == "uvms_drake" and len(names) > 1 else None


@pytest.mark.parametrize("path", [path for path in FILES if path.parent != PACKAGE],
                         ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_room_knows_only_the_floors_below_it(path):
    own = path.relative_to(PACKAGE).parts[0]
    floor = FLOORS[own]
    for module in imported(path):
        room = room_of(module)
        if room in FLOORS and room != own:
            assert FLOORS[room] < floor, f"{path.relative_to(PACKAGE)} imports {module}"


def test_every_room_has_its_floor():
    rooms = {path.relative_to(PACKAGE).parts[0] for path in FILES if path.parent != PACKAGE}
    assert rooms == set(FLOORS)


def test_the_check_sees_an_import():
    """The station, which puts plant and controller together, is allowed to know both."""
    assert reaches(PACKAGE / "station" / "diagram.py", "uvms_drake.plant")
    assert reaches(PACKAGE / "station" / "diagram.py", "uvms_drake.control")


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_drake_is_imported_from_the_modules_that_own_the_names(path):
    """`pydrake.all` takes twice as long to import as the modules that are needed."""
    assert not reaches(path, "pydrake.all")
    assert "*" not in {name.rsplit(".", 1)[-1] for name in imported(path)}
