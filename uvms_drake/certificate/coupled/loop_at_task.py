"""The coupled linear loop of a scenario, from its own parts; see `tube.coupled.coupled_loop`."""

from functools import partial

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from uvms_drake.control.contact.tangential_filter import add_linear_filter
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.model_error import ModelError, add_simulated_uvms
from uvms_drake.station.command_path import command_path_of
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.scenario.scenario import Scenario, Task
from uvms_drake.tube.coupled.coupled_loop import LoopParts


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
        model=model, law=scenario.ancillary,
        true=simulated_model(scenario.model, scenario.model_error, scenario.task.frame),
        sensing=scenario.sensing, actuation=scenario.actuation, filtered=filtered,
        current=np.asarray(scenario.current, dtype=float),
        command_path=command_path_of(scenario.actuation, model), time_step=scenario.mpc.time_step)


def simulated_model(robot: str, error: ModelError, frame: np.ndarray) -> UvmsModel:
    """Returns the functions of the simulated robot, with the errors of the controller's model."""
    plant = MultibodyPlant(0.0)
    uvms = add_simulated_uvms(plant, robot, error)
    plant.Finalize()
    return UvmsModel(uvms, np.asarray(frame, dtype=float))


def press_configuration(task: Task, model: ContactModel) -> np.ndarray:
    """Returns 𝔮 (6+n,) of the task: the tip's pose with the task's posture."""
    return model.configuration(np.concatenate([
        np.asarray(task.pose, dtype=float), np.asarray(task.posture, dtype=float)]))
