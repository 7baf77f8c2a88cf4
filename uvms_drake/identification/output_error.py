"""Output error: the vehicle's motion in windows of a log, simulated, and its sensitivities.

A window begins at a state x₀ and is simulated by the classical method of Runge and Kutta with two
steps of the grid. Of its own are x₀, a constant wrench and a shift of its clock δ, which stand for
errors that no parameter of the robot explains: x(t + δ) ≈ x(t) + ẋδ. For a sensitivity S,

    d(εS)/dt = F(x + εS) − F(x) − ε[0; I⁻¹Y],                                                  (1)

to first order the exact one for any small ε, Y the regressor of the parameters at x and ν̇.
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.identification.log import GRID, STATE, gravity_in_body, state_rate
from uvms_drake.identification.vehicle_dynamics import VehicleDynamics

EPSILON = 1e-7
"""ε of (1)."""
STEP = 2
"""Samples of the grid in an integration step."""
OWN = len(STATE) + 6 + 1
"""Number of a window's own parameters: x₀, a wrench, a shift of the clock."""


class Motion(NamedTuple):
    """Simulated motion of windows (W) at K instants, two samples of the grid apart."""

    state: np.ndarray
    """x (W, K, 9)."""
    sensitivity: np.ndarray
    """Derivatives by the parameters and the window's own ones (W, K, 9, P + 16); or (.., 0)."""


def simulated(dynamics: VehicleDynamics, wrench: np.ndarray, start: np.ndarray, count: int,
              own: np.ndarray, sensitive: bool = True) -> Motion:
    """Returns the motion of windows, shifted by their clocks.

    Args:
        dynamics: Of all samples of the logs, at its parameters.
        wrench: τ_v of the logs (T, 6) [N, N m].
        start: First sample of each window (W,).
        count: Number K of instants.
        own: x₀, constant wrench and clock of each window (W, 16).
        sensitive: Whether the sensitivities are wanted.
    """
    # The first column is the motion; each other one has a small change of a parameter.
    P, size = len(dynamics.drag_changes) if sensitive else 0, len(STATE)
    extra = np.zeros((OWN - 1 + P, size + 6))
    extra[P:, :size + 6] = EPSILON * np.eye(OWN - 1)
    extra = extra if sensitive else extra[:0]
    x = own[:, None, :size] + np.concatenate([np.zeros((1, size)), extra[:, :size]])
    forces = np.concatenate([np.zeros((1, 6)), extra[:, size:]])

    def terms(sample: np.ndarray) -> tuple[VehicleDynamics, np.ndarray, np.ndarray]:
        at = dynamics.at(sample)
        inverse = np.linalg.inv(np.broadcast_to(at.composite.inertia, (len(start), 6, 6)))
        return at, inverse, (wrench[sample] + own[:, size:size + 6])[:, None] + forces

    def rate(at: tuple[VehicleDynamics, np.ndarray, np.ndarray], x: np.ndarray) -> np.ndarray:
        moved, inverse, tau = at
        g_B = gravity_in_body(x)
        nu_dot = (tau - moved.force(x[..., 3:], g_B)) @ inverse
        if P:
            Y = moved.regressor(x[:, 0, 3:], nu_dot[:, 0], g_B[:, 0])
            nu_dot[:, 1:1 + P] -= EPSILON * Y @ inverse
        return state_rate(x, nu_dot)

    # Two steps of the grid each, with the middle sample between.
    h, now = STEP * GRID, terms(start)
    states, rates = np.empty((2, len(start), count, *x.shape[1:]))
    for k in range(count):
        states[:, k], rates[:, k] = x, (one := rate(now, x))
        if k == count - 1:
            break
        middle, then = terms(start + STEP * k + 1), terms(start + STEP * (k + 1))
        two = rate(middle, x + 0.5 * h * one)
        three = rate(middle, x + 0.5 * h * two)
        x = x + h / 6.0 * (one + 2.0 * two + 2.0 * three + rate(then, x + h * three))
        now = then
    # The clocks, and differences from the first column.
    shifted = states + rates * own[:, -1, None, None, None]
    S = np.moveaxis((shifted[:, :, 1:] - shifted[:, :, :1]) / EPSILON, 2, -1)
    clock = rates[:, :, 0, :, None]
    return Motion(shifted[:, :, 0], np.concatenate([S, clock], axis=-1) if sensitive else S)
