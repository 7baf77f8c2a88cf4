"""The tube MPC of a scenario."""

from functools import partial

import numpy as np
from pydrake.systems.framework import Diagram

from uvms_drake.common.errors import require, within
from uvms_drake.control.contact.press_control import PressControl
from uvms_drake.control.mpc.planner import Targets
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.solvers import make_solver
from uvms_drake.control.tube_mpc import make_tube_mpc
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.contact.bounds import (
    known_reading,
    largest_force,
    pressing_force,
    safe_depth_margin,
    sensed_contact,
    sensing_of,
)
from uvms_drake.station.problem import retargeted_ocp
from uvms_drake.station.scenario.parts import command_path_of
from uvms_drake.station.scenario.scenario import Scenario

IMPLICIT = ("implicit_euler", "radau1", "radau3", "velocity_implicit_euler")
"""Integration schemes whose steps may be much longer than 1/k, with which the command is not cut.
Their Newton iteration asks the law far from the solution, and where a limit cuts the command it is
flat: in `paper_dynamic` it would converge in far shorter steps only."""


def make_tube(scenario: Scenario, model: ContactModel, ocp: Ocp) -> Diagram:
    """Returns the tube-based NMPC that solves a problem of `make_ocp`.

    It presses by the measured force if the contact is sensed; else it makes a problem of its own
    for each desired force. See `IMPLICIT` for the limits to which its commands are cut.
    """
    press = targets = None
    if scenario.contact.declared_wall() is not None:
        press = _press_control(scenario)
    else:
        targets = Targets(np.asarray(scenario.task.force, dtype=float),
                          partial(retargeted_ocp, scenario, model))
    limits = None if scenario.simulator.integration_scheme in IMPLICIT else scenario.limits
    path = command_path_of(scenario.actuation, model)
    with within("mpc"):
        solver = make_solver(ocp)
    with within("ancillary"):
        return make_tube_mpc(ocp, scenario.ancillary, targets, limits, path, solver, press)


def _press_control(scenario: Scenario) -> PressControl:
    """Returns the press of a sensed contact, after a check that its forces are admissible."""
    contact, largest = sensed_contact(scenario), largest_force(scenario)
    require(pressing_force(scenario) < largest, "task.force", scenario.task.force,
            f"less than {largest:.3g} N: contact.force less the parts of sensor, tube, angle and "
            "stiffness")
    reading = known_reading(scenario)
    require(reading is None or largest + contact.force_error < reading.largest,
            "sensing", scenario.sensing,
            f"with a range of more than {largest + contact.force_error:.3g} N")
    for i, step in enumerate(scenario.mission.steps):
        require(step.strongest < largest, f"mission.steps[{i}].force", step.strongest,
                f"less than {largest:.3g} N, like task.force")
    return PressControl(contact.walls, sensing_of(scenario), pressing_force(scenario), largest,
                        safe_depth_margin(scenario))
