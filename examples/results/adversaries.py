"""Attacks on the claims of certificates, all of the declared class: found over claimed.

`python examples/results/adversaries.py` has two parts, of some minutes for each scenario. Random
attacks are on every claim, with everything drawn at once: `random_attacks`. An adversary in a hold
is on the certified band alone: each scenario is simulated until its plan stands, with a tare that
is off by all of the sensor's noise, and goes on from there many times: sensor errors, the
disturbance and the wall are of the declared class, and what did best is varied. A wall has the
largest slope, tilt, damping and friction, or hardens at the force of the hold; a second hold
follows a change of the desired force.
"""

import argparse
import sys
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import random_attacks
from hold_station import Attack, GrippingSurface, Held, HoldStation, noisy
from make_all import provenance

import uvms_drake as uv
from uvms_drake.certificate.certify import certified_once
from uvms_drake.common.wiring import release
from uvms_drake.mission.steps import Mission
from uvms_drake.model.surface.contact_laws import Bilinear, Linear
from uvms_drake.model.surface.geometry import Plane
from uvms_drake.plant.disturbance import unit_vector
from uvms_drake.report.contact_check import force_bands
from uvms_drake.station.contact.bounds import pressing_force, sensed_contact
from uvms_drake.station.problem import load_model

RUNS = {"girona500_contact": (48, 2.6), "bluerov2_contact": (8, 2.0),
        "girona500_tip_first": (8, 2.6), "girona500_stiff": (4, 2.0),
        "jacket_inspection": (8, 2.6)}
"""Number of runs of each scenario, and their duration [s]."""
ACROSS = 0.8
"""Part of the noise across n that is not drawn; a sensor without noise is taken for frozen."""
SOFTLY = 1.2
"""Force of the second hold over the largest error of a reading, from which on a touch is one."""
NEAR = 1.02
"""Distance of a wall from the tip's start over the least one."""
WALLS = {"stiffest": (1.0, 1.0), "softer": (0.7, 1.0), "hardening": (0.5, 2.0)}
"""Slope of the wall over the largest, and the ratio by which it grows at the force of the hold."""


