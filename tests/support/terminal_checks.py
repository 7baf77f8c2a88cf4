"""Checks of given terminal sets and penalties against the conditions of the proof."""

import copy
import dataclasses

import numpy as np

from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.model.frames.euler import COMPLEX_STEP
from uvms_drake.tube.terminal_set import (
    AT_REST,
    DECREASE,
    TerminalCheck,
    TerminalLoop,
    check_radius,
    linear_radius,
    unit_states,
)


def check_terminal(ocp: Ocp, radius: float, samples: int = 4000, seed: int = 0) -> TerminalCheck:
    """Returns the findings for ‖ξ‖_P ≤ `radius`."""
    loop = TerminalLoop(ocp)
    return check_radius(loop, radius, unit_states(loop, samples, seed))


def check_penalty(ocp: Ocp, P: np.ndarray, gain: np.ndarray | None = None,
                  radius: float | None = None) -> TerminalCheck:
    """Returns whether V = ‖ξ‖²_P decreases as it must, within the linear limits or a radius.

    Without a `gain` the controller is the one that minimises V⁺ + ℓ of the linearisation at every
    ξ: where even that has a negative margin at rest, no controller makes P a terminal penalty.
    """
    other = copy.copy(ocp)
    other.terminal = dataclasses.replace(
        ocp.terminal, P=P, gain=best_gain(ocp, P) if gain is None else gain)
    check = check_terminal(other, radius or linear_radius(TerminalLoop(other)))
    return dataclasses.replace(
        check, margins={name: check.margins[name] for name in (DECREASE, AT_REST)})


def best_gain(ocp: Ocp, P: np.ndarray) -> np.ndarray:
    """Returns the gain of the decision d that minimises ‖Aξ + Bd‖²_P + h‖Cξ + Dd‖²_R."""
    step = 1j * COMPLEX_STEP * np.eye(len(P) + ocp.model.size)
    after, w, *_ = ocp.move(step[:, :len(P)], step[:, len(P):])
    (A, B), (C, D) = (np.split(item.imag.T / COMPLEX_STEP, [len(P)], axis=1) for item in (after, w))
    weight = ocp.time_step * D.T @ ocp.R
    return -np.linalg.solve(weight @ D + B.T @ P @ B, weight @ C + B.T @ P @ A)
