"""Events outside of the class of `girona500_real_loop`, with its supervisor, one run each.

`python examples/results/outside.py > examples/results/outside.md` takes half an hour on a core. The
tip starts 0.09 m off the wall and touches it after 16 s, so that an event at 22 s is one in
contact.
"""

import argparse
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np
from make_all import provenance

import uvms_drake as uv
from uvms_drake.control.feedback.ancillary import AncillaryFeedback
from uvms_drake.control.laws.law import Command
from uvms_drake.control.mpc.planner import Planner
from uvms_drake.model.description.robot_files import model_dir
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.record import Record

BASE = "girona500_real_loop"
NEAR = "start.eta.0=-1.15"
"""The tip 0.09 m off the wall."""
TOUCH, IN_CONTACT = 16.0, 22.0
"""Times of the touch and of an event in contact [s]."""
CUT = "{cut}"
"""Stands for the folder of a robot that can cut the power of each thruster."""
HEAD = """# Outside of the class

{provenance} Command: `python examples/results/outside.py`.

`{base}`, one run for each event until 6 s after it, 12 s after a current, the tip 0.09 m off at the
start; one of 22 s is in contact. *Above* is the time with more than the declared {limit:g} N, *off*
the largest distance of the vehicle from the way of its retreat, 0.3 m straight back from where it
was at the trip, *beyond* that of a joint beyond its range [rad], *q̇* the largest norm of the joint
rates [rad/s]. *Detected* is the cause and its time after the event, for a wall after the touch;
*off wall* the time from there to the last contact, *end* the distance that the vehicle goes in the
last second.

**Bold** misses its target. Asked are at most 25 N, for no longer than 0 s more than the declared
force, no joint beyond its range, and q̇ of 1.1 times `limits.qdot`, {qdot:g} rad/s, at most (the
motors are rated for 0.3 and 0.5 rad/s each); walls: off it within 0.5 s; waves: 0.35 m;
currents: 1.4 m, and 0.05 m/s at the end; a thruster whose power is cut: 0.05 m; no fix: 20 N and
0.15 m; a law that fails: 20 N, detected within 0.3 s; a planner: within the horizon of its plan. A
thruster that sticks and cannot be cut is not held, and one that alone drives an axis is not cut.

| event | peak [N] | above [s] | off [m] | beyond | q̇ | detected | off wall [s] | end [m/s] |
|---|---|---|---|---|---|---|---|---|
"""
FOOT = """
Why targets are missed: 20.5 N are those of the press of 20 N before the event. A wave at the start
moves two joints against their stops before the trip, up to which nothing but the law holds them,
and with a state that is missing, or a law at random, the filter of the joints predicts wrongly. A
current towards the wall, or a thruster that pushes, drives the vehicle on until the observer has
seen it; where its power cannot be cut, nothing is held. Without fixes the vehicle drifts with the
error of the last velocity.
"""


class Event(NamedTuple):
    """Event of a run."""

    overrides: tuple[str, ...] = ()
    """Overrides of the scenario."""
    start: float | None = None
    """Its instant [s]; None: the first touch."""
    patch: Callable[[], Any] | None = None
    """Makes a context manager, within which the program itself fails."""
    peak: float = 25.0
    """Largest force that is asked for [N]; so are the next ones."""
    off: float = np.inf
    """Distance [m]."""
    within: float = np.inf
    """Time until the detection [s]."""
    leaves: float = np.inf
    """Time from there until it is off the wall [s]."""
    end: float = np.inf
    """Speed at the end [m/s]."""
    seconds: float = 6.0
    """Time from the event to the end of the run [s]."""

    @property
    def duration(self) -> float:
        """Duration of the run [s]."""
        return self.seconds + (TOUCH if self.start is None else self.start)


@contextmanager
def failing_law(start: float, command: Callable[[np.random.Generator, int], np.ndarray]
                ) -> Iterator[None]:
    """Replaces the command of the law from a time on [s], not that of the retreat."""
    before, rng = AncillaryFeedback._of_law, np.random.default_rng(0)

    def changed(self: AncillaryFeedback, context: Any, now: Any) -> Command:
        wanted = before(self, context, now)
        if context.get_time() < start:
            return wanted
        u = command(rng, wanted.u.size)
        return Command(u, wanted.M @ u, wanted.M)

    with mock.patch.object(AncillaryFeedback, "_of_law", changed):
        yield


