"""Runs of the benchmark by workers, kept in a folder, and their record as CSV."""

import csv
import hashlib
import json
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from uvms_drake.baselines.baseline import read_gains, robots_with_gains
from uvms_drake.benchmark.cases import CASES, drawn_case
from uvms_drake.benchmark.controllers import CONTROLLERS, controller_named, file_of
from uvms_drake.benchmark.press import measure, run_press
from uvms_drake.campaign.harness import runs, stored
from uvms_drake.campaign.pool import Pool
from uvms_drake.common.alarm import LOGGER
from uvms_drake.common.cache import source_digest
from uvms_drake.common.errors import InvalidParameter, RunFailed, require
from uvms_drake.common.jsonable import jsonable
from uvms_drake.common.progress import Progress
from uvms_drake.station.problem import load_model

SAMPLED = "curve"
"""Key of the samples of the force in a run's result."""
SAMPLES = 200
"""Samples of the force that a run keeps, for the figure."""
EXITS = "prescribed_performance"
"""Beginning of the names of controllers whose memory begins with a number of exits."""
TEXTS = ("controller", "robot", "case", "error", "ended")
"""Columns of text in a record; all others are JSON."""


class Run(NamedTuple):
    """A run of the benchmark: everything that it depends on."""

    controller: str
    robot: str
    case: str
    seed: int
    draw: int
    version: str
    """That of `version_of`."""


KEYS = ("controller", "robot", "case", "seed", "index")
"""Columns that tell a run from all others in a record."""


def version_of(name: str) -> str:
    """Returns the SHA-256 of the package's source, scenarios and gains, and of a controller's file.

    Modules that the file imports do not count.
    """
    own = b"" if name in CONTROLLERS else file_of(name)[0].read_bytes()
    return hashlib.sha256(source_digest("*.yaml").encode() + own).hexdigest()


def runs_of(controllers: Sequence[str], robots: Sequence[str], cases: Sequence[str], number: int,
            seed: int) -> list[Run]:
    """Returns all runs: the first draw of every case before the second of any.

    Raises:
        InvalidParameter: There is no such controller, robot or case.
    """
    require(number >= 1, "--runs", number, "at least 1")
    require(seed >= 0, "--seed", seed, "zero or positive")
    for name in controllers:
        controller_named(name)
    for option, names, known in (("--robots", robots, robots_with_gains()),
                                 ("--cases", cases, list(CASES))):
        for name in names:
            require(name in known, option, name, f"of {', '.join(known)}")
    for name in robots:
        read_gains(name)
    versions = {controller: version_of(controller) for controller in controllers}
    return [Run(controller, robot, case, seed, index, versions[controller])
            for index in range(number) for robot in robots for case in cases
            for controller in controllers]


def run_one(run: Run) -> dict[str, Any]:
    """Returns the result of a run; an error of the controller is a result too, under `error`.

    Raises:
        RunFailed: This process has other files.
    """
    if run.version != version_of(run.controller):
        raise RunFailed("the files of a worker are not those of this process")
    LOGGER.setLevel(logging.ERROR)
    result: dict[str, Any] = dict(zip(KEYS, run[:-1], strict=True)) | {"error": None}
    try:
        scenario, course = drawn_case(run.robot, CASES[run.case], run.seed, run.draw)
        model = load_model(scenario)
        controller = controller_named(run.controller)(scenario, model)
        trace = run_press(scenario, model, controller, course)
        result |= {"duration": scenario.duration, "desired": float(scenario.task.force[0]),
                   "event": course.event,
                   **measure(scenario, model, trace, course.event)}
        if run.controller.startswith(EXITS) and run.controller in CONTROLLERS:
            result["exits"] = float(trace.signals["memory"][-1, 0])
        kept = np.linspace(0, len(trace.time) - 1, SAMPLES).astype(int)
        result[SAMPLED] = {"time": trace.time[kept], "force": trace.signals["force"][kept, 0]}
    except (InvalidParameter, RunFailed, RuntimeError, ValueError, np.linalg.LinAlgError) as error:
        result["error"] = f"{type(error).__name__}: {' '.join(str(error).split())}"
    return dict(jsonable(result))


def completed(wanted: Sequence[Run], folder: Path, pool: Pool, progress: Progress, *,
              finished: bool = False) -> list[dict[str, Any]]:
    """Computes the runs that a folder lacks, and returns the results of all.

    A result of another version of the package or of the controller's file is as none; one with an
    error is computed again.

    Args:
        wanted: The runs.
        folder: Folder of the results.
        pool: The workers; those of other machines have the files of controllers of one's own at the
            same paths.
        progress: Progress callback.
        finished: Whether to compute nothing, and return the results that are there: those of whole
            draws, of which no run is missing, if there are any.

    Raises:
        InvalidParameter: The folder has none of those that are finished.
        RunFailed: A worker has another version, or the workers die again and again.
    """
    if not finished:
        return runs(wanted, run_one, folder, pool, progress=progress,
                    again=lambda result: result["error"] is not None)
    found = stored(folder)
    there = [run for run in wanted if run in found]
    require(bool(there), "--finished", str(folder), "left out: the folder has none of these runs")
    whole = {run.draw for run in wanted} - {run.draw for run in wanted if run not in found}
    return [found[run] for run in there if not whole or run.draw in whole]


def write_record(results: Sequence[dict[str, Any]], path: Path) -> None:
    """Writes the record of runs as CSV, without the samples; a value that a run lacks is empty."""
    columns = dict.fromkeys(key for result in results for key in result if key != SAMPLED)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for result in results:
            values = [result.get(key) for key in columns]
            writer.writerow("" if value is None else value if isinstance(value, str)
                            else json.dumps(value, ensure_ascii=False) for value in values)


def read_record(path: Path, **selected: Sequence[str]) -> list[dict[str, Any]]:
    """Returns the results of a record.

    Args:
        path: The file.
        selected: Names of the `controllers`, `robots` and `cases` to return; all if left out.

    Raises:
        InvalidParameter: There is no such file, it is no such record, or it has none of these.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            results = [{"error": None} | {
                key: text if key in TEXTS else json.loads(text)
                for key, text in line.items() if text} for line in csv.DictReader(file)]
    except (OSError, ValueError, AttributeError, csv.Error) as error:
        raise InvalidParameter("--recorded", str(path),
                               f"the CSV of a benchmark ({error})") from None
    require(bool(results) and all(key in results[0] for key in KEYS), "--recorded", str(path),
            f"the CSV of a benchmark, with the columns {', '.join(KEYS)}")
    for key, names in selected.items():
        results = [result for result in results if result[key.removesuffix("s")] in names]
    require(bool(results), "--recorded", str(path), "a benchmark with some of the selected runs")
    return results
