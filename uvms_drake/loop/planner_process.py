"""The planner of a controller in a process of its own: Python computes one thing at a time.

The process makes the planner of the same scenario, and gets memory and sample of each plan by a
pipe. It ends with the pipe.
"""

import os
import signal
import subprocess
import sys
import weakref
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from time import perf_counter

from pydrake.common.yaml import yaml_load_data

from uvms_drake.common.errors import RunFailed
from uvms_drake.control.mpc.nominal_mpc import NominalMpc
from uvms_drake.control.mpc.planner import MpcMemory, Sample
from uvms_drake.station.controller import make_tube
from uvms_drake.station.problem import load_model, make_ocp
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario, typed_scenario


class PlannerProcess:
    """`Computer` of plans in a process of its own.

    Attributes:
        wait: Longest time that a step waits for a plan [s].
        until: Instant of `perf_counter` until which the present step does [s].

    Args:
        scenario: The scenario, which it gets as YAML.
        wait: Longest time that a step waits [s].
    """

    def __init__(self, scenario: Scenario, wait: float):
        self.wait, self.until = wait, 0.0
        self._asked = self._begun = 0
        self._at_work = False
        self._pipe, theirs = Pipe()
        with theirs:
            process = subprocess.Popen(
                [sys.executable, "-c", f"from {__name__} import serve; serve({theirs.fileno()})"],
                pass_fds=[theirs.fileno()],
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))})
        weakref.finalize(self, _end, self._pipe, process)
        self._pipe.send(dump_scenario(scenario))
        self._receive(None)

    def start(self, sample: Sample, memory: MpcMemory) -> None:
        """Begins to compute the plan of a sample, unless the last one is not finished."""
        self._asked += 1
        self._poll(0.0)
        if not self._at_work:
            self._pipe.send((sample, memory))
            self._at_work, self._begun = True, self._asked

    def result(self) -> MpcMemory | None:
        """Returns the memory of the last `start`; None if it is late, or was not begun.

        Raises:
            RunFailed: There is no plan, and none to go on with; or the process has ended.
        """
        if not self._at_work or self._begun != self._asked:
            return None
        return self._poll(max(self.until - perf_counter(), 0.0))

    def forget(self) -> None:
        """Waits for the plan that is computed, if one is, and drops it."""
        if self._at_work:
            self._poll(None)

    def _poll(self, wait: float | None) -> MpcMemory | None:
        if not self._at_work or (wait is not None and not self._pipe.poll(
                None if wait == float("inf") else wait)):
            return None
        return self._receive(wait)

    def _receive(self, wait: float | None) -> MpcMemory | None:
        try:
            answer = self._pipe.recv()
        except (EOFError, ConnectionResetError):
            raise RunFailed("the process of the planner has ended") from None
        self._at_work = False
        if isinstance(answer, str):
            raise RunFailed(answer)
        found: MpcMemory | None = answer
        return found


def _end(pipe: Connection, process: "subprocess.Popen[bytes]") -> None:
    pipe.close()
    process.wait()


def serve(descriptor: int) -> None:
    """Answers with plans on a pipe until it is closed; of an error it sends the text."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the loop.
    pipe: Connection = Connection(descriptor)
    scenario = typed_scenario(yaml_load_data(pipe.recv()))
    model = load_model(scenario)
    mpc: NominalMpc = make_tube(
        scenario, model, make_ocp(scenario, model)).GetSubsystemByName("nominal_mpc")
    pipe.send(None)
    while True:
        try:
            sample, memory = pipe.recv()
        except (EOFError, ConnectionResetError):
            return
        try:
            pipe.send(mpc.computed(sample, memory))
        except RunFailed as error:
            pipe.send(str(error))
