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
from uvms_drake.campaign.model_uncertainty import Unknowns
from uvms_drake.model.signals.sensor_actuator import Fault
from uvms_drake.plant.disturbance import ExcessDisturbance
from uvms_drake.plant.waves import Wave
from uvms_drake.sensing.faulty_sensor import FrozenState, LostState
from uvms_drake.station.motions.motions import motion_of
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

Step = Callable[[Scenario, float, np.random.Generator], Scenario]


def _faulty(fault: Fault) -> Callable[[Scenario], Scenario]:
    return lambda scenario: replace(scenario, faults=[*scenario.faults, fault])


def _frozen(scenario: Scenario, largest: float, rng: np.random.Generator) -> Scenario:
    return _faulty(FrozenState(_instant(scenario, rng), FAULT_SECONDS))(scenario)


def _lost(scenario: Scenario, largest: float, rng: np.random.Generator) -> Scenario:
    return _faulty(LostState(_instant(scenario, rng), FAULT_SECONDS))(scenario)


def _stuck(scenario: Scenario, largest: float, rng: np.random.Generator) -> Scenario:
    joint = int(rng.integers(len(scenario.start.q)))
    return _faulty(StuckJoint(joint, _instant(scenario, rng)))(scenario)


def _excess(factor: float) -> Step:
    return lambda scenario, largest, rng: _faulty(ExcessDisturbance(factor))(scenario)


def _stiffer(scenario: Scenario, largest: float, rng: np.random.Generator) -> Scenario:
    return Unknowns(stiffness=STIFFER - 1.0).put_into(scenario)


def _misplaced(scenario: Scenario, largest: float, rng: np.random.Generator) -> Scenario:
    return Unknowns(shift=SHIFT * rng.uniform(-1.0, 1.0, 3), turn=TURN * rng.uniform(-1.0, 1.0, 3)
                    ).put_into(scenario)


def _model(scenario: Scenario, largest: float, rng: np.random.Generator) -> Scenario:
    return Unknowns(*(largest * rng.uniform(-1.0, 1.0, 4)).tolist()).put_into(scenario)


def _current(scenario: Scenario, largest: float, rng: np.random.Generator) -> Scenario:
    direction = rng.normal(size=3)
    return Unknowns(current=CURRENT * rng.uniform() * direction / np.linalg.norm(direction)
                    ).put_into(scenario)


def _payload_and_trim(scenario: Scenario, largest: float, rng: np.random.Generator) -> Scenario:
    return Unknowns(buoyancy=TRIM * rng.uniform(-1.0, 1.0), payload=PAYLOAD * rng.uniform()
                    ).put_into(scenario)


def _waves(scenario: Scenario, largest: float, rng: np.random.Generator) -> Scenario:
    direction, phase = rng.uniform(-np.pi, np.pi, 2).tolist()
    wave = Wave(WAVE * rng.uniform(), rng.uniform(*WAVE_PERIODS), direction, phase)
    return replace(scenario, waves=[*scenario.waves, wave])


def _instant(scenario: Scenario, rng: np.random.Generator) -> float:
    hover = scenario.mpc.hover
    return hover + float(rng.uniform(EARLIEST, LATEST)) * (scenario.duration - hover)


STUCK = "joint stuck"
MEASURED_WRONG = ("state frozen", "state lost")
"""Kinds with a wrong feedback signal, for which the tube does not scale."""

_ALL_MOTIONS: dict[str, Step] = {
    "state frozen": _frozen, "state lost": _lost,
    **{f"d of {factor:g} bounds": _excess(factor) for factor in EXCESS_FACTORS}}
_WITH_FORCES: dict[str, Step] = {
    STUCK: _stuck, f"surface {STIFFER:g} x stiffer": _stiffer,
    "surface misplaced": _misplaced, "model wrong": _model, "payload, trim": _payload_and_trim,
    "current": _current, "waves": _waves}


def kinds_outside(scenario: Scenario) -> tuple[str, ...]:
    """Returns the kinds of event that apply to a scenario."""
    with_forces = _WITH_FORCES if motion_of(scenario).has_forces else ()
    return (*_ALL_MOTIONS, *(kind for kind in with_forces
                             if kind != STUCK or np.size(scenario.start.q) > 0))


def step_outside(kind: str, scenario: Scenario, largest: float, rng: np.random.Generator
                 ) -> Scenario:
    """Returns the scenario with one of `kinds_outside` in it.

    Args:
        kind: Kind of event.
        scenario: Scenario inside of the bounds.
        largest: Largest relative error of "model wrong".
        rng: Random generator of onset and size.
    """
    return (_ALL_MOTIONS | _WITH_FORCES)[kind](scenario, largest, rng)
