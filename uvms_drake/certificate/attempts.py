"""The ledger of attempts at certificates in probability: a further attempt costs confidence.

The runs of an attempt are a function of its *identity*, the SHA-256 of all that they depend on:
scenario, robot, program, numpy, and number of runs. So neither a folder nor a seed can be chosen.
But the smallest change of a limit gives others, and with enough of them a bad loop passes once.
So each identity is written, before its runs, into a ledger that belongs to no folder of results;
the k-th one of a *task* spends the part 1/(k(k + 1)) of the probability 1 − c that any of them is
wrong: Σ 1/(k(k + 1)) = 1. All attempts at a task have the c of the first: another is refused.

A task is not changed by any number: it is the robot by its name, the kind of contact, and whether
there is a mission or a press alone. Limits, gains, tube, unknowns, sensors, thrusters, law, steps,
program and number of runs are those of an attempt. It is coarse on purpose: two scenarios of one
robot that press an unknown wall share their attempts. That costs confidence: a bound is
then larger than it would have to be, and no less true.

The ledger protects from deceiving oneself, not from deceit: it can be deleted, a robot renamed, and
attempts on another machine are in a ledger of their own.
"""

import fcntl
import hashlib
import json
import os
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pydrake.common.yaml import yaml_load_data

from uvms_drake.common.cache import cache_dir
from uvms_drake.common.errors import InvalidParameter, RunFailed, require
from uvms_drake.common.jsonable import jsonable
from uvms_drake.model.description.robot_files import model_dir
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario

LEDGER_FILE = "attempts.jsonl"
FREE = ("name", "description", "modules", "seed", "visual", "model")
"""Keys of a scenario that no draw depends on; files of robot and modules count by their content."""


@dataclass(frozen=True)
class Attempt:
    """An attempt at a certificate in probability, a line of the ledger."""

    task: str
    """Robot, kind of contact, and mission or press."""
    scenario: str
    """Name of the scenario."""
    runs: int
    """Number N of runs."""
    identity: str
    """SHA-256 of all that the runs depend on."""
    confidence: float
    """Confidence c over all attempts at the task."""

    @property
    def seed(self) -> int:
        """Seed of the draws: the first 64 bits of the identity."""
        return int(self.identity[:16], 16)


def attempt_of(scenario: Scenario, program: dict[str, Any], runs: int, confidence: float
               ) -> Attempt:
    """Returns an attempt.

    Args:
        scenario: The scenario, with its integration step.
        program: Hashes and versions of robot and program.
        runs: Number of runs.
        confidence: As of `Attempt`; no draw depends on it.
    """
    content = yaml_load_data(dump_scenario(scenario))
    drawn = {key: value for key, value in content.items() if key not in FREE}
    text = json.dumps(jsonable([drawn, program, version("numpy"), runs], names=True),
                      sort_keys=True, ensure_ascii=False)
    identity = hashlib.sha256(text.encode()).hexdigest()
    return Attempt(task_of(scenario), scenario.name, runs, identity, confidence)


def task_of(scenario: Scenario) -> str:
    """Returns the task of a scenario in words."""
    return ", ".join([model_dir(scenario.model).name, type(scenario.contact).__name__,
                      "mission" if scenario.mission.steps else "press"])


def ledger_path() -> Path:
    """Returns the path of the ledger, beside the cached certificates."""
    return cache_dir() / LEDGER_FILE


def begun(attempt: Attempt) -> tuple[Attempt, ...]:
    """Returns the attempts at a task up to this one, in their order; a new one is written down.

    Raises:
        InvalidParameter: Another confidence than that of the attempts before.
        RunFailed: The ledger cannot be written to, or has a line that is none of it.
    """
    path, known = ledger_path(), list[Attempt]()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a+", encoding="utf-8") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            file.seek(0)
            for text in file:
                known.append(Attempt(**json.loads(text)))
            of_task = {each.identity: each for each in known if each.task == attempt.task}
            of_first = next(iter(of_task.values()), attempt).confidence
            require(attempt.confidence == of_first, "--confidence", attempt.confidence,
                    f"{of_first:g}, over all attempts at {attempt.task}, in {path}")
            if attempt.identity not in of_task:
                file.write(json.dumps(asdict(attempt), ensure_ascii=False) + "\n")
                file.flush()
                os.fsync(file.fileno())
            order = [*of_task, attempt.identity]
            return tuple((of_task | {attempt.identity: attempt})[each]
                         for each in order[: order.index(attempt.identity) + 1])
    except OSError as error:
        raise RunFailed(f"{path}: the ledger of attempts has to be kept ({error.strerror}); "
                        "without it there is no certificate in probability") from None
    except InvalidParameter:  # A ValueError.
        raise
    except (ValueError, TypeError):
        raise RunFailed(f"{path}: line {len(known) + 1} is none of a ledger of attempts: an "
                        f"object of {', '.join(Attempt.__dataclass_fields__)}") from None
