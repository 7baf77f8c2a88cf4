"""Faults of a scenario: what fails, when, and which of them the theory covers.

A fault of the solver, `COVERED`, costs a plan, and the last one goes on, which the proofs allow.
The others take away what the proofs start from: a measurement, an actuator, the bound d̃; with one
of them a scenario has no certificate. The systems that stand in the loop are in `fault_systems`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from uvms_drake.common.errors import require, within


@dataclass
class _AtSamples:
    """A fault at random sampling instants of the MPC."""

    probability: float = 1.0
    """Of a sampling instant in the time of the fault."""
    start: float = 0.0
    """First instant [s]; the first plan of a run is exempt, for without it nothing moves."""
    duration: float | None = None
    """[s]; for ever if it is left out."""


@dataclass
class SolverFailure(_AtSamples):
    """The solver of the MPC finds no plan."""


@dataclass
class SolverTimeout(_AtSamples):
    """The plan of the MPC comes too late and is thrown away."""


@dataclass
class DroppedPeriod(_AtSamples):
    """The MPC does not run at a sampling instant."""


@dataclass
class _OfSensor:
    """A fault of what measures the state."""

    start: float = 0.0
    """[s]."""
    duration: float = 0.5
    """[s]."""


@dataclass
class FrozenState(_OfSensor):
    """The measured state stays what it was at `start`."""


@dataclass
class LostState(_OfSensor):
    """The measured state is not a number."""

    start: float = 1.0
    """[s]; above 0, for the first plan starts at the measured state."""


@dataclass
class StuckJoint:
    """A brake, a stiff spring with a damper, holds a joint about where it was at `start`."""

    joint: int = 0
    """Index of the joint, from 0."""
    start: float = 0.0
    """[s]."""


@dataclass
class ExcessDisturbance:
    """The disturbance that is simulated is larger than its bound d̃, in which all else believes."""

    factor: float = 2.0
    """By how much."""


SolverFault = SolverFailure | SolverTimeout | DroppedPeriod
SensorFault = FrozenState | LostState
Fault = SolverFault | SensorFault | StuckJoint | ExcessDisturbance

COVERED = (SolverFailure, SolverTimeout, DroppedPeriod)
"""Faults under which the certificate holds."""

_ALLOWED: dict[str, tuple[Callable[[Any], bool], str]] = {
    "probability": (lambda value: 0.0 <= value <= 1.0, "between 0 and 1"),
    "start": (lambda value: 0.0 <= value < np.inf, "zero or positive"),
    "duration": (lambda value: value is None or 0.0 < value < np.inf, "positive"),
    "joint": (lambda value: value >= 0, "an index from 0"),
    "factor": (lambda value: 1.0 < value < np.inf, "above 1"),
}
"""Which values a fault may have, by the name of its field."""


def check_faults(faults: Sequence[Fault], *, kinematic: bool) -> None:
    """Raises `InvalidParameter` for the first fault that has no meaning.

    Args:
        faults: Of a scenario.
        kinematic: Whether the velocity is the input, so that no torque holds a joint.
    """
    for i, fault in enumerate(faults):
        key, kind = f"faults[{i}]", type(fault).__name__
        with within(key):
            if isinstance(fault, LostState):
                require(fault.start > 0.0, "start", fault.start,
                        "above 0: the first plan needs a measured state")
            for name in (field.name for field in fields(fault)):
                holds, allowed = _ALLOWED[name]
                require(holds(getattr(fault, name)), name, getattr(fault, name), allowed)
        require(type(fault) not in map(type, faults[:i]), key, kind,
                "of a kind that is not declared twice")
        require(not (kinematic and isinstance(fault, StuckJoint)), key, kind,
                "left out, if the motion is kinematic")


def uncovered(faults: Sequence[Fault]) -> list[str]:
    """Returns the names of the faults under which no certificate holds."""
    return [type(fault).__name__ for fault in faults if not isinstance(fault, COVERED)]


def excess(faults: Sequence[Fault]) -> float:
    """Returns by how much the simulated disturbance is larger than its bound; 1 without a fault."""
    return next((fault.factor for fault in faults if isinstance(fault, ExcessDisturbance)), 1.0)


def is_active(start: float, duration: float | None, time: float) -> bool:
    """Returns whether `time` [s] is in [start, start + duration)."""
    return start <= time and (duration is None or time < start + duration)
