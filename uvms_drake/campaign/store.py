"""The folder of a campaign: its setup, and a line for every completed run.

A line is written whole and to the disk before the next one. A truncated last line, of a program
killed while writing, is dropped, and its run is repeated.
"""

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, BinaryIO

from uvms_drake.campaign.campaign import Campaign
from uvms_drake.common.errors import InvalidParameter
from uvms_drake.station.scenario.scenario import dump_scenario

SETUP_FILE = "setup.json"
RUNS_FILE = "runs.jsonl"

NO_OTHER = "a folder without another campaign in it (of another scenario, seed, option or program)"


class RunLog:
    """Completed runs, on disk and in memory.

    Attributes:
        runs: Results of `run_one`, by index.
    """

    def __init__(self, file: BinaryIO):
        self._file = file
        content = file.read()
        whole = content.rfind(b"\n") + 1
        self.runs = _runs(content[:whole])
        file.truncate(whole)
        file.seek(whole)

    def append(self, run: dict[str, Any]) -> None:
        """Adds a run; when this returns it is on the disk."""
        text = json.dumps(run, ensure_ascii=False, allow_nan=False)
        self._file.write(text.encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())
        self.runs[run["result"]["index"]] = run


def _runs(content: bytes) -> dict[int, dict[str, Any]]:
    """Returns the runs of whole lines by index; of a repeated run, the first."""
    out: dict[int, dict[str, Any]] = {}
    for run in map(_parsed, content.splitlines()):
        if run is not None:
            out.setdefault(run["result"]["index"], run)
    return out


def _parsed(line: bytes) -> dict[str, Any] | None:
    """Returns the run of a line, or None if it is damaged."""
    try:
        run = json.loads(line)
        return run if isinstance(run["result"]["index"], int) and "wall" in run else None
    except (ValueError, KeyError, TypeError):
        return None


@contextmanager
def run_log(folder: Path, campaign: Campaign) -> Iterator[RunLog]:
    """Context manager of the log of a campaign in a folder, new or to be continued.

    Raises:
        InvalidParameter: The folder cannot be written to, is another campaign's, or is in use.
    """
    path = folder / SETUP_FILE
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _require(path.exists() or not (folder / RUNS_FILE).exists() or _is_empty(folder), folder,
                 f"a folder without a {RUNS_FILE} of unknown origin")
        (folder / RUNS_FILE).touch()
        file = (folder / RUNS_FILE).open("r+b")
    except OSError as error:
        raise InvalidParameter("--output", str(folder),
                               f"a folder that can be written to ({error.strerror})") from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            _require(False, folder, "a folder that no other process is working in")
        if path.exists():
            _require(read_setup(folder).identity == campaign.identity, folder, NO_OTHER)
        else:
            text = json.dumps(asdict(campaign), indent=1, ensure_ascii=False)
            draft = path.with_suffix(".part")
            draft.write_text(text + "\n", encoding="utf-8")
            os.replace(draft, path)
        yield RunLog(file)


def require_same(folder: Path, drafted: Campaign, *, certified: bool) -> None:
    """Raises `InvalidParameter` if another campaign is in a folder, before anything is certified.

    Args:
        folder: Folder, possibly empty or missing.
        drafted: The campaign without its certificate.
        certified: Whether it will have one.
    """
    if not (folder / SETUP_FILE).exists():
        return
    found, base = read_setup(folder), drafted.base
    mpc = replace(found.base.mpc, terminal_radius=base.mpc.terminal_radius)
    scenario = dump_scenario(replace(found.base, tube=base.tube, mpc=mpc))
    found_drafted = replace(found, scenario=scenario, certified=drafted.certified)
    same = found_drafted.identity == drafted.identity
    _require(same and found.certified == certified, folder, NO_OTHER)


def _is_empty(folder: Path) -> bool:
    """Returns whether a folder has no runs, its command having ended before the setup."""
    return (folder / RUNS_FILE).stat().st_size == 0


def read_setup(folder: Path) -> Campaign:
    """Returns the campaign of a folder.

    Raises:
        InvalidParameter: There is none.
    """
    try:
        return Campaign.from_data(json.loads((folder / SETUP_FILE).read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise InvalidParameter(
            "--output", str(folder), f"a campaign's folder, with its {SETUP_FILE}") from None


def read_indices(folder: Path) -> set[int]:
    """Returns the indices of the completed runs in a folder."""
    try:
        return set(_runs((folder / RUNS_FILE).read_bytes()))
    except OSError:
        return set()


def _require(condition: bool, folder: Path, allowed: str) -> None:
    if not condition:
        raise InvalidParameter("--output", str(folder), allowed)
