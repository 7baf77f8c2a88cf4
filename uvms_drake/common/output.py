"""Output folder of a command: its files appear together, and replace only the program's own.

A folder has a manifest of the files that this program has written into it, with their SHA-256. A
file that is not in it, or has changed since, is foreign and is never replaced or deleted.
"""

import contextlib
import fcntl
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from uvms_drake.common.errors import InvalidParameter, RunFailed, require, shortened

MANIFEST_FILE = ".uvms-drake.json"
STAGING = ".run-"
"""Prefix of the hidden folder in which files wait until all are there."""


class Output:
    """Output of a command, staged until it is complete.

    Args:
        path: Final folder of the files.
        names: Names of all files that the command may write.
        staging: A folder inside of it, on the same disk.

    Attributes:
        folder: Folder to write to: `staging`.
        kept: Names of the files already moved to `path`.
    """

    def __init__(self, path: Path, names: Sequence[str], staging: Path):
        self._path, self._names = path, names
        self.folder = staging
        self.kept: list[str] = []

    def keep(self, *, replaces: bool = False) -> None:
        """Moves the files written so far to their final place.

        Args:
            replaces: Whether to delete files of these names that a former command has left and
                this one has not written, so that no two runs are mixed.
        """
        with _locked(self._path):  # Files of two commands at once would be mixed.
            written = sorted(item.name for item in self.folder.iterdir())
            require_own(self._path, written)
            manifest = read_manifest(self._path)
            stale = set(self._names) & set(manifest) - {*written, *self.kept} if replaces else set()
            manifest |= {name: _digest(self.folder / name) for name in written}
            # The manifest goes first: a file that it names too early is identified by its digest.
            (self.folder / MANIFEST_FILE).write_text(json.dumps(manifest, indent=1), "utf-8")
            for name in (MANIFEST_FILE, *written):
                os.replace(self.folder / name, self._path / name)
            for name in stale:
                (self._path / name).unlink(missing_ok=True)
        self.kept += written


@contextlib.contextmanager
def output_folder(path: Path, names: Sequence[str], *, replaces: bool = False) -> Iterator[Output]:
    """Context manager of files that appear in `path` at the end, or when they are kept.

    If the block raises, `path` stays unchanged, apart from kept files.

    Args:
        path: The folder; it is created if missing.
        names: Names of all files that the block may write.
        replaces: As in `Output.keep`.

    Raises:
        InvalidParameter: The folder cannot be written to, or has a foreign file of one of these
            names; before the block is entered.
        RunFailed: The files could not be written. A note of every error names the saved ones.
    """
    made: list[Path] = []
    try:
        made = [folder for folder in (path, *path.parents) if not folder.exists()]
        path.mkdir(parents=True, exist_ok=True)
        staging, lock = _staging_folder(path)
    except (OSError, ValueError) as error:
        _remove_empty(made)
        reason = getattr(error, "strerror", None) or str(error)
        raise InvalidParameter("--output", shortened(str(path), 100),
                               f"a folder that can be written to ({reason})") from None
    output = Output(path, names, staging)
    try:
        require_own(path, names)
        yield output
        output.keep(replaces=replaces)
    except BaseException as error:
        saved = f"saved in {path}: {', '.join(output.kept)}" if output.kept else "nothing written"
        if isinstance(error, OSError) and not isinstance(error, BrokenPipeError):
            error = RunFailed(f"the files cannot be written: {error.strerror or error}; {saved}")
        elif output.kept:
            error.add_note(saved)
        raise error from error.__cause__
    finally:
        shutil.rmtree(staging, ignore_errors=True)
        os.close(lock)
        _remove_empty(made)


def require_own(path: Path, names: Sequence[str]) -> None:
    """Raises `InvalidParameter` if `path` has a foreign file of one of these names."""
    manifest = read_manifest(path)
    foreign = [name for name in names if os.path.lexists(path / name)
               and manifest.get(name) != _digest(path / name)]
    require(not foreign, "--output", shortened(str(path), 100),
            f"a folder without files of others: {', '.join(foreign)} in it would be replaced, and "
            f"{'is' if len(foreign) == 1 else 'are'} not as this program has written there")


def read_manifest(path: Path) -> dict[str, str]:
    """Returns the SHA-256, by name, of the files that this program has written into a folder."""
    try:
        manifest = json.loads((path / MANIFEST_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return manifest if isinstance(manifest, dict) else {}


def _digest(path: Path) -> str:
    """Returns the SHA-256 of a file, or "" if there is no file."""
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def _staging_folder(path: Path) -> tuple[Path, int]:
    """Returns a new folder in `path` and the handle of its lock; removes those not locked."""
    with _locked(path):
        for old in path.glob(f"{STAGING}*"):
            with contextlib.suppress(OSError), _locked(old, wait=False):
                shutil.rmtree(old, ignore_errors=True)
        staging = Path(tempfile.mkdtemp(prefix=STAGING, dir=path))
        lock = os.open(staging, os.O_RDONLY)
        fcntl.flock(lock, fcntl.LOCK_EX)
    return staging, lock


@contextlib.contextmanager
def _locked(folder: Path, *, wait: bool = True) -> Iterator[None]:
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        yield
    finally:
        os.close(handle)


def _remove_empty(folders: Sequence[Path]) -> None:
    """Removes folders that are empty, the innermost first."""
    for folder in folders:
        try:
            folder.rmdir()
        except (OSError, ValueError):
            return
