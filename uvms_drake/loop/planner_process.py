"""The planner of a controller in a process of its own: Python computes one thing at a time.

The process makes the planner of the same scenario, and gets memory and sample of each plan by a
pipe. It ends with the pipe. Whatever fails in it is a plan that is late, and told.
"""

import math
import os
import signal
import subprocess
import sys
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from time import perf_counter
from typing import NamedTuple

from pydrake.common.yaml import yaml_load_data

from uvms_drake.common.errors import RunFailed
from uvms_drake.control.mpc.nominal_mpc import NominalMpc
from uvms_drake.control.mpc.planner import MpcMemory, Sample
from uvms_drake.station.controller import make_tube
from uvms_drake.station.problem import load_model, make_ocp
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario, typed_scenario

PATIENCE = 1.0
"""Time in which a process has to finish its plan [s], before it is ended."""
ENDED = "the process of the planner has ended: no new plans until reset"


class Failure(NamedTuple):
    """Answer of a process in place of a plan."""

    fatal: bool
    """Whether there is no plan to go on with, `RunFailed`."""
    text: str
    """Error, a line."""


class PlannerProcess:
    """`Computer` of plans in a process of its own.

    Attributes:
        wait: Longest time that a step waits for a plan [s].
        until: Instant of `perf_counter` until which the present step does [s].
        trouble: Error in place of the last plan, a line; empty if there was none.

    Args:
        scenario: The scenario, which it gets as YAML.
        wait: Longest time that a step waits [s].

    Raises:
        RunFailed: The process has ended at once.
    """

    def __init__(self, scenario: Scenario, wait: float):
        self.wait, self.until = wait, 0.0
        self._text = dump_scenario(scenario)
        self._asked = self._begun = 0
        self._open()

    def _open(self) -> None:
        self.trouble, self._at_work = "", False
        self._pipe, theirs = Pipe()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", f"from {__name__} import serve; serve({theirs.fileno()})"],
                pass_fds=[theirs.fileno()],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))})
        try:
            self._pipe.send(self._text)
            self._receive()
        except OSError:
            self.trouble = ENDED
        if self.trouble:
            self.close()
            raise RunFailed(self.trouble)

    def close(self) -> None:
        """Ends the process; until `forget` there are no plans."""
        self.trouble, self._at_work = ENDED, False
        self._pipe.close()
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def start(self, sample: Sample, memory: MpcMemory) -> None:
        """Begins to compute the plan of a sample, unless the last one is not finished."""
        self._asked += 1
        if self._at_work and self._pipe.poll():
            self._receive()
        if not self._at_work and self.trouble != ENDED:
            try:
                self._pipe.send((sample, memory))
                self._at_work, self._begun = True, self._asked
            except OSError:
                self.trouble = ENDED

    def result(self) -> MpcMemory | None:
        """Returns the memory of the last `start`; None if it is late, has failed, or was not begun.

        Raises:
            RunFailed: There is no plan, and none to go on with.
        """
        wait = max(self.until - perf_counter(), 0.0)
        is_asked = self._at_work and self._begun == self._asked
        ready = is_asked and self._pipe.poll(None if math.isinf(wait) else wait)
        return self._receive() if ready else None

    def forget(self) -> None:
        """Drops the plan that is computed, if one is; a process that has ended is begun again."""
        if self._at_work and not self._pipe.poll(PATIENCE):
            self.close()
        with suppress(RunFailed):
            if self._at_work:
                self._receive()
        if self.trouble == ENDED or self._process.poll() is not None:
            self.close()
            self._open()
        self.trouble = ""

    def _receive(self) -> MpcMemory | None:
        self._at_work, self.trouble = False, ""
        try:
            answer: MpcMemory | Failure | None = self._pipe.recv()
        except (EOFError, OSError):
            self.trouble = ENDED
            return None
        if isinstance(answer, Failure):
            if answer.fatal:
                raise RunFailed(answer.text)
            self.trouble = answer.text
            return None
        return answer


def serve(descriptor: int) -> None:
    """Answers with plans on a pipe until it is closed; of an error it sends a `Failure`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the loop.
    pipe: Connection = Connection(descriptor)
    scenario = typed_scenario(yaml_load_data(pipe.recv()))
    model = load_model(scenario)
    mpc: NominalMpc = make_tube(
        scenario, model, make_ocp(scenario, model)).GetSubsystemByName("nominal_mpc")
    answer: MpcMemory | Failure | None = None
    while True:
        try:
            pipe.send(answer)
            sample, memory = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            answer = mpc.computed(sample, memory)
        except Exception as error:  # Whatever a planner raises, the last plan goes on.
            fatal, text = isinstance(error, RunFailed), " ".join(str(error).split())
            answer = Failure(fatal, text if fatal else f"no plan: {type(error).__name__}: {text}")
