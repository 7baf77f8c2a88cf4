"""The planner of a controller in a process of its own: Python computes one thing at a time.

The process makes the planner of the same scenario, and gets memory and sample of each plan by a
pipe. It ends with the pipe. Whatever fails in it is a plan that is late, and told. It is started by
a command, and not by `multiprocessing`, which would run the loop's own script in it once more.
"""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection

import numpy as np
from pydrake.common.yaml import yaml_load_data

from uvms_drake.common.errors import RunFailed
from uvms_drake.control.mpc.nominal_mpc import NominalMpc
from uvms_drake.control.mpc.planner import SOLVED, MpcMemory, Sample
from uvms_drake.station.controller import make_tube
from uvms_drake.station.problem import load_model, make_ocp
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario, typed_scenario

ENDED = "the process of the planner has ended: no new plans until reset"


class PlannerProcess:
    """`Computer` of plans in a process of its own.

    Attributes:
        trouble: Error in place of the last plan, a line; empty if there was none.

    Args:
        scenario: The scenario, which it gets as YAML.
        wait: Longest time that a plan is waited for at its instant [s].

    Raises:
        RunFailed: The process has ended at once.
    """

    def __init__(self, scenario: Scenario, wait: float):
        # A poll has no infinity.
        self.trouble, self._at_work, self._is_overdue, self._wait = "", False, False, min(wait, 1e6)
        self._from_rest: MpcMemory | None = None
        self._pipe, theirs = Pipe()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", f"from {__name__} import serve; serve({theirs.fileno()})"],
                pass_fds=[theirs.fileno()],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))})
        self._send(dump_scenario(scenario))
        self._receive()  # It has made its planner.
        if self.trouble:
            self.close()
            raise RunFailed(self.trouble)

    def close(self) -> None:
        """Ends the process, whatever it does."""
        self._pipe.close()
        self._process.kill()
        self._process.wait()

    def start(self, sample: Sample, memory: MpcMemory) -> None:
        """Begins to compute the plan of a sample, unless the last one is not finished.

        One from rest that has come too late is that of this sample, if the robot still rests there:
        it would take as long again.
        """
        first = self._receive() if self._at_work and self._pipe.poll() else None
        self._from_rest = None if first is None else begun_again(first, sample, memory)
        self._is_overdue = self._at_work
        if not self._at_work and self._from_rest is None:
            self._send((sample, memory))

    def result(self) -> MpcMemory | None:
        """Returns the memory of the last `start`; None if it is late, has failed, or was not begun.

        Raises:
            RunFailed: There is no plan, and none to go on with.
        """
        if self._from_rest is not None:
            return self._from_rest
        self._is_overdue = self._is_overdue or not (self._at_work and self._pipe.poll(self._wait))
        return None if self._is_overdue else self._receive()

    def _send(self, message: object) -> None:
        try:
            self._pipe.send(message)
            self._at_work = True
        except OSError:
            self.trouble = ENDED

    def _receive(self) -> MpcMemory | None:
        self._at_work = False
        try:
            answer: MpcMemory | RunFailed | str | None = self._pipe.recv()
        except (EOFError, OSError):
            answer = ENDED
        self.trouble = answer if isinstance(answer, str) else ""
        if isinstance(answer, RunFailed):
            raise answer
        return answer if isinstance(answer, MpcMemory) else None


def begun_again(first: MpcMemory, sample: Sample, memory: MpcMemory) -> MpcMemory | None:
    """Returns the memory with a first plan from rest, begun at a later sample; None if it is none.

    Args:
        first: The memory with the plan.
        sample: The sample.
        memory: The memory at the sample, with the plan to keep a place.
    """
    if first.plan is None or memory.plan is None or first.report[1] != SOLVED or not memory.at_rest:
        return None
    if not np.array_equal(first.plan.start, memory.plan.start):
        return None
    report = first.report.copy()
    report[0] = sample.time
    return replace(first, plan=replace(first.plan, start_time=sample.time), report=report)


def serve(descriptor: int) -> None:
    """Answers with plans on a pipe until it is closed; with an error, or a line about it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the loop.
    pipe: Connection = Connection(descriptor)
    answer: MpcMemory | RunFailed | str | None = None
    try:
        scenario = typed_scenario(yaml_load_data(pipe.recv()))
        model = load_model(scenario)
        mpc: NominalMpc = make_tube(
            scenario, model, make_ocp(scenario, model)).GetSubsystemByName("nominal_mpc")
    except Exception as error:
        pipe.send("the process has no planner (it loads parts from `modules` alone): "
                  f"{type(error).__name__}: {' '.join(str(error).split())}")
        return
    with suppress(EOFError, OSError):
        while True:
            pipe.send(answer)
            sample, memory = pipe.recv()
            try:
                answer = mpc.planner.again(sample, memory)
            except Exception as error:  # Whatever a planner raises, the last plan goes on.
                answer = error if isinstance(error, RunFailed) else (
                    f"no plan: {type(error).__name__}: {' '.join(str(error).split())}")
