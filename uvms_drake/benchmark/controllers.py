"""Controllers of the benchmark by name, and those of one's own by file."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from pydrake.systems.framework import System

from uvms_drake.baselines.baseline import BASELINES, Baseline, RobotGains, read_gains
from uvms_drake.baselines.law import PressTask
from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.control.laws import Resolved, TipFirst
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.laws.tip_first import BlockGains
from uvms_drake.control.mpc.nominal_mpc import NominalMpc
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.controller import make_tube
from uvms_drake.station.problem import make_ocp
from uvms_drake.station.scenario.modules import import_file
from uvms_drake.station.scenario.scenario import Scenario

Factory = Callable[[Scenario, ContactModel], System]
"""Function that makes a controller for a scenario, with the controller's model."""
NOMINAL, OFFSET_FREE, TUBE = "nominal_mpc", "nominal_mpc_offset_free", "tube_mpc"
NO_FEEDBACK = 1e-6
"""Gains of the ancillary law of a nominal MPC [1/s]: a law has positive ones."""
NOMINAL_LAW = Resolved(k=NO_FEEDBACK, sigma=NO_FEEDBACK)
"""Law of the nominal MPC. It has the measured force and the drift at the measured state in it,
u = ζ̄̇ − f: the robot has the acceleration of the plan, as far as the model is right."""
FACTORY = "make_controller"
"""Name of the function in a file of one's own, unless another is given after a colon."""
MPC_DECLARED = ("direction", "model", "class of the wall", "limits", "lag of the thrusters")
"""Data that the MPCs are given, besides state and force."""


def controller_with_gains(name: str, scenario: Scenario, model: ContactModel, gains: RobotGains
                          ) -> System:
    """Returns a baseline, or the nominal MPC with an observer, with given gains."""
    if name == OFFSET_FREE:
        return _mpc(scenario, model, _offset_free_law(gains, scenario.ancillary))
    task, contact = scenario.task, sensed_contact(scenario)
    pose = np.asarray(task.pose, dtype=float)
    return Baseline(model, PressTask(
        contact.direction, place=pose[:3], attitude=pose[3:],
        posture=np.asarray(task.posture, dtype=float), force=task.force_along(contact.direction),
        largest=contact.force), BASELINES[name](gains), gains)


def _with_default_gains(name: str) -> Factory:
    return lambda scenario, model: controller_with_gains(
        name, scenario, model, read_gains(scenario.model))


def _mpc(scenario: Scenario, model: ContactModel, alone: AncillaryLaw | None = None) -> System:
    """Makes the tube MPC; with a law, the nominal MPC alone, which plans from the measured state.

    The latter has no feedback between its plans but that of the law, and no supervisor: thresholds
    are radii of a tube, and gains of the retreat those of the law.
    """
    if alone is not None:
        scenario = replace(scenario, ancillary=alone, supervisor=None, mpc=replace(
            scenario.mpc, initial_state="measured", hover=0.0))
    controller = make_tube(scenario, model, make_ocp(scenario, model))
    mpc = controller.GetSubsystemByName("nominal_mpc")
    assert isinstance(mpc, NominalMpc)
    mpc.time_by(time.process_time)  # A run may share its core with others.
    return controller


def _offset_free_law(gains: RobotGains, declared: AncillaryLaw) -> TipFirst:
    """Returns the law of the nominal MPC with the observer of the tube MPC, u = ζ̄̇ − f − δ̂.

    The robot has the acceleration of the plan in spite of a constant disturbance, so that the tip
    comes to rest at the target, which moves until the force is the desired one.
    """
    return TipFirst(
        vehicle=BlockGains(NO_FEEDBACK, NO_FEEDBACK, gains.offset_free.vehicle),
        tip=BlockGains(NO_FEEDBACK, NO_FEEDBACK, gains.offset_free.tip),
        undriven=declared.undriven if isinstance(declared, TipFirst) else [])


CONTROLLERS: dict[str, Factory] = {
    name: _with_default_gains(name) for name in BASELINES} | {
    NOMINAL: partial(_mpc, alone=NOMINAL_LAW), OFFSET_FREE: _with_default_gains(OFFSET_FREE),
    TUBE: _mpc}
"""Controllers of this package by name."""


def controller_named(name: str) -> Factory:
    """Returns the factory of a controller: by name, or `FILE.py` or `FILE.py:FUNCTION`.

    Raises:
        InvalidParameter: There is none, or the file cannot be loaded.
    """
    if name in CONTROLLERS:
        return CONTROLLERS[name]
    path, function = file_of(name)
    require(path.suffix == ".py" and path.is_file(), "--controllers", name,
            f"of {', '.join(CONTROLLERS)}, or FILE.py:FUNCTION of a controller of one's own")
    try:
        module = import_file(path.resolve())
    except Exception as error:
        raise InvalidParameter("--controllers", name,
                               f"a file that can be loaded ({type(error).__name__}: {error})"
                               ) from None
    made = getattr(module, function, None)
    require(callable(made), "--controllers", name, f"a file with a function {function}")
    return made  # type: ignore[return-value]


def file_of(name: str) -> tuple[Path, str]:
    """Returns file and function of the name of a controller of one's own."""
    file, _, function = name.partition(":")
    return Path(file), function or FACTORY


def declared_to(name: str, gains_of: str) -> list[str]:
    """Returns the data that a controller is given besides state and force, if known.

    Args:
        name: Name of the controller.
        gains_of: Name of a robot with gains.
    """
    if name in (NOMINAL, OFFSET_FREE, TUBE):
        return list(MPC_DECLARED)
    if name not in BASELINES:
        return ["not known"]
    laws = BASELINES[name](read_gains(gains_of)).values()
    return [*dict.fromkeys(fact for law in laws for fact in law.declared), "largest force"]
