"""Python modules that a scenario names: they register kinds of their own when they are imported."""

import ast
import importlib
import importlib.util
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType

from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.common.program import FOLDER


def import_modules(names: Sequence[str]) -> list[str]:
    """Imports modules, each once, and returns their names, those of files as absolute paths.

    Args:
        names: Paths of Python files, or dotted names of modules that Python finds.

    Raises:
        InvalidParameter: One of them is not there, or its own import fails; says how.
    """
    return [_imported(f"modules[{i}]", name) for i, name in enumerate(names)]


def module_file(name: str) -> Path:
    """Returns the source file of an imported module of `import_modules`."""
    return Path(name) if _is_file(name) else Path(str(sys.modules[name].__file__))


def module_files(name: str) -> dict[str, Path]:
    """Returns the source files of an imported module by their paths from its folder.

    Those of its package, or its own and all of its folder that it imports; none of this package.
    """
    top = name if _is_file(name) else name.partition(".")[0]
    file = module_file(top if _is_file(top) or sys.modules[top].__file__ else name)
    if FOLDER in file.parents:
        return {}
    if file.name == "__init__.py":
        return {str(path.relative_to(file.parent)): path
                for path in sorted(file.parent.rglob("*.py"))}
    found, left = {file.name: file}, [file]
    while left:
        for each in _imports(left.pop()):
            path = Path(str(getattr(sys.modules.get(each), "__file__", None)))
            if file.parent in path.parents and FOLDER not in path.parents:
                key = path.relative_to(file.parent)
                if key.parts[0].removesuffix(".py") == each.partition(".")[0] and (
                        str(key) not in found):
                    found[str(key)] = path
                    left.append(path)
    return dict(sorted(found.items()))


def _imports(file: Path) -> Iterator[str]:
    """Yields the names of imported modules, and names from them, which may be modules, too."""
    for node in ast.walk(ast.parse(file.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{each.name}" for each in node.names)


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
