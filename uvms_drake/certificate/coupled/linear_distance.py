"""Distance of a run from its coupled linear loop, over the lines that a scenario declares."""

import re

import numpy as np

from uvms_drake.certificate.coupled.linear_run import linear_run
from uvms_drake.certificate.coupled.loop_at_task import loop_parts, press_configuration
from uvms_drake.common.errors import require
from uvms_drake.control.laws.tip_first import TipFirst
from uvms_drake.station.diagram import monitor_begin
from uvms_drake.station.problem import load_model
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.coupled.coupled_loop import coupled_loop, operating_point
from uvms_drake.tube.settings import LinearLines

GROUPS = {"tip": "depth|tip [yz]", "vehicle": "vehicle [xyz]", "attitude": "roll|pitch|yaw",
          "joints": r"q\d+"}
"""Patterns of the names of rows, by the names of the lines."""


def check_linear_loop(scenario: Scenario) -> None:
    """Raises `InvalidParameter` if a scenario that declares lines has no coupled linear loop."""
    key, lines = "certificate.linear", scenario.certificate.linear
    walls = scenario.contact.linear_walls(scenario.task.force)
    require(bool(walls), key, lines, "left out without a sensed contact")
    require(not scenario.mission.steps, key, lines, "left out with a mission: the linear loop is "
            "at one place, pressed from the first touch on")
    require(isinstance(scenario.ancillary, TipFirst), key, lines, "left out but for !TipFirst")
    model = load_model(scenario)
    parts, free = loop_parts(scenario, model), walls[0]
    coupled_loop(parts, operating_point(
        parts, press_configuration(scenario.task, model), free), free)


def linear_distances(record: Record, lines: LinearLines) -> dict[str, float]:
    """Returns the largest |x − x_lin| of each group of rows over its line.

    From the time on at which the tube is watched, when the observers have settled.
    """
    run = linear_run(record)
    watched = run.time >= monitor_begin(record.scenario.mpc.hover, bool(record.certified))
    apart = np.abs(run.of_record - run.values)[watched]
    out = {}
    for group, pattern in GROUPS.items():
        of_group = [bool(re.fullmatch(pattern, row)) for row in run.rows]
        out[group] = float(np.max(apart[:, of_group], initial=0.0)) / getattr(lines, group)
    return out
