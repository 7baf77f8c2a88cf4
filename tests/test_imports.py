"""Who may know whom: the controller must not see the true plant, nor the plant its controller."""

import ast
from pathlib import Path

import pytest

import uvms_drake

PACKAGE = Path(uvms_drake.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))


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


@pytest.mark.parametrize(("part", "forbidden"), [
    ("plant", ("control", "station", "problem", "scenario", "simulation", "summary", "record")),
    ("control", ("plant", "station", "problem", "scenario", "simulation", "summary", "record")),
    ("model", ("plant", "control", "station", "scenario", "simulation", "summary", "record")),
])
def test_a_part_knows_only_what_stands_below_it(part, forbidden):
    files = sorted((PACKAGE / part).glob("*.py"))
    assert len(files) > 3
    for path in files:
        for other in forbidden:
            assert not reaches(path, f"uvms_drake.{other}"), f"{path.name} imports {other}"


def test_the_check_sees_an_import():
    """The station, which puts plant and controller together, is allowed to know both."""
    assert reaches(PACKAGE / "station" / "diagram.py", "uvms_drake.plant")
    assert reaches(PACKAGE / "station" / "diagram.py", "uvms_drake.control")


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_drake_is_imported_from_the_modules_that_own_the_names(path):
    """`pydrake.all` takes twice as long to import as the modules that are needed."""
    assert not reaches(path, "pydrake.all")
    assert "*" not in {name.rsplit(".", 1)[-1] for name in imported(path)}
