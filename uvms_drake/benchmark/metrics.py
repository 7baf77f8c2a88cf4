"""Figures of merit of a run."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from uvms_drake.baselines.gains import read_gains
from uvms_drake.benchmark.loop import Trace
from uvms_drake.control.limits import Limit
from uvms_drake.control.plan.points import Points
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.contact.bounds import pressing_force, sensed_contact
from uvms_drake.station.problem import limits_of
from uvms_drake.station.scenario.scenario import Scenario

LAST = 3.0
"""End of a run over which force and lateral error are averaged [s]: the same time since the touch
for all controllers."""
IMPACT = 1.0
"""Time from the touch in which a force is of the impact [s]."""
SHORTFALL = 1.0
"""Part of a commanded wrench that the thrusters cannot give, from which they are saturated [N]."""


def measure(scenario: Scenario, model: ContactModel, trace: Trace) -> dict[str, Any]:
    """Returns the figures of merit of a run; None where there is none, as of a run without touch.

    `force_rms` and `lateral` are of the last `LAST` seconds of a run, which ends a given time after
    the touch; of motion during a slide. `peak` is the largest force of the run, `impact` that of
    the first `IMPACT` seconds from the touch. `settling` is the time from the touch until the force
    stays within the task's tolerance. `limits` are the broken limits of pose and speed with the
    largest excess, in the limit's unit, and `force`, that of the declared contact. `saturated` is
    the part of the time in which a limit cuts the command. `chatter` is the total variation of a
    command per second over the largest |τᵢ| of its axis, of the worst axis [1/s]. `energy` is
    ∫Σ|τᵢζᵢ|dt. `step_ms` and `worst_step_ms` are processor times.
    """
    # Force and contact along the declared direction, from the true signals.
    contact, n = sensed_contact(scenario), sensed_contact(scenario).direction
    desired, tolerance = pressing_force(scenario), scenario.task.force_tolerance
    time, signals = trace.time, trace.signals
    force = signals["force"][:, :3] @ n
    off = np.abs(force - desired)
    touching = signals["penetration"].reshape(-1) > 0.0
    touch = int(np.argmax(touching)) if np.any(touching) else None
    within = off <= tolerance
    settled = len(off) - int(np.argmin(within[::-1])) if not np.all(within) else 0
    last = time >= time[-1] - LAST
    way = signals["chi"][:, :3] - signals["place"]
    lateral = np.linalg.norm(way - np.outer(way @ n, n), axis=1)
    zeta = signals["state"][:, model.size:]
    pressed = touch is not None and not trace.ended
    return {
        "ended": trace.ended or None,
        "force_rms": float(np.sqrt(np.mean(off[last]**2))) if pressed else None,
        "peak": float(np.max(force)),
        "impact": None if touch is None else float(
            np.max(force[(time >= time[touch]) & (time <= time[touch] + IMPACT)])),
        "touch": None if touch is None else float(time[touch]),
        "settling": (float(max(time[settled] - time[touch], 0.0))
                     if pressed and settled < len(time) else None),
        "lateral": float(np.mean(lateral[last])) if pressed else None,
        "lost": 0 if touch is None else int(np.count_nonzero(
            np.diff(touching[touch:].astype(int)) < 0)),
        "limits": broken_limits(limits_of(scenario, model), model, trace) | (
            {"force": float(np.max(force) - contact.force)}
            if np.max(force) > contact.force else {}),
        "saturated": float(np.mean(_saturated(trace))),
        "chatter": _chatter(time, signals["tau"], read_gains(scenario.model).largest),
        "energy": float(np.trapezoid(np.sum(np.abs(signals["exerted"] * zeta), axis=1), time)),
        "step_ms": 1e3 * float(np.median(trace.step_seconds)),
        "worst_step_ms": 1e3 * float(np.max(trace.step_seconds)),
    }


def broken_limits(limits: Mapping[str, Limit], model: ContactModel, trace: Trace
                  ) -> dict[str, float]:
    """Returns the largest excess of each broken limit of pose and speed, in the limit's unit."""
    config, zeta = np.split(trace.signals["state"], 2, axis=1)
    at = Points(model, config, model.task_pose(config), zeta)
    worst = {}
    for name, limit in limits.items():
        if limit.about == "input":
            continue
        values, (lower, upper) = limit.values(at), limit.bounds()
        excess = float(np.max(np.maximum(values - upper, lower - values)))
        if excess > 0.0:
            worst[name] = excess
    return worst


def _saturated(trace: Trace) -> np.ndarray:
    signals = trace.signals
    cut = np.zeros(len(trace.time), dtype=bool)
    for name, least in (("limited", 0.0), ("wrench_shortfall", SHORTFALL)):
        if name in signals:
            rows = np.delete(signals[name], 3, axis=1) if name == "wrench_shortfall" else (
                signals[name])  # Roll is not driven by every vehicle.
            cut |= np.any(np.abs(rows) > least, axis=1)
    return cut


def _chatter(time: np.ndarray, tau: np.ndarray, largest: np.ndarray) -> float:
    """Returns the total variation of a command per second over its largest, of the worst axis."""
    variation = np.sum(np.abs(np.diff(tau, axis=0)), axis=0)[largest > 0.0]
    return float(np.max(variation / largest[largest > 0.0]) / max(time[-1] - time[0], 1e-9))
