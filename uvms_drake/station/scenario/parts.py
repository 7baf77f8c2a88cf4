"""Lists of a scenario, of parts and of faults: their keys, kinds of faults, path of a command."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from uvms_drake.actuation import thruster_faults
from uvms_drake.actuation.joint_brake import StuckJoint
from uvms_drake.actuation.thrusters import Thrusters
from uvms_drake.common.errors import require, within
from uvms_drake.common.kinds import offer
from uvms_drake.control.mpc.solver_faults import DroppedPeriod, SolverFailure, SolverTimeout
from uvms_drake.model.signals.command_path import IDEAL_PATH, CommandPath
from uvms_drake.model.signals.fault import Fault
from uvms_drake.model.signals.sensor_actuator import Actuator, Part, Sensor
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.disturbance import ExcessDisturbance
from uvms_drake.plant.waves import UnknownFlow
from uvms_drake.sensing import faults as sensing_faults
from uvms_drake.sensing.navigation import LostFixes, Navigation

offer(Fault, SolverFailure, SolverTimeout, DroppedPeriod, sensing_faults.FrozenState,
      sensing_faults.LostState, sensing_faults.LostForce, sensing_faults.FrozenForce,
      sensing_faults.SaturatedForce, sensing_faults.JumpedForce, StuckJoint, ExcessDisturbance,
      sensing_faults.JumpedPosition, sensing_faults.MiscalibratedForce, LostFixes, UnknownFlow,
      thruster_faults.LostThruster, thruster_faults.StuckThruster, thruster_faults.ReversedThruster,
      thruster_faults.ExchangedThrusters)


def keyed(key: str, parts: Sequence[Part]) -> dict[str, Part]:
    """Returns the parts of a scenario's list by their keys."""
    return {f"{key}[{i}]": part for i, part in enumerate(parts)}


def faults_at(place: str, faults: Sequence[Fault]) -> dict[str, Any]:
    """Returns the faults at a `place` by their keys in a scenario."""
    return {f"faults[{i}]": fault for i, fault in enumerate(faults) if fault.place == place}


def with_lost_fixes(sensing: Sequence[Sensor], faults: Sequence[Fault]) -> list[Sensor]:
    """Returns the sensors with the fault of the fixes of a navigation, which they must have."""
    for key, fault in faults_at("fixes", faults).items():
        require(any(isinstance(part, Navigation) for part in sensing), key, type(fault).__name__,
                "left out: sensing has no !Navigation")
        sensing = [replace(part, dvl=fault.of(part.dvl)) if isinstance(part, Navigation) else part
                   for part in sensing]
    return list(sensing)


def with_faults(actuation: Sequence[Actuator], faults: Sequence[Fault], model: UvmsModel
                ) -> list[Actuator]:
    """Returns the actuation with the faults of its thrusters; raises for one that it has not."""
    found, known = faults_at("thrusters", faults), [
        part.known(model) for part in actuation if type(part) is Thrusters]
    for key, fault in found.items():
        require(bool(known), key, type(fault).__name__, "left out: actuation has no !Thrusters")
        with within(key):
            fault.sent(known[0], *np.zeros((2, known[0].size)))
    return [thruster_faults.FaultyThrusters(**vars(part), faults=tuple(found.values()))
            if found and type(part) is Thrusters else part for part in actuation]


def uncovered(faults: Sequence[Fault]) -> list[str]:
    """Returns the names of the faults under which no certificate holds."""
    return [type(fault).__name__ for fault in faults if fault.assumption() is not None]


def command_path_of(actuation: Sequence[Actuator], model: UvmsModel) -> CommandPath:
    """Returns the path of a law's commands through actuation, by the controller's model."""
    path = IDEAL_PATH
    for key, part in keyed("actuation", actuation).items():
        with within(key):
            path = path.then(part.command_path(model))
    return path