def raises(*_: Any) -> np.ndarray:
    """Raises an exception."""
    raise ZeroDivisionError


def not_finite(_: Any, size: int) -> np.ndarray:
    """Returns an acceleration that is not finite."""
    return np.full(size, np.nan)


def at_random(rng: np.random.Generator, size: int) -> np.ndarray:
    """Returns random accelerations, as large as the vehicle's and the joints' limits."""
    return rng.uniform(-1.0, 1.0, size) * np.repeat([1.0, 60.0], [6, size - 6])


@contextmanager
def failing_planner(start: float) -> Iterator[None]:
    """Lets the planner raise an exception at every sample from a time on [s]."""
    again = Planner.again

    def changed(self: Planner, sample: Any, memory: Any) -> Any:
        if sample.time > start:
            raise ZeroDivisionError
        return again(self, sample, memory)

    with mock.patch.object(Planner, "again", changed):
        yield


def flow(velocity: str, start: float, period: str = "null") -> tuple[str, ...]:
    """Returns the overrides for a flow that nobody has declared."""
    return (f"faults=[!UnknownFlow {{velocity: {velocity}, period: {period}, start: {start}}}]",)


def fault(text: str, *more: str) -> tuple[str, ...]:
    """Returns the overrides for a fault."""
    return (f"faults=[{text}]", *more)


AT = IN_CONTACT
EVENTS = {  # Flows come on top of the declared current of 0.1 m/s across.
    **{f"wall {times} ×": Event((f"surface.law.stiffness={700.0 * times:g}",), leaves=0.5)
       for times in (5, 20, 100)},
    "wall 20 × at the largest speed": Event(("surface.law.stiffness=14000",
                                   "mpc.weight_y.0=60000", "mpc.weight_zeta.0=0.01"), leaves=0.5),
    "wave 0.2 m/s, 6 s, from the start": Event(flow("[0.2,0,0]", 0.0, "6.0"), 0.0, off=0.35),
    "the same from 22 s, along x": Event(flow("[0.2,0,0]", AT, "6.0"), AT, off=0.35),
    "the same from 22 s, along y": Event(flow("[0,0.2,0]", AT, "6.0"), AT, off=0.35),
    "current 0.5 m/s across, from the start": Event(flow("[0,0.4,0]", 0.0), 0.0, off=1.4,
                                                    end=0.05, seconds=18.0),
    "the same from 22 s": Event(flow("[0,0.4,0]", AT), AT, off=1.4, end=0.05,
                                 seconds=12.0),
    "current 0.5 m/s at the wall, from 22 s": Event(flow("[0.5,0,0]", AT), AT, off=1.4,
                                                     end=0.05, seconds=12.0),
    "surge thruster stuck at half, power cut": Event(fault(
        f"!StuckThruster {{thruster: surge_port, share: 0.5, start: {AT}}}", f"model={CUT}"), AT,
        off=0.05),
    "the same, no power cut": Event(fault(
        f"!StuckThruster {{thruster: surge_port, share: 0.5, start: {AT}}}"), AT),
    "surge thruster dead": Event(fault(f"!LostThruster {{thruster: surge_port, start: {AT}}}"), AT),
    "the same, power cut": Event(fault(
        f"!LostThruster {{thruster: surge_port, start: {AT}}}", f"model={CUT}"), AT, off=0.05),
    "sway thruster stuck at half, power cut": Event(fault(
        f"!StuckThruster {{thruster: sway, share: 0.5, start: {AT}}}", f"model={CUT}"), AT),
    "DVL without a fix for 5 s": Event(fault(f"!LostFixes {{start: {AT}, duration: 5}}"), AT,
                                       peak=20.0, off=0.15),
    "no state any more": Event(fault(f"!LostState {{start: {AT}, duration: 99}}"), AT),
    "no state for 2 s": Event(fault(f"!LostState {{start: {AT}, duration: 2}}"), AT),
    "force sensor frozen": Event(fault(f"!FrozenForce {{start: {AT}, duration: 99}}"), AT),
    "force sensor dead": Event(fault(f"!LostForce {{start: {AT}, duration: 99}}"), AT),
    "law raises": Event((), AT, lambda: failing_law(AT, raises), 20.0, within=0.3),
    "law is not finite": Event((), AT, lambda: failing_law(AT, not_finite), 20.0, within=0.3),
    "law is random": Event((), AT, lambda: failing_law(AT, at_random), 20.0, within=0.3),
    "planner raises for ever": Event((), AT, lambda: failing_planner(AT), within=3.0),
    "none": Event((), AT),
}


