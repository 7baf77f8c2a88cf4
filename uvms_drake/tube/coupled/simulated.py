"""Simulation of a linear periodic system with given errors."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from uvms_drake.model.signals.linear import Block
from uvms_drake.tube.coupled.periodic import PeriodicSystem

Input = Callable[[float], np.ndarray]
"""Value of an entry by the time [s]."""


def simulated(systems: Sequence[tuple[float, PeriodicSystem]], inputs: Mapping[Block, Input],
              duration: float, start: np.ndarray | None = None
              ) -> tuple[np.ndarray, np.ndarray]:
    """Returns the times (T,) of the ends of steps and the outputs there (T, o).

    Args:
        systems: Times from which each system applies, the first at zero [s]; they have the same
            states and clocks, as loops at points with another wall do.
        inputs: Entries that are not zero. One of a clock is read at its ticks, one of the flow at
            the beginning of each step, over which it is held.
        duration: End [s].
        start: First state (m,); zero if left out.
    """
    (_, system), following = systems[0], list(systems[1:])
    x = np.zeros(len(system.A)) if start is None else np.array(start, dtype=float)
    w, times, rows, period = np.zeros(system.B.shape[1]), [], [], float(system.period)
    for cycle in range(int(np.ceil(duration / period - 1e-9))):
        for i, step in enumerate(system.steps):
            now = cycle * period + float(step.time)
            while following and now >= following[0][0] - 1e-9:
                _, system = following.pop(0)
            for block, value in inputs.items():
                w[system.entries[block]] = value(now)
            by_state, by_entry = system.maps
            x = by_state[i] @ x + by_entry[i] @ w
            times.append(now + step.duration)
            rows.append(system.C @ x + system.D @ w)
    return np.array(times), np.array(rows)
