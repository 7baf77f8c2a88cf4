"""A run with a mission, made up, and a short mission that is drawn."""

from dataclasses import replace

import numpy as np

from support.synthetic import synthetic_sensed_record
from uvms_drake.mission.law import DONE, RUNNING
from uvms_drake.mission.steps import Approach, Hold, Mission, Retreat, Slide
from uvms_drake.station.record import Record

MISSION = Mission(steps=[
    Approach(), Hold(force=10.0, tolerance=1.0), Slide(along=np.array([0.0, -0.1]), speed=0.05),
    Retreat()])
TIMES = (0.0, 1.0, 2.0, 4.0, 5.0)  # s, when the steps begin, and the last one ends
OFF = 0.003  # m, of the tip from the line


def mission_record(mission: Mission = MISSION, duration: float = 6.0, **progress: np.ndarray
                   ) -> Record:
    """Returns a tip that slides along y (−t₂) from 2 s on, off by 3 mm along z, 4 mm behind."""
    base = synthetic_sensed_record(duration)
    time = base.time
    step = np.searchsorted(TIMES, time + 1e-9) - 1
    y = 0.05 * np.clip(time - 2.0, 0.0, 2.0)
    chi = base.chi.copy()
    chi[:, 0], chi[:, 1], chi[:, 2] = 0.02, y - 0.004 * (step == 2), OFF * (step == 2)
    columns = {"step": np.minimum(step, len(mission.steps)),
               "outcome": np.where(step < 4, RUNNING, DONE), "reason": 0.0 * time,
               "failures": 0.0 * time, "tries": 0.0 * time} | progress
    force = np.zeros((len(time), 6))
    force[:, 0] = 10.0 + 1.5 * np.sin(2.0 * np.pi * time)
    return replace(
        base, scenario=replace(base.scenario, mission=mission), chi=chi, force=force,
        signals=base.signals | {
            "force_last_valid": force, "touched": (step > 0)[:, None].astype(float),
            "mission_place": np.column_stack([0.0 * y, y, 0.0 * y]),
            "mission_force": np.full((len(time), 1), 10.0),
            "mission_progress": np.column_stack(list(columns.values()))})


SHORT = ["duration=30", "mission.retries=0", "mission.steps=["
         "!Approach {at: [-0.09, 0.06], settle: 0.5}, !Slide {along: [0.03, 0.0]}, "
         "!Retreat {distance: 0.03}]"]
"""Options of `girona500_inspection` with a mission of one spot next to the start, and a slide."""
