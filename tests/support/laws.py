"""The laws as functions of two states, and pairs of states to try them at."""

import numpy as np

from uvms_drake.control.laws import Resolved, TipFirst
from uvms_drake.control.laws.law import pair_of
from uvms_drake.control.laws.tip_first import BlockGains
from uvms_drake.papers.nikou2018 import Transpose

PAPER = "modules=[uvms_drake.papers.nikou2018]"
"""Override with which a scenario knows the paper's law."""
K, SIGMA = 13.0, 4.0  # 1/s


def not_asked() -> np.ndarray:
    raise AssertionError("the law has no use for it")


def resolved_input(model, state, nominal, acceleration, k, sigma) -> np.ndarray:
    return Resolved(k, sigma).command(
        model, pair_of(model, state, nominal), lambda: acceleration, not_asked).u


def transpose_input(model, state, nominal, nominal_input, k, sigma, joints=False) -> np.ndarray:
    return Transpose(k, sigma, joints).command(
        model, pair_of(model, state, nominal), not_asked, lambda: nominal_input)


def tip_first_input(model, state, nominal, acceleration, k, sigma) -> np.ndarray:
    gains = BlockGains(k, sigma)
    return TipFirst(gains, gains).command(
        model, pair_of(model, state, nominal), lambda: acceleration, not_asked).u


def pairs(model, states, where: str):
    """Yields a real state, a nominal one near it, a nominal acceleration and a disturbance."""
    rng = np.random.default_rng(20)
    for state in states[where]:
        y = model.task_pose(state[:10]) + rng.uniform(-0.05, 0.05, size=10)
        zeta = state[10:] + rng.uniform(-0.05, 0.05, size=10)
        nominal = np.concatenate([model.configuration(y), zeta])
        yield state, nominal, rng.uniform(-0.3, 0.3, size=10), rng.uniform(-0.1, 0.1, size=10)
