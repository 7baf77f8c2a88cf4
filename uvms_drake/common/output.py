"""The folder of a run: all of its files appear together, or none does."""

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from uvms_drake.common.errors import InvalidParameter


@contextmanager
def output_folder(path: Path, owned: Sequence[str]) -> Iterator[Path]:
    """Gives a hidden folder inside `path` to write to, and moves its files to `path` at the end.

    If the block raises, `path` stays as it was. If it does not, those of the `owned` files that a
    former run left and this one did not write are deleted, so that no two runs are mixed; whatever
    else is in the folder is left alone.

    Args:
        path: The folder; it is made if it does not exist.
        owned: Names of all the files that a run may write.

    Raises:
        InvalidParameter: The folder cannot be written to; before the block is entered.
    """
    made = [folder for folder in (path, *path.parents) if not folder.exists()]
    try:
        path.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=".run-", dir=path))
    except OSError as error:
        _remove_empty(made)
        raise InvalidParameter(
            "--output", str(path), f"a folder that can be written to ({error.strerror})") from None
    try:
        yield staging
        written = sorted(item.name for item in staging.iterdir())
        for name in written:
            os.replace(staging / name, path / name)
        for name in set(owned) - set(written):
            (path / name).unlink(missing_ok=True)
    finally:
        shutil.rmtree(staging, ignore_errors=True)
        _remove_empty(made)


def _remove_empty(folders: Sequence[Path]) -> None:
    """Removes folders that are empty, the innermost first."""
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return
