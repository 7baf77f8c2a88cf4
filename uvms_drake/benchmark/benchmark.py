"""Runs of the benchmark by workers, one file for each; a folder with some is continued."""

import hashlib
import json
import logging
import os
import re
from collections.abc import Callable, Container, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uvms_drake.baselines.gains import read_gains, robots_with_gains
from uvms_drake.benchmark.cases import CASES, ROBOTS, drawn_case
from uvms_drake.benchmark.controllers import CONTROLLERS, controller_named, versions_of
from uvms_drake.benchmark.loop import run_loop
from uvms_drake.benchmark.metrics import measure
from uvms_drake.campaign.pool import Pool, run_all
from uvms_drake.common.alarm import LOGGER
from uvms_drake.common.errors import InvalidParameter, RunFailed, require
from uvms_drake.common.jsonable import jsonable
from uvms_drake.station.problem import load_model

RUNS_FOLDER = "runs"
SAMPLED = "curve"
"""Key of the samples of the force in a run's result."""
SAMPLES = 200
"""Samples of the force that a run keeps, for the figure."""
LONGEST, HASH = 100, 12
"""Largest number of characters of a controller's name, and of its hash, in the name of a file."""
EXITS = "prescribed_performance"
"""Beginning of the names of controllers whose memory begins with a number of exits."""


@dataclass(frozen=True)
class Run:
    """A run of the benchmark: everything that it depends on."""

    controller: str
    robot: str
    case: str
    seed: int
    index: int

    @property
    def file(self) -> str:
        """Name of its file, with a hash that tells controllers `a/b.py` from `a_b.py`."""
        name = self.controller
        if name not in CONTROLLERS:
            digest = hashlib.sha256(name.encode()).hexdigest()[:HASH]
            name = f"{re.sub(r'[^A-Za-z0-9_.-]', '_', name)[-LONGEST:]}-{digest}"
        return f"{self.robot}.{self.case}.{name}.{self.index}.json"


def runs_of(controllers: Sequence[str], robots: Sequence[str], cases: Sequence[str], runs: int,
            seed: int) -> list[Run]:
    """Returns all runs: the first draw of every case before the second of any.

    Raises:
        InvalidParameter: There is no such controller, robot or case.
    """
    require(runs >= 1, "--runs", runs, "at least 1")
    require(seed >= 0, "--seed", seed, "zero or positive")
    for name in controllers:
        controller_named(name)
    for option, names, known in (("--robots", robots, robots_with_gains()),
                                 ("--cases", cases, list(CASES))):
        for name in names:
            require(name in known, option, name, f"of {', '.join(known)}")
    for name in robots:
        read_gains(name)
    return [Run(controller, robot, case, seed, index) for index in range(runs)
            for robot in robots for case in cases for controller in controllers]


def run_one(run: Run) -> dict[str, Any]:
    """Returns the result of a run; an error of the controller is a result too, under `error`."""
    LOGGER.setLevel(logging.ERROR)
    result: dict[str, Any] = {**asdict(run), "versions": versions_of(run.controller),
                              "error": None}
    try:
        scenario, events = drawn_case(run.robot, CASES[run.case], run.seed, run.index)
        model = load_model(scenario)
        controller = controller_named(run.controller)(scenario, model)
        result["duration"] = scenario.duration
        trace = run_loop(scenario, model, controller, events)
        result |= measure(scenario, model, trace)
        if run.controller.startswith(EXITS) and run.controller in CONTROLLERS:
            result["exits"] = float(trace.signals["memory"][-1, 0])
        kept = np.linspace(0, len(trace.time) - 1, SAMPLES).astype(int)
        result[SAMPLED] = {"time": trace.time[kept], "force": trace.signals["force"][kept, 0]}
        result["desired"] = float(scenario.task.force[0])
    except (InvalidParameter, RunFailed, RuntimeError, ValueError, np.linalg.LinAlgError) as error:
        result["error"] = f"{type(error).__name__}: {' '.join(str(error).split())}"
    return dict(jsonable(result))


def completed(runs: Sequence[Run], folder: Path, pool: Pool,
              progress: Callable[[str, float], None], *, finished: bool = False
              ) -> list[dict[str, Any]]:
    """Computes the runs that a folder lacks, and returns the results of all.

    A result of another version of the package or of the controller's file is as none; one with an
    error is computed again.

    Args:
        runs: The runs, of one seed.
        folder: Folder of the results.
        pool: The workers; those of other machines have the files of controllers of one's own at the
            same paths.
        progress: Progress callback.
        finished: Whether to compute nothing, and return the results that are there: those of whole
            draws, of which no run is missing, if there are any.

    Raises:
        InvalidParameter: The folder has runs of another seed, or none of those that are finished.
        RunFailed: A worker has another version, or the workers die again and again.
    """
    path = folder / RUNS_FOLDER
    path.mkdir(parents=True, exist_ok=True)
    stored = {run: _read(path / run.file) for run in runs}
    for result in stored.values():
        require(result is None or result["seed"] == runs[0].seed, "--output", str(folder),
                "a folder without runs of another seed")
    found = {run: result for run, result in stored.items()
             if result is not None and result.get("versions") == versions_of(run.controller)}
    require(not finished or bool(found), "--finished", str(folder),
            "left out: the folder has none of these runs")
    if finished:
        whole = whole_draws(runs, found)
        return [found[run] for run in runs if run in found and (not whole or run.index in whole)]
    missing = [run for run in runs if run not in found or found[run]["error"] is not None]
    for done, (run, result) in enumerate(run_all(run_one, missing, pool), 1):
        if result["versions"] != versions_of(run.controller):
            raise RunFailed("the files of a worker are not those of this process")
        draft = path / f"{run.file}.part"
        draft.write_text(json.dumps(result, ensure_ascii=False) + "\n", encoding="utf-8")
        os.replace(draft, path / run.file)
        found[run] = result
        progress(f"{done} of {len(missing)} runs", done / len(missing))
    return [found[run] for run in runs if run in found]


def whole_draws(runs: Sequence[Run], found: Container[Run]) -> set[int]:
    """Returns the numbers of the draws of which every run is found, so that a table is fair."""
    return {run.index for run in runs} - {run.index for run in runs if run not in found}


def _read(path: Path) -> dict[str, Any] | None:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return None


def default_names() -> tuple[list[str], list[str], list[str]]:
    """Returns all controllers, robots and cases."""
    return list(CONTROLLERS), list(ROBOTS), list(CASES)
