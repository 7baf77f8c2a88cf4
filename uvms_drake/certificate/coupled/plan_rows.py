"""Rows of the coupled linear loop by the plan of a run alone, over those of a declared class.

The loop is that of the scenario that declares the class, at its task: in open water before the
touch, and with the whole plan on the stiffest wall of its class, stuck, from the touch on. In a
mission a contact ends when it is interrupted for longer than `mission.patience`. A slide counts by
the accelerations of its plan.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from pydrake.common.yaml import yaml_load_data

from uvms_drake.certificate.coupled.linear_run import plan_accelerations
from uvms_drake.certificate.coupled.loop_at_task import loop_parts, press_configuration
from uvms_drake.station.problem import load_model
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario, typed_scenario
from uvms_drake.tube.coupled.budget import APPROACH, PRESS
from uvms_drake.tube.coupled.coupled_loop import PLAN, CoupledLoop, coupled_loop, operating_point

PHASES = 4
"""Number of phases between two knots at which the rows are looked at."""
START = "start"
"""Key of the distance of undriven axes from their equilibrium at the start."""


def plan_ratios(record: Record, declared: Scenario) -> dict[str, float]:
    """Returns the largest row by a run's plan over its declared size, by stage, and its start.

    Args:
        record: The run.
        declared: Scenario that declares `certificate.plans`, of which the run is a draw.
    """
    plans = declared.certificate.plans
    assert plans is not None
    loops = _responses(dump_scenario(replace(declared, seed=0)))
    largest = plan_rows(record, loops)
    loop = loops[APPROACH].loop
    off = record.nominal_config[0, loop.undriven] - loop.at.state[loop.undriven]
    out = {name: float(np.max(largest[name] / rows.rows()))
           for name, rows in ((APPROACH, plans.approach), (PRESS, plans.press))}
    if loop.undriven.size:
        out[START] = float(np.max(np.abs(off))) / max(plans.start, np.finfo(float).tiny)
    return out


@dataclass(frozen=True)
class PlanResponses:
    """Responses of a loop to the accelerations of a plan."""

    loop: CoupledLoop
    responses: tuple[tuple[float, np.ndarray], ...]
    """Time since the last acceleration began to enter [s], and responses (lags, rows, 6+n)."""
    preview: float
    """Time by which an acceleration enters before it is the plan's [s]."""


@lru_cache(maxsize=4)
def _responses(text: str) -> dict[str, PlanResponses]:
    return plan_responses(typed_scenario(yaml_load_data(text)))


def plan_responses(scenario: Scenario) -> dict[str, PlanResponses]:
    """Returns the responses of the loops of both stages."""
    model = load_model(scenario)
    parts, config = loop_parts(scenario, model), press_configuration(scenario.task, model)
    walls = scenario.contact.linear_walls(scenario.task.force)
    sticking = [wall for wall in walls if wall.slope == 0.0]
    out = {}
    for name, wall in zip((APPROACH, PRESS), sticking, strict=True):
        loop = coupled_loop(parts, operating_point(parts, config, wall), wall, planned=True)
        system, entry = loop.system, loop.entry(PLAN)
        (tick,) = system.ticks(entry)
        begin, period = system.steps[tick].time, system.period
        responses = []
        for after in np.linspace(0, len(system.steps), PHASES, endpoint=False).astype(int):
            step = system.steps[after]
            since = (step.time - begin) % period
            responses.append((float(since) + step.duration, system.response(entry, after)))
        out[name] = PlanResponses(loop, tuple(responses), max(parts.command_path.preview))
    return out


def plan_rows(record: Record, loops: dict[str, PlanResponses]) -> dict[str, np.ndarray]:
    """Returns the largest size of each row in each stage by the plan alone (rows,)."""
    step = record.scenario.mpc.time_step
    rates = plan_accelerations(record, step)
    out = {}
    for name, of_stage in loops.items():
        largest = np.zeros(len(of_stage.loop.rows))
        for since, h in of_stage.responses:
            rows = np.zeros((len(rates), h.shape[1]))
            for lag in range(min(len(rates), len(h))):
                rows[lag:] += rates[:len(rates) - lag] @ h[lag].T
            time = step * np.arange(len(rates)) - of_stage.preview + since
            there = in_contact(record, time) == (name == PRESS)
            largest = np.maximum(largest, np.max(np.abs(rows[there]), axis=0, initial=0.0))
        out[name] = largest
    return out


def in_contact(record: Record, time: np.ndarray) -> np.ndarray:
    """Returns whether the plan at times (m,) [s] counts as one that presses.

    From the first touch on; in a mission, until `mission.patience` after the last sample on the
    wall.
    """
    mission = record.scenario.mission
    touched = np.append(-np.inf, record.time[record.penetration > 0.0])
    last = touched[np.searchsorted(touched, time, side="right") - 1]
    within: np.ndarray = time - last <= (mission.patience if mission.steps else np.finfo(float).max)
    return within
