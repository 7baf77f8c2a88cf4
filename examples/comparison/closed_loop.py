"""A controller and the plant in closed loop, with the wall time of every controller step.

The plant is the same for every controller: one RK4 step of this package's `ContactModel` in NumPy,
with the input constant. Its drag is exact, |v|; a controller may approximate |v|.
"""

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Protocol

import numpy as np
from problems import STEP, Problem, load_model

from uvms_drake.model.uvms_model import configuration_rate


class Controller(Protocol):
    """Interface of a controller to the closed loop."""

    name: str
    status: bool
    """Whether the last step converged."""

    def step(self, x: np.ndarray) -> np.ndarray:
        """Returns u (10,) at the measured state x, and keeps a warm start for the next step."""

    def reset(self) -> None:
        """Forgets the warm start."""


@dataclass(frozen=True)
class History:
    """States, inputs and step times of n steps."""

    states: np.ndarray
    """x_0, ..., x_n (n+1, nx)."""
    inputs: np.ndarray
    """u_0, ..., u_{n−1} (n, 10)."""
    seconds: np.ndarray
    """Wall time of each controller step (n,)."""
    converged: np.ndarray
    """The controller's status after each step (n,)."""


def run(controller: Controller, plant_step: Callable[[np.ndarray, np.ndarray], np.ndarray],
        x0: np.ndarray, steps: int) -> History:
    """Returns the history of a closed loop from a cold start at x0; only `step` is timed."""
    controller.reset()
    states, inputs, seconds, converged = [x0], [], [], []
    for _ in range(steps):
        start = perf_counter()
        u = controller.step(states[-1])
        seconds.append(perf_counter() - start)
        converged.append(controller.status)
        inputs.append(u)
        states.append(plant_step(states[-1], u))
    return History(*map(np.array, (states, inputs, seconds, converged)))


def make_plant_step(problem: Problem) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Returns the plant x, u ↦ next x: one RK4 step of length h."""
    rate = _rate

    def step(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        k1 = rate(x, u)
        k2 = rate(x + STEP / 2 * k1, u)
        k3 = rate(x + STEP / 2 * k2, u)
        k4 = rate(x + STEP * k3, u)
        return x + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    return step


def _rate(x: np.ndarray, u: np.ndarray) -> np.ndarray:
    config, zeta = x[:10], x[10:]
    acceleration = load_model().drift(config, zeta) + u
    return np.concatenate([configuration_rate(config, zeta), acceleration])
