"""One run of a campaign, as plain numbers: what happened, and how long it took."""

import logging
import time
from typing import Any

import numpy as np

from uvms_drake.alarm import LOGGER
from uvms_drake.campaign.induced import induced_disturbance
from uvms_drake.campaign.setup import Campaign
from uvms_drake.campaign.vary import kind_of, vary
from uvms_drake.certificate.reach import largest_force
from uvms_drake.model.contact import make_surface_law
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.record import Record
from uvms_drake.scenario import Scenario
from uvms_drake.simulation import simulate
from uvms_drake.summary import jsonable, summarise

DECLARED_FORCE = "force"
"""Constraint ‖𝔉‖ of the declared set; no limit of the MPC sees to it."""


def run_one(campaign: Campaign, index: int) -> dict[str, Any]:
    """Returns what came of a run: `result`, the same wherever it is run, and `wall` times.

    Whatever is raised is a result too, as text under `error`. The process says nothing of alarms
    from here on: those of many runs, some of them in other machines' logs, tell nobody anything.
    """
    LOGGER.setLevel(logging.ERROR)
    started = time.perf_counter()
    result: dict[str, Any] = {"index": index, "error": None}
    worst_step = None
    try:
        scenario = vary(campaign, index)
        result |= drawn(scenario)
        record = simulate(scenario, certified=campaign.certified)
        result |= outcome(record, campaign.base)
        worst_step = 1e3 * float(np.max(record.step_seconds, initial=0.0))
    except Exception as error:
        result["error"] = f"{type(error).__name__}: {' '.join(str(error).split())}"
    wall = {"seconds": time.perf_counter() - started, "worst_step_ms": worst_step}
    return {"result": jsonable(result), "wall": wall}


def drawn(scenario: Scenario) -> dict[str, Any]:
    """Returns what was drawn for a run, as far as it is of interest in a table."""
    return {"disturbance": kind_of(scenario), "rows": getattr(scenario.disturbance, "rows", None),
            "desired_force": float(np.linalg.norm(scenario.task.force[:3])),
            "eta": scenario.start.eta, "q": scenario.start.q}


def outcome(record: Record, base: Scenario) -> dict[str, Any]:
    """Returns the figures of merit of a run.

    `margin` is the smallest distance to a constraint, over the constraint's own size (of a joint:
    its range), and `constraint` its name. `finite` is whether all logged signals are. `inside` is
    whether the disturbance and what an error of the model induces were together below d̃.
    """
    summary: dict[str, Any] = summarise(record)
    tube, force = summary["tube"], summary["force"]
    margins = relative_margins(record, summary["constraints"], base)
    name = min(margins, key=lambda key: margins[key])
    signals = (record.state, record.nominal_state, record.u, record.tau, record.force,
               record.tube_deviation)
    bound = base.disturbance.bound
    induced = induced_disturbance(record)
    total = record.disturbance + induced if np.any(induced) else record.disturbance
    return {
        "induced": float(np.max(np.linalg.norm(induced, axis=1))),
        "inside": bool(np.max(np.linalg.norm(total, axis=1)) <= (1.0 + 1e-9) * bound),
        "ratio_set": tube["worst_ratio"]["set"], "ratio_trajectory":
            tube["worst_ratio"]["trajectory"],
        "exits_set": tube["exits"], "exits_trajectory": tube["exits_along_the_run"],
        "disturbance_excesses": tube["disturbance_excesses"],
        "margin": margins[name], "constraint": name,
        "violations": sum(margin < 0.0 for margin in margins.values()),
        "force_error": force["final_error_norm"], "settling_time_s": force["settling_time_s"],
        "mpc_failures": summary["mpc"]["failures"],
        "finite": all(bool(np.all(np.isfinite(signal))) for signal in signals),
    }


def relative_margins(record: Record, constraints: dict[str, Any], base: Scenario
                     ) -> dict[str, float]:
    """Returns the margin of each constraint over its size; negative if violated."""
    ranges = record.joint_upper - record.joint_lower
    out = {}
    for name, row in constraints.items():
        joint = name.endswith(("_min", "_max"))
        size = ranges[int(name[1:-4]) - 1] if joint else row["limit"]
        out[name] = float(row["margin"] / size)
    if not record.scenario.kinematic:
        model = UvmsModel.load(base.model, make_surface_law(base.surface))
        largest = largest_force(base, model)
        pressed = float(np.max(np.linalg.norm(record.force[:, :3], axis=1)))
        out[DECLARED_FORCE] = (largest - pressed) / largest
    return out
