"""The coupled linear loop of a scenario, from its own parts; see `tube.coupled.coupled_loop`."""

from functools import partial

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from uvms_drake.control.contact.tangential_filter import add_linear_filter
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.model_error import add_simulated_uvms
from uvms_drake.station.command_path import actuation_delay_of
from uvms_drake.station.contact.bounds import pressing_force, sensed_contact
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.coupled.coupled_loop import (
    CoupledLoop,
    LoopParts,
    Wall,
    coupled_loop,
    operating_point,
)


def loop_parts(scenario: Scenario, model: ContactModel) -> LoopParts:
    """Returns the parts of a scenario's loop; its faults, waves and disturbance are none of them.

    Args:
        scenario: Scenario of dynamic motion with a sensed contact.
        model: The controller's model.
    """
    contact = sensed_contact(scenario)
    filtered = None if contact.tangential_lag == 0.0 else partial(
        add_linear_filter, direction=np.asarray(contact.direction),
        lag=contact.tangential_lag, period=contact.period)
    return LoopParts(
        model=model, true=simulated_model(scenario), law=scenario.ancillary,
        sensing=scenario.sensing, actuation=scenario.actuation, filtered=filtered,
        current=np.asarray(scenario.current, dtype=float),
        delay=actuation_delay_of(scenario, model), time_step=scenario.mpc.time_step)


def simulated_model(scenario: Scenario) -> UvmsModel:
    """Returns the functions of the simulated robot, with the errors of the controller's model."""
    plant = MultibodyPlant(0.0)
    uvms = add_simulated_uvms(plant, scenario.model, scenario.model_error)
    plant.Finalize()
    return UvmsModel(uvms, np.asarray(scenario.task.frame, dtype=float))


def press_configuration(scenario: Scenario, model: ContactModel) -> np.ndarray:
    """Returns 𝔮 (6+n,) of the task: the tip's pose with the task's posture."""
    return model.configuration(np.concatenate([
        np.asarray(scenario.task.pose, dtype=float),
        np.asarray(scenario.task.posture, dtype=float)]))


def pressing_wall(scenario: Scenario, stiffness: float, slope: float = 0.0) -> Wall:
    """Returns a wall of the class that is pressed on with the task's force.

    Args:
        scenario: The scenario.
        stiffness: κ [N/m].
        slope: Slope of friction by the tip's speed [N s/m].
    """
    contact, force = sensed_contact(scenario), pressing_force(scenario)
    return Wall(np.asarray(contact.direction, dtype=float), force, stiffness,
                damping=force * contact.dissipation, slope=slope)


def loop_at_task(scenario: Scenario, model: ContactModel, wall: Wall, *, planned: bool = False
                 ) -> CoupledLoop:
    """Returns the loop at the configuration of the task."""
    parts = loop_parts(scenario, model)
    return coupled_loop(parts, operating_point(
        parts, press_configuration(scenario, model), wall), wall, planned=planned)
