"""Logs one after the other, cut into windows of equal length."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from uvms_drake.identification.log import GRID, Log
from uvms_drake.identification.output_error import STEP
from uvms_drake.identification.parameters import UNIT, Parameter
from uvms_drake.identification.vehicle_dynamics import VehicleDynamics, arm_motion, vehicle_dynamics
from uvms_drake.model.links import Links
from uvms_drake.model.uvms_model import UvmsModel

WINDOW = 8.0
"""Duration of a window [s]."""
INSTANTS = round(WINDOW / (STEP * GRID)) + 1
"""Instants of a window that are compared."""
LENGTH = STEP * (INSTANTS - 1) + 1
"""Samples of a window."""
STILL, TURNING = 0.01, 0.01
"""Largest rate of a joint and of the vehicle at rest [rad/s]."""
REST = 1.0
"""Shortest rest [s]."""


class Windows(NamedTuple):
    """All logs, one after the other, T samples; and windows of them."""

    logs: tuple[Log, ...]
    """The logs."""
    dynamics: VehicleDynamics
    """Dynamics by the robot's file, at every sample."""
    wrench: np.ndarray
    """τ_v (T, 6) [N, N m]."""
    state: np.ndarray
    """Measured x (T, 9); nan where nothing was measured."""
    resting: np.ndarray
    """Whether arm and vehicle are at rest (T,)."""
    start: np.ndarray
    """First sample of each window (W,)."""
    log_of: np.ndarray
    """Index of the log of each window (W,)."""
    velocity: np.ndarray
    """Expected ν₁ at the beginning of each window (W, 3) [m/s], used where none was measured."""

    def measured(self) -> np.ndarray:
        """Returns the measured x at the instants of the windows (W, K, 9)."""
        return self.state[self.start[:, None] + STEP * np.arange(INSTANTS)]

    def of(self, which: np.ndarray) -> "Windows":
        """Returns some of the windows."""
        return self._replace(start=self.start[which], log_of=self.log_of[which],
                             velocity=self.velocity[which])

    def first_state(self) -> np.ndarray:
        """Returns x at the beginning of each window (W, 9), zero where nothing is known."""
        first = self.state[self.start].copy()
        first[:, 3:6] = np.where(np.isfinite(first[:, 3:6]), first[:, 3:6], self.velocity)
        return np.nan_to_num(first)

    def place_in_run(self) -> np.ndarray:
        """Returns the number of windows without a gap before each (W,)."""
        out = np.zeros(len(self.start), dtype=int)
        follows = (np.diff(self.start) == LENGTH) & (np.diff(self.log_of) == 0)
        for i in np.flatnonzero(follows):
            out[i + 1] = out[i] + 1
        return out


def windows_of(logs: Sequence[Log], model: UvmsModel, base: Links,
               parameters: Sequence[Parameter]) -> Windows:
    """Returns the windows of logs; a window has no sample that is unknown.

    Args:
        logs: The logs.
        model: The robot by its file.
        base: Its links.
        parameters: The parameters whose effects are wanted.
    """
    joined = {name: np.concatenate([getattr(log, name) for log in logs])
              for name in ("q", "q_dot", "q_ddot", "wrench", "state", "known")}
    known = joined["known"]
    filled = {name: _filled(joined[name], known) for name in ("q", "q_dot", "q_ddot", "wrench")}
    motion = arm_motion(model, filled["q"], filled["q_dot"], filled["q_ddot"])
    dynamics = vehicle_dynamics(base, [each.links for each in parameters], UNIT, motion)
    first, starts, log_of = 0, list[int](), list[int]()
    for index, log in enumerate(logs):
        at = first
        for run in _runs(log.known):
            at = first + run.start
            while at + LENGTH <= first + run.stop:
                starts.append(at)
                log_of.append(index)
                at += LENGTH
        first += len(log.time)
    # Without a gyro the attitude tells of turns; a velocity that nothing measures is unknown.
    velocity, turning = joined["state"][:, 3:6], joined["state"][:, 6:]
    rates = np.concatenate([log.attitude_rate for log in logs])
    moving = np.nan_to_num(np.hstack([velocity, np.where(np.isnan(turning), rates, turning)]))
    resting = known & (np.max(np.abs(joined["q_dot"]), axis=1, initial=0.0) < STILL) & (
        np.max(np.abs(moving), axis=1) < TURNING)
    first = 0
    for log in logs:  # A rest lasts.
        part = slice(first, first + len(log.time))
        lasting = np.zeros(len(log.time), dtype=bool)
        for run in _runs(resting[part]):
            lasting[run] = (run.stop - run.start) * GRID >= REST
        resting[part], first = lasting, part.stop
    return Windows(tuple(logs), dynamics, filled["wrench"], joined["state"], resting,
                   np.array(starts, dtype=int), np.array(log_of, dtype=int),
                   np.zeros((len(starts), 3)))


def _filled(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Returns values (T, c), between known samples on a line; no window has such samples."""
    out, at = np.zeros_like(values), np.arange(len(known))
    for column, value in zip(out.T, values.T, strict=True):
        if known.any():
            column[:] = np.interp(at, at[known], value[known])
    return out


def _runs(flags: np.ndarray) -> list[slice]:
    """Returns the runs of samples whose flag is set."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
