"""A single run of a campaign as plain numbers: figures of merit and wall times."""

import logging
import time
from dataclasses import asdict
from typing import Any

import numpy as np

from uvms_drake.campaign.campaign import Campaign, require_same_code
from uvms_drake.campaign.draws import draw
from uvms_drake.common.alarm import LOGGER
from uvms_drake.common.errors import RunFailed
from uvms_drake.common.jsonable import jsonable
from uvms_drake.control.mpc.planner import KEPT, SOLVED
from uvms_drake.mission.law import DONE
from uvms_drake.mission.steps import Hold
from uvms_drake.plant.model_error import BODIES, COEFFICIENTS, FACTORS
from uvms_drake.report.contact_check import desired_force, force_error
from uvms_drake.report.metrics import WALL_SECONDS, metrics, relative_margins
from uvms_drake.report.mission import OUTCOMES
from uvms_drake.report.signals import DONE_STEP, attempts_of
from uvms_drake.report.tube_use import tube_use
from uvms_drake.station.contact.bounds import force_line
from uvms_drake.station.record import Record
from uvms_drake.station.safety import summarise_safety
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.simulation import simulate

TRIPPED = 1e9
"""Largest ratio to a threshold of the supervisor that is kept; that of an exception is infinite."""


def run_one(campaign: Campaign, index: int) -> dict[str, Any]:
    """Returns the draws and figures of merit of a run, and its wall times under `times`.

    All but the latter is the same on every machine. An exception is a result too, as text under
    `error`. The process prints no alarms from here on.

    Raises:
        RunFailed: This process has other files or versions than the campaign was made with.
    """
    require_same_code(campaign)
    LOGGER.setLevel(logging.CRITICAL)
    started = time.perf_counter()
    result: dict[str, Any] = {"index": index, "error": None}
    steps = np.zeros(0)
    try:
        scenario, how = draw(campaign, index)
        result |= how | drawn(scenario)
        record = simulate(scenario, certified=campaign.certified)
        if record.failure:
            raise RunFailed(str(record.failure))
        result |= outcome(record)
        steps = 1e3 * record.step_seconds[np.isin(record.mpc_status, (SOLVED, KEPT))]
    except Exception as error:
        result["error"] = f"{type(error).__name__}: {' '.join(str(error).split())}"
    result["times"] = {
        "seconds": time.perf_counter() - started,
        "step_ms": float(np.median(steps)) if len(steps) else None,
        "worst_step_ms": float(np.max(steps)) if len(steps) else None}
    return dict(jsonable(result))


def drawn(scenario: Scenario) -> dict[str, Any]:
    """Returns the draws of a run for a table."""
    error = scenario.model_error
    return {
        "duration_s": scenario.duration,
        "disturbance": scenario.disturbance.label,
        "rows": getattr(scenario.disturbance, "rows", None),
        "faults": [type(fault).__name__ for fault in scenario.faults],
        "desired_force": float(np.linalg.norm(scenario.task.force[:3])),
        "surface": asdict(scenario.surface),  # type: ignore[call-overload]  # It is a dataclass.
        "eta": scenario.start.eta, "q": scenario.start.q,
        "unknown": {**{name: getattr(error, name) - 1.0 for name in FACTORS},
                    **{f"{body}.{name}": float(np.max(np.abs(error.by_axis(body, name) - 1.0)))
                       for body in BODIES for name in COEFFICIENTS},
                    "current": float(np.linalg.norm(scenario.current)),
                    "payload": error.payload.mass}}


