"""Cases of the benchmark: difficulties, as overrides of a shipped scenario, and the draws.

A case is the same for all controllers: surface, water, sensors, actuators, faults and start. All
but one are of the robot as it is, with thrusters, a clock, navigation and a wrong model: every
baseline has one set of gains. In `ideal` the wrench is exact and the loop continuous.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from uvms_drake.benchmark.press import Course
from uvms_drake.common.errors import require
from uvms_drake.common.keyed_random import generator_of
from uvms_drake.common.schema import read_yaml
from uvms_drake.station.scenario.scenario import Scenario, load_scenario

STREAM = 41
"""Key of the random numbers of the benchmark."""
START = (0.02, 0.02, 0.02)
"""Largest drawn offsets of the start: position [m], attitude [rad], joints [rad]."""
STIFFNESS = 0.1
"""Largest drawn relative change of the stiffness."""
LAG = (0.05, 0.15)
"""Range of the drawn lag of the thrusters [s]."""
INTEGRATOR = ("simulator.integration_scheme=runge_kutta2", "simulator.max_step_size=0.005")
"""Step of the integrator [s]: the clocks of sensors and thrusters stop it there anyhow. Against the
third order in steps of 1 ms, force and peak on a wall 20 times stiffer are within 0.2 %."""
FILLED = ("payload", "impulse", "latest", "thruster", "hard")
"""Fields of a robot that stand in overrides."""
AFTER = 8.0
"""Time from the touch to the end of a run [s]."""


@dataclass(frozen=True)
class BenchRobot:
    """Scenarios of a robot, and sizes that depend on it."""

    scenario: str
    """The robot as it is."""
    ideal: str
    """With an ideal wrench and exact states."""
    start: Sequence[float]
    """x of the vehicle at the start of either [m], at which the wall is near."""
    latest: float
    """Instant at which a run without a touch ends, and of an event outside of the class [s]: all
    controllers press there."""
    impulse: float
    """Acceleration in sway of the impulse [m/s²]."""
    spread: float
    """Factor of the drawn offsets of the start: an MPC needs a plan from it."""
    payload: float
    """Mass of a dense ball in the hand [kg]: 20 % of the weight that has to be held."""
    thruster: str
    """Name of the thruster that fails."""
    hard: float
    """A hundred times the stiffness of the scenario's wall [N/m]."""


_DATA: Any = read_yaml(Path(__file__).with_name("cases.yaml"))
ROBOTS = {name: BenchRobot(**fields) for name, fields in _DATA["robots"].items()}
"""Robots of the benchmark."""


@dataclass(frozen=True)
class Case:
    """A difficulty of the benchmark."""

    name: str
    text: str
    """Description of the difficulty, in a table."""
    overrides: Sequence[str] = ()
    """Overrides of the robot's scenario, `key.path=value`; `{payload}`, `{impulse}`, `{latest}`,
    `{thruster}` and `{hard}` are the robot's."""
    ideal: bool = False
    """Whether the scenario is the robot's `ideal` one."""
    outside: bool = False
    """Whether wall, water or robot are outside of the class that is declared to the MPCs."""
    lasting: float = 0.0
    """Time of a run after its event [s]; zero without one."""
    further: float = 0.0
    """Further time of a run, after the touch [s]."""
    slide: Sequence[float] = (0.0, 0.0, 0.0)
    """Displacement of the place in contact (3,) [m]."""


CASES = {name: Case(name, **fields) for name, fields in _DATA["cases"].items()}
"""Cases by name."""


def drawn_case(robot: str, case: Case, seed: int, index: int) -> tuple[Scenario, Course]:
    """Returns scenario and course of a run, a function of its arguments and not of the controller.

    Args:
        robot: Name of the robot.
        case: The case.
        seed: Seed of the benchmark.
        index: Number of the draw, the same start, noise and lag in all cases.
    """
    require(robot in ROBOTS, "--robots", robot, f"of {', '.join(ROBOTS)}")
    bench = ROBOTS[robot]
    draw = generator_of(seed, (STREAM, index))
    unit, stiffness, lag, noise = (
        bench.spread * draw.uniform(-1.0, 1.0, 10), draw.uniform(-1.0, 1.0), draw.uniform(*LAG),
        int(draw.integers(2**31)))
    overrides = [*INTEGRATOR] + [functools.reduce(lambda done, key: done.replace(
        f"{{{key}}}", str(getattr(bench, key))), FILLED, text) for text in case.overrides]
    after = AFTER + case.further
    overrides += [f"seed={noise}", f"duration={bench.latest + max(after, case.lasting)}"]
    if not case.ideal:
        overrides.append(f"actuation.1.lag={lag}")
    scenario = load_scenario(bench.ideal if case.ideal else bench.scenario, overrides)
    eta = np.array(scenario.start.eta, dtype=float)
    eta[0] = bench.start[case.ideal]
    eta += np.repeat(START[:2], 3) * unit[:6]
    q = np.asarray(scenario.start.q, dtype=float)
    q = q + START[2] * unit[6: 6 + len(q)]
    error = scenario.surface_error
    scenario = replace(
        scenario, start=replace(scenario.start, eta=eta, q=q),
        surface_error=replace(error, stiffness=error.stiffness * (1.0 + STIFFNESS * stiffness)))
    event = bench.latest if case.lasting else None
    return scenario, Course(bench.latest, after, np.array(case.slide), event, case.lasting)
