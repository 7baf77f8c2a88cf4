"""A robot whose thrusters lag, integrated by RK4 with the prediction model as the plant."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from uvms_drake.control.laws import TipFirst
from uvms_drake.control.laws.law import pair_of
from uvms_drake.control.laws.outputs import outputs_of, tip_rows
from uvms_drake.model.uvms_model import configuration_rate

CONFIG = np.array([-1.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 1.0, 0.4, 0.2])
"""Away from any wall."""


class Motion(NamedTuple):
    """Signals at the instants of a run, a row for each."""

    time: np.ndarray
    """(T,) [s]."""
    error: np.ndarray
    """e = y − ȳ (T, 10)."""
    J: np.ndarray
    """J_y (T, 10, 10)."""
    d: np.ndarray
    """(T, 10)."""
    asked: np.ndarray
    """τ as it is commanded (T, 10)."""
    wrench: np.ndarray
    """τ_v as it is given (T, 6)."""
    carried: np.ndarray
    """A = J_ηv M*⁻¹ (T, 6, 6), see `control.laws.tip_first`."""
    feedback: np.ndarray
    """−(k + σ)ė − kσe − δ̂ of a `TipFirst` (T, 10)."""


def hover(time: float) -> tuple[np.ndarray, np.ndarray]:
    """A plan that stays where it is: (𝔮̄, ζ̄), ζ̄̇."""
    return np.concatenate([CONFIG, np.zeros(10)]), np.zeros(10)


def run(model, law, disturbance: Callable, duration: float, *, lag: float = 0.0,
        plan: Callable = hover, step: float = 0.02, largest: float = 1.0,
        preview: Callable | None = None) -> Motion:
    """Returns the motion until its end, or until an error exceeds `largest`.

    Args:
        model: The robot and what the law knows of it.
        law: The law; with an observer in continuous time, if it has one.
        disturbance: Returns d (10,) of the time and J_y.
        duration: [s].
        lag: T of the thrusters [s]; zero for none.
        plan: Returns (𝔮̄, ζ̄) and ζ̄̇ of the time.
        step: Of RK4 [s].
        largest: [m, rad].
        preview: Returns what is asked for ahead (10,) of the time.
    """
    rows, tip_first = tip_rows(model), isinstance(law, TipFirst)
    k, sigma, rates = (law.gains(key, 4) if tip_first else np.zeros(10)
                       for key in ("k", "sigma", "observer"))
    log = []

    def rate(time: float, x: np.ndarray, note: bool = False) -> np.ndarray:
        config, zeta, wrench, seen = np.split(x, [10, 20, 26])
        nominal, nominal_acceleration = plan(time)
        now = pair_of(model, x[:20], nominal)
        out = outputs_of(now, rows)
        estimate = rates * (out.rate[0] - seen)
        if tip_first:
            now = now.given(wrench=wrench if lag else None, estimate=estimate,
                               preview=None if preview is None else preview(time))
        command = law.command(model, now, lambda: nominal_acceleration, None)
        asked, M = command.tau, command.M
        given = np.concatenate([wrench if lag else asked[:6], asked[6:]])
        b = model.inverse_dynamics(now.kinematics.at(0), zeta, np.zeros(10))
        predicted, d = np.linalg.solve(M, given - b), disturbance(time, out.J[0])
        if note:
            J = out.J[0]
            star = M[:6, :6] - M[:6, 6:] @ np.linalg.solve(J[6:, 6:], J[6:, :6])
            feedback = -(k + sigma) * (out.rate[0] - out.rate[1]) - k * sigma * out.error - estimate
            log.append((time, out.error, J, d, asked, given[:6], J[:6, :6] @ np.linalg.inv(star),
                        feedback))
        lagging = (asked[:6] - wrench) / lag if lag else np.zeros(6)
        return np.concatenate([configuration_rate(config, zeta), predicted + d, lagging,
                               out.J[0] @ predicted + out.bias[0] + estimate])

    start, acceleration = plan(0.0)
    now = pair_of(model, start, start)
    x = np.concatenate([start, np.zeros(6), outputs_of(now, rows).rate[0]])
    x[20:26] = law.command(model, now, lambda: acceleration, None).tau[:6]
    for i in range(round(duration / step)):
        time = i * step
        k1 = rate(time, x, note=True)
        if np.max(np.abs(log[-1][1])) > largest:
            break
        k2 = rate(time + 0.5 * step, x + 0.5 * step * k1)
        k3 = rate(time + 0.5 * step, x + 0.5 * step * k2)
        k4 = rate(time + step, x + step * k3)
        x = x + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return Motion(*(np.array(item) for item in zip(*log, strict=True)))