def marked(text: str, met: bool) -> str:
    """Returns a cell, bold if its target is missed."""
    return text if met else f"**{text}**"


def row_of(name: str, event: Event, record: Record) -> str:
    """Returns the row of a run."""
    model, contact = record.model, sensed_contact(record.scenario)
    force = record.force[:, :3] @ np.asarray(contact.direction)
    touched = record.time[force > 1.0]
    start = event.start if event.start is not None else float(touched[0]) if len(touched) else 0.0
    q, rates = record.config[:, 6:], np.linalg.norm(record.zeta[:, 6:], axis=1)
    beyond = float(max(np.max(q - model.q_upper), np.max(model.q_lower - q)))
    safety = record.summary()["safety"]
    after = record.time >= min(record.trip, record.time[-1])
    way = record.config[after, :3] - record.config[after, :3][0]
    back = -np.asarray(contact.direction)
    off = way - np.clip(way @ back, 0.0, record.scenario.supervisor.distance)[:, None] * back
    above = np.sum(force > contact.force) * record.scenario.log_period
    distance, speed = np.max(np.linalg.norm(off, axis=1)), np.max(rates)
    cells = [marked(f"{np.max(force):.1f}", np.max(force) <= event.peak),
             marked(f"{above:.2g}", above == 0.0),
             marked(f"{distance:.3f}", distance <= event.off),
             marked("–" if beyond <= 0.0 else f"{beyond:.2g}", beyond <= 0.0),
             marked(f"{speed:.2f}", speed <= 1.1 * record.scenario.limits.qdot)]
    cells += [marked("no", name == "none"), "–"] if safety["retreated_s"] is None else [
        marked(f"{safety['retreated_s'] - start:+.2f} s ({safety['cause']})",
               safety["retreated_s"] - start <= event.within),
        marked(f"{safety['off_wall_s']:.2f}" if safety["off_wall"] else "never",
               safety["off_wall"] and safety["off_wall_s"] <= event.leaves)]
    last = record.config[record.time > record.time[-1] - 1.0, :3]
    end = np.linalg.norm(np.ptp(last, axis=0))
    cells.append(marked(f"{end:.3f}", end <= event.end))
    early = f" (ended at {record.time[-1]:.1f} s)" if record.time[-1] < event.duration - 0.1 else ""
    return f"| {name}{early} | {' | '.join(cells)} |"


def main() -> None:
    """Prints the page; with `--only TEXT` the rows of the events with it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="part of the names of the events")
    parser.add_argument("--set", nargs="*", default=[], help="further overrides")
    chosen = parser.parse_args()
    shipped = uv.load_scenario(BASE)
    print(HEAD.format(provenance=provenance(), base=BASE, qdot=shipped.limits.qdot,
                      limit=sensed_contact(shipped).force), end="")
    with tempfile.TemporaryDirectory() as folder:
        source = model_dir(shipped.model)
        robot = Path(shutil.copytree(source, Path(folder) / source.name))
        thrusters = robot / "thrusters.yaml"
        thrusters.write_text("power_cut: true\n" + thrusters.read_text("utf-8"), "utf-8")
        for name, event in EVENTS.items():
            if chosen.only not in name:
                continue
            print(name, file=sys.stderr)
            overrides = [each.replace(CUT, str(robot)) for each in event.overrides]
            scenario = uv.load_scenario(
                BASE, [f"duration={event.duration}", NEAR, *overrides, *chosen.set])
            with (event.patch or (lambda: mock.patch.dict({})))():
                record = uv.simulate(scenario)
            print(row_of(name, event, record), flush=True)
            print(record.summary()["safety"].get("text", ""), file=sys.stderr)
    print(FOOT, end="")


if __name__ == "__main__":
    main()