@dataclass
class Plan:
    """Parameters of an attack, drawn at random."""

    swing: float = 0.0
    """Amplitude of a slow change of the readings that the MPC takes, over the noise's bound."""
    others: str = "same"
    """Readings between those: the same, the opposite, a square wave, or by the loop's kernel."""
    across: np.ndarray = field(default_factory=lambda: np.zeros(6))
    """Noise of the other components."""
    push: str = "kernel"
    """Disturbance: by the loop's kernel, a square wave, a sinusoid, or constant."""
    polarity: float = 1.0
    """Sign of the disturbance."""
    direction: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Direction of the disturbance; empty: the one that moves the tip most along n."""
    grip: float = np.inf
    """Time at which friction begins to turn, as fast as it may [s]."""
    periods: np.ndarray = field(default_factory=lambda: np.ones(3))
    """Periods of the change, of the readings and of the disturbance [s]."""
    phases: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """Their phases [rad]."""

    @staticmethod
    def drawn(rng: np.random.Generator, size: int) -> "Plan":
        """Returns random parameters."""
        return Plan(
            float(rng.choice([0.0, 0.1, 0.3, 1.0])),
            str(rng.choice(["same", "opposite", "square", "kernel"])),
            rng.choice([-1.0, 0.0, 1.0], 6) * rng.integers(2),
            str(rng.choice(["kernel", "kernel", "square", "sinusoid", "constant"])),
            float(rng.choice([1.0, 1.0, -1.0])),
            rng.normal(size=size) if rng.uniform() < 0.2 else np.zeros(0),
            float(rng.choice([np.inf, 0.0, 0.1, 0.3, 1.0, 1.5])),
            np.exp(rng.uniform(np.log(0.1), np.log(4.0), 3)), rng.uniform(0.0, 2.0 * np.pi, 3))

    def varied(self, rng: np.random.Generator, size: int) -> "Plan":
        """Returns it with one or two parameters drawn again."""
        other = vars(Plan.drawn(rng, size))
        names = rng.choice(list(other), rng.integers(1, 3), replace=False)
        return replace(self, **{name: other[name] for name in names})


class Outcome(NamedTuple):
    """Largest error over the band, in the hold."""

    ratio: float
    """The ratio; 0 if the plan never stood."""
    error: float
    """Error there [N]."""
    bound: float
    """Band there [N]."""
    stood: float
    """Share of the run in which the plan had stood."""
    departures: tuple[str, ...]
    """Bounds of the class that the run has left."""


class Adversary:
    """Attacks on a hold of a station.

    Args:
        loop: The station.
        held: The hold.
    """

    def __init__(self, loop: HoldStation, held: Held):
        self._loop, self._held = loop, held
        config = held.logs["state"][-1, : loop.model.size]
        normal = loop.contact.direction @ loop.model.kinematics(config).J_chi[:3]
        self._steepest = unit_vector(
            loop.scenario.disturbance.relative_weights(loop.model.size) * normal, loop.model.size)
        self._time = np.arange(round(loop.duration * loop.sensor.rate)) / loop.sensor.rate
        step = loop.scenario.mpc.time_step
        begin = held.context.get_time()
        ahead = (-(self._time + begin)) % step * loop.sensor.rate
        self._planned = (ahead > 0.5) & (ahead < 3.5)  # The samples of which a plan is made.
        # Responses of the force to steps, of which the kernels are the differences.
        rows = np.zeros((loop.intervals, loop.model.size))
        constant = self._noise(np.ones(len(self._time)))
        still = loop.run(held, Attack(constant, rows))
        pushed = loop.run(held, Attack(constant, rows + self._steepest))
        misread = loop.run(held, Attack(self._noise(np.where(self._planned, 1.0, -1.0)), rows))
        self._kernels = [self._kernel(pushed, still), self._kernel(misread, still)]

    def _noise(self, along: np.ndarray) -> np.ndarray:
        """Returns noise (samples, 6) along n, by the sign of the constant error, and drawn one."""
        return np.array([noisy(index, self._loop.along, self._loop.sign * size)
                         for index, size in enumerate(along)])

    def _kernel(self, record: uv.Record, still: uv.Record) -> np.ndarray:
        """Returns the sign of the step response's difference, backwards in time (intervals,)."""
        begin, n = self._held.context.get_time(), self._loop.contact.direction
        ends = begin + self._loop.interval * np.arange(self._loop.intervals + 1)
        response = np.interp(ends, record.time, (record.force - still.force)[:, :3] @ n)
        return np.sign(np.diff(response))[::-1]

    def attack(self, plan: Plan) -> Attack:
        """Returns the errors of a plan."""
        loop, t = self._loop, self._time
        wave = [np.sin(2.0 * np.pi * t / period + phase)
                for period, phase in zip(plan.periods, plan.phases, strict=True)]
        level = 1.0 - plan.swing * (1.0 + wave[0])
        index = np.minimum((t / loop.interval).astype(int), loop.intervals - 1)
        by_kernel = self._kernels[1][index]  # Of a change from 1 to -1, that lowers the force.
        others = {"same": level, "opposite": -level, "square": np.sign(wave[1]),
                  "kernel": by_kernel}[plan.others]
        noise = self._noise(np.where(self._planned, level, others))
        across = np.where(loop.along == 0.0, ACROSS * plan.across, 0.0)
        noise = (1.0 - np.abs(across)) * noise + np.multiply.outer(np.sign(wave[1]), across)
        time = loop.interval * np.arange(loop.intervals)
        wave_d = np.sin(2.0 * np.pi * time / plan.periods[2] + plan.phases[2])
        size = {"kernel": self._kernels[0], "square": np.sign(wave_d), "sinusoid": wave_d,
                "constant": np.ones(loop.intervals)}[plan.push]
        direction = (self._steepest if len(plan.direction) == 0
                     else unit_vector(plan.direction, loop.model.size))
        return Attack(noise, np.multiply.outer(-loop.sign * plan.polarity * size, direction),
                      plan.grip)

    def outcome(self, plan: Plan) -> Outcome:
        """Returns the largest error over the band of a run."""
        record = self._loop.run(self._held, self.attack(plan))
        return outcome_of(record, self._held.context.get_time())