def outcome(record: Record) -> dict[str, Any]:
    """Returns the figures of merit of a run, of `metrics`.

    `worst_disturbance` is D/d̃, D the largest ‖Ŵ⁻¹d‖₂ of the effective disturbance, and `inside` is
    whether that was at most 1, or d̃ is zero. `left` are the rows of the tube that were left, and
    `exits_bands` counts exits of the force bands. `margin` is the smallest of `margins`, and
    `constraint` its name. `limited` is whether the command saturated, `finite` whether all logged
    signals are. With an unknown wall force error and settling are those along n: its tilt and its
    friction exert a force normal to n, where none is desired.
    """
    found = metrics(record)
    tube, force, disturbance = found["tube"], found["force"], found["disturbance"]
    wall, mission = found["wall"], found["mission"]
    margins = relative_margins(found["constraints"])
    name = min(margins, key=lambda key: margins[key])
    # The part of the disturbance that comes from model errors and water.
    induced = record.effective_disturbance - record.disturbance
    bound = disturbance["bound"]
    return {
        "induced": (float(np.max(record.scenario.disturbance.norm(induced)) / bound)
                    if bound > 0.0 else None),
        "worst_disturbance": disturbance["worst"] / bound if bound > 0.0 else None,
        "inside": not disturbance["exceeded"],
        "ratio_set": tube["worst_ratio"]["set"],
        "ratio_trajectory": tube["worst_ratio"]["trajectory"],
        "use": tube_use(record), "off_line": off_line(record),
        "exits_set": tube["exits"], "exits_trajectory": tube["exits_along_the_run"],
        "left": tube["left"], "exits_bands": sum(
            row["exits"] for row in found["contact"].get("force_bands", {}).values() if row),
        "margin": margins[name], "constraint": name, "margins": margins,
        "violations": sum(margin < 0.0 for margin in margins.values()),
        "force_error": wall["final_error"] if wall else force["final_error_norm"],
        "settling_time_s": (wall or force)["settling_time_s"],
        "losses": found["contact"]["losses"],
        "touched": (found["contact"]["first_touch_s"] is not None
                    or not np.any(record.desired_force)),
        "mpc_failures": found["mpc"]["own_failures"],
        "terminal_slack": found["mpc"]["worst_terminal_slack"],
        "limited": any(event["kind"] == "input_limited" for event in found["events"]),
        "finite": is_finite(record),
        "retreated_s": record.trip if np.isfinite(record.trip) else None,
        "supervisor": {cause: min(ratio, TRIPPED) for cause, ratio in summarise_safety(
            record).get("ratios", {}).items()},
        **({"wall": wall} if wall else {}),
        **({"mission": mission_outcome(mission)} if mission else {}),
    }


def off_line(record: Record) -> float | None:
    """Returns the largest |n·(𝔉 − 𝔉_des)| in the last 2 s of a hold over the force line.

    A hold is the end of a press, or one of a mission that was done. None without a sensed contact.
    """
    scenario, steps = record.scenario, record.scenario.mission.steps
    if scenario.contact.declared_wall() is None:
        return None
    desired, error, ratios = desired_force(record), np.abs(force_error(record)), [0.0]
    holds = [attempt.when for attempt in attempts_of(record) if attempt.ended == DONE_STEP
             and isinstance(steps[attempt.step], Hold)] if steps else [slice(len(error))]
    for when in holds:
        time = record.time[when]
        last = time >= time[-1] - WALL_SECONDS
        ratios.append(np.max(error[when][last]) / force_line(scenario, np.max(desired[when][last])))
    return float(max(ratios))


def mission_outcome(mission: dict[str, Any]) -> dict[str, Any]:
    """Returns how a mission ended, from its metrics.

    `done` is whether every step of it is; `failures` are the attempts that failed, also of spots
    that were retried, each by kind and reason; `over_s` is when it was over, None if it was not.
    """
    return {"done": mission["outcome"] == OUTCOMES[DONE], "outcome": mission["outcome"],
            "over_s": mission["over_s"],
            "failures": [f"{row['kind']} {row['step']}: {row['ended']}"
                         for row in mission["steps"] if row["ended"] != "done"]}


def is_finite(record: Record) -> bool:
    """Returns whether every logged signal is a number at every sample."""
    return all(bool(np.all(np.isfinite(signal))) for signal in (
        record.state, record.nominal_state, record.u, record.tau, record.force,
        record.effective_disturbance, record.tube_deviation))
