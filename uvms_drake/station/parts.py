"""Lists of a scenario, of parts and of faults: their keys and checks, and the kinds of faults."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from uvms_drake.actuation.joint_brake import StuckJoint
from uvms_drake.common.errors import require, within
from uvms_drake.common.kinds import offer
from uvms_drake.control.mpc.solver_faults import DroppedPeriod, SolverFailure, SolverTimeout
from uvms_drake.model.signals.fault import Fault
from uvms_drake.model.signals.sensor_actuator import Component, Part
from uvms_drake.plant.disturbance import ExcessDisturbance
from uvms_drake.sensing.faults import (
    FrozenForce,
    FrozenState,
    JumpedForce,
    LostForce,
    LostState,
    SaturatedForce,
)

if TYPE_CHECKING:
    from uvms_drake.station.motions.motion import Motion

offer(Fault, SolverFailure, SolverTimeout, DroppedPeriod, FrozenState, LostState, LostForce,
      FrozenForce, SaturatedForce, JumpedForce, StuckJoint, ExcessDisturbance)


def keyed(key: str, parts: Sequence[Part]) -> dict[str, Part]:
    """Returns the parts of a scenario's list by their keys."""
    require(isinstance(parts, Sequence), key, parts, "a list of parts")
    return {f"{key}[{i}]": part for i, part in enumerate(parts)}


def check_components(key: str, components: Sequence[Component], motion: "Motion") -> None:
    """Raises `InvalidParameter` for the first invalid entry of the list `key`."""
    for i, component in enumerate(components):
        with within(f"{key}[{i}]"):
            component.check()
        require(motion.has_forces or not component.needs_forces, f"{key}[{i}]",
                type(component).__name__, f"left out, if the motion is {motion.name}")


def check_faults(faults: Sequence[Fault], motion: "Motion") -> None:
    """Raises `InvalidParameter` for the first fault that is invalid, or comes twice."""
    for i, fault in enumerate(faults):
        require(type(fault) not in map(type, faults[:i]), f"faults[{i}]", type(fault).__name__,
                "of a kind that is not declared twice")
    check_components("faults", faults, motion)


def faults_at(place: str, faults: Sequence[Fault]) -> dict[str, Any]:
    """Returns the faults at a `place` by their keys in a scenario."""
    return {f"faults[{i}]": fault for i, fault in enumerate(faults) if fault.place == place}


def uncovered(faults: Sequence[Fault]) -> list[str]:
    """Returns the names of the faults under which no certificate holds."""
    return [type(fault).__name__ for fault in faults if fault.assumption() is not None]
