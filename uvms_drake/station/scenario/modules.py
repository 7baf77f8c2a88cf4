"""Python modules that a scenario names: they register kinds of their own when they are imported."""

import ast
import importlib
import importlib.util
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType

from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.common.program import FOLDER

INSTALLED = {"site-packages", "dist-packages"}
"""Folders of installed packages."""


def import_modules(names: Sequence[str]) -> list[str]:
    """Imports modules, each once, and returns their names, those of files as absolute paths.

    Args:
        names: Paths of Python files, or dotted names of modules that Python finds.

    Raises:
        InvalidParameter: One of them is not there, or its own import fails; says how.
    """
    return [_imported(f"modules[{i}]", name) for i, name in enumerate(names)]


def module_files(name: str) -> dict[str, Path]:
    """Returns the source files of an imported module by their paths from its folder.

    All of its package, or its own and those of its folder that it imports; none of this package.
    """
    if _is_file(name):
        file, root, init = Path(name), Path(name).parent, None
    else:
        file, init = (Path(str(getattr(sys.modules[each], "__file__", None))).resolve()
                      for each in (name, name.partition(".")[0]))
        root = file.parents[name.count(".")]
    found, left = {file}, [file]
    if init is not None and init.name == "__init__.py":
        root = init.parent
        found |= set(root.rglob("*.py"))
    else:
        while left:
            new = set(_imported_files(left.pop(), root)) - found
            found, left = found | new, [*left, *new]
    if FOLDER in (root, *root.parents):
        return {}
    return {os.path.relpath(path, root): path for path in sorted(found) if path.is_file()}


def _imported_files(file: Path, root: Path) -> Iterator[Path]:
    """Yields the files below a folder that a file of Python imports by their names.

    None of a folder of installed packages, and none of this one: their versions count.
    """
    if file.suffix != ".py" or not file.is_file() or INSTALLED & set(root.parts):
        return
    for node in ast.walk(ast.parse(file.read_bytes())):
        folder, names = root, list[str]()
        if isinstance(node, ast.Import):
            names = [each.name for each in node.names]
        elif isinstance(node, ast.ImportFrom):
            folder = file.parents[node.level - 1] if node.level else root
            names = [".".join(filter(None, (node.module, each.name))) for each in node.names]
            names += [node.module] if node.module else []
        for path in (folder.joinpath(*each.split(".")) for each in names):
            yield from (found for found in (path.with_name(f"{path.name}.py"), path / "__init__.py")
                        if found.is_file() and FOLDER not in found.parents)


def from_folder(name: str, folder: Path) -> str:
    """Returns a module's name, a path of a file as from the folder of a scenario's file."""
    return str(folder / name) if _is_file(name) else name


def _is_file(name: str) -> bool:
    return name.endswith(".py")


def _imported(key: str, name: str) -> str:
    """Imports a module by its file or name; returns the absolute path, or the name."""
    path = Path(name).resolve()
    require(not _is_file(name) or path.is_file(), key, name, "a Python file that exists")
    try:
        if _is_file(name):
            import_file(path)
        else:
            importlib.import_module(name)
    except Exception as error:  # Whatever a user's module raises.
        raise InvalidParameter(key, name, "a module that can be imported, which ends with "
                               f"{type(error).__name__}: {error}") from error
    return str(path) if _is_file(name) else name


def import_file(path: Path) -> ModuleType:
    """Imports a file, unless a module of the process, such as the running script, is this file.

    Args:
        path: Path of the file, resolved.
    """
    for module in list(sys.modules.values()):
        file = getattr(module, "__file__", None)
        if file is not None and Path(file).resolve() == path:
            return module
    name = path.stem if path.stem not in sys.modules else str(path)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # Dataclasses look up their module there.
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
