"""The BlueROV2's press behind its thrusters, by the coupled linear loop: changes, and their sums.

`python examples/results/bluerov2_real_loop.py > examples/results/bluerov2_real_loop.md` computes
for each change of `bluerov2_real_loop` the slowest decay at the task and at the drawn postures of
the certificate, the same with 1.5 times the delay of the thrusters, and the sums by chance of
sensors and start over what the limits leave. No run and no plan is in them. A few minutes.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from make_all import provenance
from uvms_drake.certificate.coupled.budget import (
    CHANCE,
    MARGIN,
    STABLE_AT,
    STAGES,
    START,
    drawn_postures,
    later_part,
    limits_left,
    start_rows,
)
from uvms_drake.certificate.coupled.loop_at_task import loop_parts, press_configuration
from uvms_drake.tube.coupled.budget import Source, by_chance, quantile, radii_of, sources_of
from uvms_drake.tube.coupled.coupled_loop import (
    CoupledLoop,
    LoopParts,
    Wall,
    coupled_loop,
    operating_point,
)
from uvms_drake.tube.coupled.periodic import STEP

import uvms_drake as uv
from uvms_drake.actuation.thrusters import Thrusters
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.sensor_actuator import Actuator
from uvms_drake.station.contact.bounds import depth_left
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import Scenario

NAME = "bluerov2_real_loop"
FASTER = ("ancillary.tip={k: 10.0, sigma: 5.0, observer: 1.3}",
          "ancillary.vehicle={k: 2.0, sigma: 1.0, observer: 0.8}", "mpc.hover=4.0")
"""Former gains and hover: a faster decay where nothing slips and nothing is later."""
FAST_FILTER = ("contact.tangential_lag=0.4",)
FAST = ("actuation.1.dead_time=0.05",)
PRECISE = ("sensing.0.dvl.noise=[0.00085, 0.00085, 0.00085]",)
CHANGES: dict[str, tuple[str, ...]] = {
    "faster gains, a hover of 4 s, a filter of 0.4 s": (*FASTER, *FAST_FILTER),
    "these, and a dead time of 0.05 s of the thrusters": (*FASTER, *FAST_FILTER, *FAST),
    "faster gains, a hover of 4 s": FASTER,
    "a filter of 0.4 s": FAST_FILTER,
    "as it is": (),
    "half the noise of the DVL": PRECISE}
"""Settings of each change, beside those of the scenario."""
COLUMNS = ("change", "decay at the task", "slipping, at drawn postures", "with more delay",
           "depth", "joints", "joint rates", "roll", "pitch", "ν₂")
HEAD = """# The BlueROV2's press on real actuators and sensors, by its coupled linear loop

{provenance} Command: `python examples/results/bluerov2_real_loop.py`.

Decay rates are in 1/s; below zero the loop is unstable. At the task it is the slowest of open water
and of the stiffest wall of the class, stuck and slipping; at {postures} drawn postures that of a
tip that slips; *more delay* is {margin:g} times the mean delay of the thrusters, at the task. The
other columns are sums by chance, but for {chance:g} in a run, over what the limits leave: noise of
the sensors at the task and the start of a run, the larger of open water and walls. **No plan is in
them**: what is left to 1 is the plan's. Depth leaves what the class of walls does; joints are the
norm over the distance to the nearest end. A change that is unstable at a posture has no sums. The
start has the declared mass and current alone, from one side; sums are at one phase of the period.
Margins of the gains are not computed.

{rows}
"""
"""Beginning of the page."""


class Found(NamedTuple):
    """Figures of a change."""

    decay: float
    """Slowest decay rate at the task [1/s]."""
    drawn: float
    """The same of a tip that slips, at drawn postures."""
    later: float
    """The same at the task, with `MARGIN` times the delay of the thrusters."""
    used: dict[str, float]
    """Sums over what limits leave, by column; empty if unstable."""


def found_of(scenario: Scenario, model: ContactModel) -> Found:
    """Returns the figures of a scenario."""
    parts, config = loop_parts(scenario, model), press_configuration(scenario.task, model)
    walls = scenario.contact.linear_walls(scenario.task.force)
    loops = loops_at(parts, config, walls)
    slipping = [wall for wall in walls if wall.slope > 0.0]
    drawn = min(slowest(loops_at(parts, each, slipping))
                for each in postures(scenario, model, config))
    later = slowest(loops_at(replace(parts, actuation=delayed(parts)), config, walls))
    now = slowest(loops)
    return Found(now, drawn, later,
                 sums(scenario, model, loops) if min(now, drawn) > 0.0 else {})


def loops_at(parts: LoopParts, config: np.ndarray, walls: Sequence[Wall]) -> list[CoupledLoop]:
    """Returns the loop on each wall."""
    return [coupled_loop(parts, operating_point(parts, config, wall), wall) for wall in walls]


def slowest(loops: Sequence[CoupledLoop]) -> float:
    """Returns the slowest decay rate [1/s]."""
    return min(float(loop.system.decay[0]) for loop in loops)


def postures(scenario: Scenario, model: ContactModel, config: np.ndarray) -> list[np.ndarray]:
    """Returns the drawn postures of the certificate's coupled budget."""
    return drawn_postures(scenario.limits, model, config,
                          np.random.default_rng(scenario.certificate.seed))


