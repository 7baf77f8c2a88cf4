"""Events outside of the assumptions, one a run, each with the guarantees that remain.

No exception may be raised and every number stays finite; each exit of a bound is in the log with
its time. Where there is a bound along the run (the law `resolved`, and kinematic motion) and the
measurement is right, it is proportional to d̃: under a disturbance of at most D, whatever it comes
from (model errors are one too), the deviation stays within max(1, D/d̃) times its bound. This
assumes that the law's command is applied; a run with a saturated command has no guarantee.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from uvms_drake.actuation.joint_brake import StuckJoint
from uvms_drake.campaign.model_uncertainty import DrawnErrors
from uvms_drake.model.signals.sensor_actuator import Fault
from uvms_drake.plant.disturbance import ExcessDisturbance
from uvms_drake.plant.waves import Wave
from uvms_drake.sensing.faulty_sensor import FrozenState, LostState
from uvms_drake.station.scenario.scenario import Scenario

FAULT_SECONDS = 0.5
EARLIEST, LATEST = 0.1, 0.7
"""Range of the onset of a fault, over the duration of a run after the first plan."""
SHIFT, TURN, CURRENT = 0.02, 0.05, 0.3
"""Largest error of the surface's pose [m, rad], and largest current [m/s]."""
TRIM, PAYLOAD = 0.02, 0.5
"""Largest relative error of the buoyancy, and largest mass in the hand [kg]."""
WAVE, WAVE_PERIODS = 0.25, (4.0, 10.0)
"""Largest amplitude of a wave, 2.5 m above the robot [m], and shortest and longest period [s]."""
STIFFER = 10.0
"""Stiffness of the surface over that of the controller's model."""
EXCESS_FACTORS = (1.5, 2.0, 5.0)
"""Sizes of the disturbance over d̃."""

FROZEN, LOST, STUCK, WAVES = "state frozen", "state lost", "joint stuck", "waves"
MEASURED_WRONG = (FROZEN, LOST)
"""Kinds with a wrong feedback signal, for which the tube does not scale."""
_EXCESSES = {f"d of {factor:g} bounds": factor for factor in EXCESS_FACTORS}


def _misplaced(largest: float, rng: np.random.Generator) -> DrawnErrors:
    shift, turn = SHIFT * rng.uniform(-1.0, 1.0, 3), TURN * rng.uniform(-1.0, 1.0, 3)
    return DrawnErrors(shift=shift, turn=turn)


def _wrong_model(largest: float, rng: np.random.Generator) -> DrawnErrors:
    return DrawnErrors(*(largest * rng.uniform(-1.0, 1.0, 4)).tolist())


def _payload_and_trim(largest: float, rng: np.random.Generator) -> DrawnErrors:
    return DrawnErrors(buoyancy=TRIM * rng.uniform(-1.0, 1.0), payload=PAYLOAD * rng.uniform())


def _current(largest: float, rng: np.random.Generator) -> DrawnErrors:
    direction = rng.normal(size=3)
    return DrawnErrors(current=CURRENT * rng.uniform() * direction / np.linalg.norm(direction))


_ERRORS: dict[str, Callable[[float, np.random.Generator], DrawnErrors]] = {
    f"surface {STIFFER:g} x stiffer": lambda largest, rng: DrawnErrors(stiffness=STIFFER - 1.0),
    "surface misplaced": _misplaced, "model wrong": _wrong_model,
    "payload, trim": _payload_and_trim, "current": _current}
"""Draws of a kind's errors, by the largest relative one of "model wrong"."""


def kinds_outside(*, has_forces: bool, num_joints: int) -> tuple[str, ...]:
    """Returns the kinds of event that apply to a motion, with or without forces, of a robot."""
    with_forces = (*([STUCK] if num_joints else []), *_ERRORS, WAVES) if has_forces else ()
    return (*MEASURED_WRONG, *_EXCESSES, *with_forces)


def step_outside(kind: str, scenario: Scenario, largest: float, rng: np.random.Generator
                 ) -> Scenario:
    """Returns the scenario with one of `kinds_outside` in it.

    Args:
        kind: Kind of event.
        scenario: Scenario inside of the bounds.
        largest: Largest relative error of "model wrong".
        rng: Random generator of onset and size.
    """
    if kind in _ERRORS:
        return _ERRORS[kind](largest, rng).put_into(scenario)
    if kind == WAVES:
        return replace(scenario, waves=[*scenario.waves, _wave(rng)])
    fault = _fault(kind, len(scenario.start.q), scenario.mpc.hover, scenario.duration, rng)
    return replace(scenario, faults=[*scenario.faults, fault])


def _wave(rng: np.random.Generator) -> Wave:
    direction, phase = rng.uniform(-np.pi, np.pi, 2).tolist()
    return Wave(WAVE * rng.uniform(), rng.uniform(*WAVE_PERIODS), direction, phase)


def _fault(kind: str, num_joints: int, first_plan: float, end: float, rng: np.random.Generator
           ) -> Fault:
    """Returns a fault that begins between the first plan and the end of a run [s]."""
    if kind in _EXCESSES:
        return ExcessDisturbance(_EXCESSES[kind])
    joint = int(rng.integers(num_joints)) if kind == STUCK else 0
    onset = first_plan + float(rng.uniform(EARLIEST, LATEST)) * (end - first_plan)
    faults: dict[str, Fault] = {
        FROZEN: FrozenState(onset, FAULT_SECONDS), LOST: LostState(onset, FAULT_SECONDS),
        STUCK: StuckJoint(joint, onset)}
    return faults[kind]
