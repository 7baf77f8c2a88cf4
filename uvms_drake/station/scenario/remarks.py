"""Remarks on the values of a scenario without effect on its run."""

import numpy as np

from uvms_drake.model.surface.law import check_surface
from uvms_drake.station.scenario.scenario import Scenario


def remarks(scenario: Scenario) -> list[str]:
    """Returns a line for every accepted value without effect."""
    lines = [f"faults[{i}].start = {start:g} s is after the end of the run: it never happens"
             for i, fault in enumerate(scenario.faults)
             if (start := getattr(fault, "start", 0.0)) >= scenario.duration]
    task, step = scenario.task, scenario.simulator.max_step_size
    if task.pose is not None:
        surface = scenario.contact.controller_surface(check_surface(scenario.surface))
        pose, force = np.asarray(task.pose, dtype=float), np.asarray(task.force, dtype=float)
        off = surface.pose_for(force, pose)[:3] - pose[:3]
        depth = surface.penetration_for(float(np.linalg.norm(force[:3]))) or 0.0
        if np.linalg.norm(off) > 2.0 * depth:
            lines.append(f"task.pose is {np.linalg.norm(off):.3g} m off the surface: along its "
                         "normal, the desired force determines the position")
    if scenario.mpc.hover >= scenario.duration:
        lines.append(f"mpc.hover = {scenario.mpc.hover:g} s is not before the end of the run: the "
                     "robot only hovers, and no tube is monitored without a certificate")
    forces = [part.reading(0.0, 0.0) is not None for part in scenario.sensing]
    if True in forces and not all(forces[(first := forces.index(True)):]):
        lines.append(f"sensing[{first}] measures the force in the true attitude: parts that "
                     "change the measured one come after it")
    shortest = min(scenario.log_period, scenario.mpc.time_step)
    if step > shortest:
        lines.append(f"simulator.max_step_size = {step:g} s is cut to {shortest:g} s by the log or "
                     "the MPC")
    return lines