def delayed(parts: LoopParts) -> list[Actuator]:
    """Returns the actuation with `MARGIN` times the mean delay of the thrusters."""
    mean, _ = parts.command_path.mean_delays
    return [later_part(part, (MARGIN - 1.0) * mean, parts) if isinstance(part, Thrusters) else part
            for part in parts.actuation]


def sums(scenario: Scenario, model: ContactModel, loops: Sequence[CoupledLoop]
         ) -> dict[str, float]:
    """Returns the sums by chance of sensors and start over what limits leave."""
    rows, limits = loops[0].rows, scenario.limits
    q = quantile(STAGES * len(rows), scenario.duration / STEP, CHANCE)
    # The estimates that observers have to find, of the declared mass and current.
    starts = {block: np.abs(value) for block, value in loops[0].loop.starts.items()}
    total = np.max([by_chance((
        *sources_of([(loop.system, loop.channels)], q, phases=1),
        Source(START, start_rows([loop], starts, scenario.mpc.hover), np.zeros(len(rows)), False),
    ), q) for loop in loops], axis=0)
    radii = radii_of(rows, total)
    # The tip's position takes of the depth that is left.
    fitted = replace(scenario, tube=replace(
        scenario.tube, depth=radii["depth"], position=radii["position"]))
    left = limits_left(limits, depth_left(fitted), scenario.task.posture, model)
    over = {row: total[rows.index(row)] / left[row] for row in ("depth", "roll", "pitch")}
    nearest = min(left[f"q{j + 1}"] for j in range(model.num_joints))
    return {"depth": over["depth"], "joints": radii["joints"] / nearest,
            "joint rates": radii["qdot"] / limits.qdot,
            "roll": over["roll"], "pitch": over["pitch"], "ν₂": radii["nu2"] / limits.nu2}


def row_of(name: str, found: Found) -> str:
    """Returns a row of the table."""
    rates = [f"{rate:.3f}" for rate in (found.decay, found.drawn, found.later)]
    used = [f"{found.used[key]:.2f}" if found.used else "–" for key in COLUMNS[4:]]
    return f"| {' | '.join((name, *rates, *used))} |"


def reading(found: dict[str, Found]) -> str:
    """Returns the sentences on the table."""
    faster, _, slower, quick, as_it_is, _ = found.values()

    def stable(each: Found) -> str:
        return "stable" if min(each[:3]) > 0.0 else "unstable"

    most = max(as_it_is.used, key=lambda key: as_it_is.used[key]) if as_it_is.used else "decay"
    return f"""\
* **With faster gains and a fast filter** of the force across the normal the loop is
  {stable(faster)} at some posture or delay of the table, with faster gains alone {stable(slower)},
  with the fast filter alone {stable(quick)}.
* **As it is** it is {stable(as_it_is)}, with more delay at {as_it_is.later:.3f} 1/s. The line that
  leaves least to a plan is then: {most}.
* Its plans, budget and drawn runs are in [its certificate](probability_bluerov2.md)."""


def main() -> None:
    """Prints the page."""
    model = load_model(uv.load_scenario(NAME))
    found = {name: found_of(uv.load_scenario(NAME, list(options)), model)
             for name, options in CHANGES.items()}
    print(HEAD.format(
        provenance=provenance(), postures=STABLE_AT, margin=MARGIN, chance=CHANCE,
        rows="\n".join((f"| {' | '.join(COLUMNS)} |", "|---" * len(COLUMNS) + "|",
                        *(row_of(name, each) for name, each in found.items())))))
    print(reading(found))


if __name__ == "__main__":
    main()