def outcome_of(record: uv.Record, begin: float) -> Outcome:
    """Returns the largest error over the band of a record in its hold from a time on [s]."""
    found = force_bands(record)
    left = uv.summarise(record)["contact"]["out_of_class"]
    left = tuple(key for key in left if key != "clearance")  # That of the start, which is before.
    holds = found.holds & (record.time >= begin)
    if not np.any(holds):
        return Outcome(0.0, 0.0, np.inf, 0.0, left)
    ratio = np.where(holds, np.abs(found.error) / found.bound, 0.0)
    at = int(np.argmax(ratio))
    return Outcome(float(ratio[at]), float(found.error[at]), float(found.bound[at]),
                   float(np.mean(holds[record.time >= begin])), left)


class Worst(NamedTuple):
    """Worst run on a hold."""

    wall: str
    """Name of the wall."""
    force: float
    """Desired force [N]."""
    runs: int
    """Number of runs."""
    outside: int
    """Number of those that left the class."""
    outcome: Outcome
    """The worst of the others."""
    plan: Plan
    """Its parameters."""


def search(adversary: Adversary, size: int, runs: int, rng: np.random.Generator
           ) -> tuple[Outcome, Plan, int]:
    """Returns the worst outcome in the class, its parameters, and how many runs were not in it."""
    best, plan, outside = Outcome(0.0, 0.0, np.inf, 0.0, ()), Plan(), 0
    for i in range(runs):
        tried = Plan(grip=0.1) if i == 0 else (
            Plan.drawn(rng, size) if i <= runs // 3 else plan.varied(rng, size))
        found = adversary.outcome(tried)
        outside += len(found.departures) > 0
        if not found.departures and found.ratio > best.ratio:
            best, plan = found, tried
    return best, plan, outside


def on_wall(scenario: uv.Scenario, name: str, sign: float) -> uv.Scenario:
    """Returns the scenario with a plane at the corner of its class, as near as it may be.

    Its friction is against the sign of the constant error along n; as it turns, it is along.
    """
    contact, shipped = sensed_contact(scenario), scenario.surface
    share, ratio = WALLS[name]
    n, _, across = contact.walls.axes
    cosine, sine = np.cos(contact.angle), np.sin(contact.angle)
    stiffness, w = share * contact.stiffness, shipped.law.transition
    law = Linear(stiffness, w) if ratio == 1.0 else Bilinear(
        stiffness, w, ratio, pressing_force(scenario) / stiffness)
    tip = load_model(scenario).task_pose(np.append(scenario.start.eta, scenario.start.q))[:3]
    return replace(scenario, surface=GrippingSurface(
        Plane(tip + NEAR * contact.clearance * n, -cosine * n + sine * across), law,
        contact.dissipation, (1.0 - 1e-6) * contact.friction,
        tangent=sign * (sine * n + cosine * across)))


def attacked(name: str, runs: int, duration: float, seed: int) -> list[Worst]:
    """Returns the worst runs, of a duration [s], on each wall and hold of a scenario."""
    scenario = uv.load_scenario(name)
    certificate = certified_once(scenario)
    if not certificate.certified:
        raise SystemExit(f"{name}: {certificate.failed}")
    # Of a mission: one of its holds, under the certificate of the whole.
    scenario = replace(certificate.applied_to(scenario), mission=Mission())
    rng = np.random.default_rng(seed)
    found, walls = [], list(WALLS) if runs >= 40 else list(WALLS)[:1]
    each = max(runs // (2 * len(walls)), 1)
    for i, wall in enumerate(walls):
        sign = (-1.0) ** (i + 1)
        loop = HoldStation(on_wall(scenario, wall, sign), sign, duration)
        held = loop.first_hold()
        other = SOFTLY * loop.contact.force_error
        holds = {pressing_force(scenario): held, other: loop.next_hold(held, other)}
        for force, hold in holds.items():
            best, plan, outside = search(Adversary(loop, hold), loop.model.size, each, rng)
            found.append(Worst(wall, force, each, outside, best, plan))
            print(f"{name}: {found[-1]}", file=sys.stderr, flush=True)
        release(loop.station)
    return found


CHANGED = """Since the page before, the first table is new, and a press takes the mean of its
readings: the bands in a hold are wider."""


AXES = """## By axis

`girona500_contact_uncertain` with errors of the coefficients of the vehicle, or of the arm's links,
by axis in place of its current and mass: 3 % of added mass and 30 % of linear and quadratic drag.
In each run one coefficient along one axis is off by its bound, to either side, and all else is
drawn as above.
First the largest acceleration by it over that claimed of the coefficient along all axes, then the
largest of all other ratios but of the limits and the whole disturbance.
"""


def main() -> None:
    """Prints the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    names = list(dict.fromkeys([*random_attacks.RUNS, *RUNS]))
    parser.add_argument("scenarios", nargs="*", default=names)
    parser.add_argument("--runs", type=int, help="runs of each scenario, in each part")
    parser.add_argument("--seed", type=int, default=1, help="seed of the search")
    arguments = parser.parse_args()
    if unknown := set(arguments.scenarios) - set(names):
        parser.error(f"scenarios: {', '.join(sorted(unknown))}; must be of {', '.join(names)}")
    command = " ".join(("python examples/results/adversaries.py", *sys.argv[1:]))
    found = {name: random_attacks.attacks(name, arguments.runs or runs, duration, arguments.seed)
             for name, (runs, duration) in random_attacks.RUNS.items()
             if name in arguments.scenarios}
    print("# Attacks on the claims\n\n"
          f"{provenance()} Command: `{command}`.\n\n{CHANGED}\n\n"
          "## Random attacks\n\n"
          f"The largest found over claimed of each claim. {random_attacks.__doc__.split('.', 1)[1]}"
          f"\n{random_attacks.table(found)}\n")
    by_axis = {body: found[name] for name, body in random_attacks.BY_AXIS.items() if name in found}
    if by_axis:
        print(AXES)
    for body, runs in by_axis.items():
        print(f"{random_attacks.axis_table(body, runs)}\n")
    print("## An adversary in a hold\n\n"
          "Largest |n·𝐅 − F| over the certified band of a hold that an adversary of the declared "
          "class found: sensor errors\nat their bounds, a disturbance of the full size, walls with "
          "the largest slope, tilt, damping and friction. A second hold\nis that after a change of "
          "the desired force. The band is that of the instant: a plan that is short of its target "
          "has a wider one. Runs that left\nthe class (friction that turns too fast) do not count."
          "\n\n| scenario | wall | F [N] | runs, of the class | error [N] | band [N] | ratio "
          "|\n|---|---|---|---|---|---|---|")
    for name, (runs, duration) in RUNS.items():
        for row in attacked(name, arguments.runs or runs, duration, arguments.seed) if (
                name in arguments.scenarios) else ():
            outcome = row.outcome
            print(f"| `{name}` | {row.wall} | {row.force:g} | {row.runs}, {row.runs - row.outside} "
                  f"| {outcome.error:.2f} | {outcome.bound:.2f} | {outcome.ratio:.2f} |",
                  flush=True)


if __name__ == "__main__":
    main()
