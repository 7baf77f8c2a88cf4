"""Many runs, computed by workers and kept in a folder, which a command goes on with.

The folder has a line for every completed run, written whole and to the disk before the next one. A
truncated last line, of a program killed while writing, is dropped, and its run is repeated.
"""

import contextlib
import fcntl
import json
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from uvms_drake.campaign.pool import Pool, run_all
from uvms_drake.common.errors import InvalidParameter
from uvms_drake.common.progress import Progress, silent

RUNS_FILE = "runs.jsonl"

Cell = TypeVar("Cell", bound=int | tuple[str | int, ...])
"""Number or tuple by which a run differs from the others in its folder."""
Result = dict[str, Any]


def runs(cells: Sequence[Cell], run: Callable[[Cell], Result], folder: Path, pool: Pool, *,
         progress: Progress = silent, again: Callable[[Result], bool] = lambda result: False
         ) -> list[Result]:
    """Returns the result of each cell; those that a folder lacks are computed, and kept in it.

    Args:
        cells: The cells.
        run: Function of a cell, which a worker calls; its result is JSON data.
        folder: The folder.
        pool: The workers.
        progress: Progress callback.
        again: Whether the run of a result that is there is to be repeated.

    Raises:
        InvalidParameter: The folder cannot be written to, or is in use.
        RunFailed: The workers die again and again.
    """
    with _opened(folder) as file:
        content = file.read()
        whole = content.rfind(b"\n") + 1
        file.truncate(whole)
        found = _results(content[:whole])
        missing = [cell for cell in cells if cell not in found or again(found[cell])]
        if len(missing) < len(cells):
            progress(f"{len(cells) - len(missing)} of {len(cells)} runs are there already", 0.0)
        try:
            for done, (cell, result) in enumerate(run_all(run, missing, pool), 1):
                line = json.dumps({"cell": cell, "result": result}, ensure_ascii=False,
                                  allow_nan=False)
                file.write(line.encode() + b"\n")
                file.flush()
                os.fsync(file.fileno())
                found[cell] = result
                progress(f"{done} of {len(missing)} runs", done / len(missing))
        except KeyboardInterrupt as error:
            error.add_note(f"{len(found)} runs are in {folder}; the same command goes on with the "
                           "others")
            raise
    return [found[cell] for cell in cells]


def stored(folder: Path) -> dict[Any, Result]:
    """Returns the results that are in a folder, by their cells."""
    try:
        return _results((folder / RUNS_FILE).read_bytes())
    except OSError:
        return {}


def _results(content: bytes) -> dict[Any, Result]:
    """Returns the results of lines by their cells, without damaged lines; the last one counts."""
    out: dict[Any, Result] = {}
    for line in content.splitlines():
        with contextlib.suppress(ValueError, KeyError, TypeError):
            entry = json.loads(line)
            cell = entry["cell"]
            out[tuple(cell) if isinstance(cell, list) else cell] = dict(entry["result"])
    return out


@contextlib.contextmanager
def _opened(folder: Path) -> Iterator[BinaryIO]:
    """Opens the file of the runs, at its beginning, for this process alone."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / RUNS_FILE).open("a+b")
    except OSError as error:
        raise InvalidParameter("--output", str(folder),
                               f"a folder that can be written to ({error.strerror})") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InvalidParameter("--output", str(folder),
                                   "a folder that no other process is working in") from None
        file.seek(0)
        yield file
