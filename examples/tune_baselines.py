"""Scale of the force gain of each baseline, by the same objective, walls and budget for all.

`python examples/tune_baselines.py --robot girona500_arm5e` multiplies the gain from force to motion
by each of `SCALES` and presses on walls of 300, 1000 and 3000 N/m, which no case of the benchmark
has, with the robot's thrusters and another seed. The objective is the rms of the force's error over
the last 3 s plus a fifth of the overshoot [N]. The best scale has to keep a margin of two: with the
doubled gain no run on a wall of 5000 N/m may end early or stay unsettled. Five minutes a law.
"""

import argparse
from collections.abc import Callable

import numpy as np

from uvms_drake.baselines.baseline import BASELINES, make_baseline
from uvms_drake.baselines.gains import RobotGains, read_gains
from uvms_drake.benchmark.cases import ROBOTS, Case, drawn_case
from uvms_drake.benchmark.controllers import press_task
from uvms_drake.benchmark.loop import run_loop
from uvms_drake.benchmark.metrics import measure
from uvms_drake.station.problem import load_model

SCALES = (0.25, 0.5, 1.0, 2.0, 4.0)
WALLS = (300.0, 1000.0, 3000.0)
"""Stiffness of the walls for the objective [N/m]."""
STIFFEST = 5000.0
"""Stiffness at which the margin has to be there [N/m]."""
SEED = 977


def scaled(gains: RobotGains, law: str, scale: float) -> RobotGains:
    """Multiplies the gains from force to motion of a law, and returns all."""
    section = {"impedance": gains.impedance, "admittance": gains.admittance,
               "sliding_decoupled": gains.decoupled, "sliding_coupled": gains.coupled}.get(
                   law, gains.performance)
    for name in ("integral", "force", "force_gain"):
        of_servo = law == "admittance" and name == "integral"
        of_funnel = section is gains.performance and name == "force"
        if hasattr(section, name) and not of_servo and not of_funnel:
            setattr(section, name, scale * getattr(section, name))
    return gains


def pressed(robot: str, law: str, scale: float, stiffness: float) -> dict[str, float | None]:
    """Returns the figures of merit of a press with a scaled gain."""
    nominal = drawn_case(robot, Case("", ""), SEED, 0)[0].surface.law.stiffness
    case = Case("", "", (f"surface_error.stiffness={stiffness / nominal}",), further=6.0)
    scenario, events = drawn_case(robot, case, SEED, 0)
    model, gains = load_model(scenario), scaled(read_gains(robot), law, scale)
    controller = make_baseline(model, press_task(scenario), BASELINES[law](gains), gains)
    found = measure(scenario, model, run_loop(scenario, model, controller, events))
    return {**found, "desired": float(scenario.task.force[0])}


def objective(press: Callable[[float], dict[str, float | None]]) -> float:
    """Returns the mean objective over the walls [N]; infinite if a run ended early."""
    total = 0.0
    for stiffness in WALLS:
        found = press(stiffness)
        if found["force_rms"] is None:
            return np.inf
        total += found["force_rms"] + 0.2 * max(found["peak"] - found["desired"], 0.0)
    return total / len(WALLS)


def main() -> None:
    """Prints the objective of each scale, and whether it keeps the margin."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", choices=ROBOTS, default=next(iter(ROBOTS)))
    parser.add_argument("--laws", choices=BASELINES, nargs="+", default=list(BASELINES))
    parser.add_argument("--scales", type=float, nargs="+", default=SCALES)
    args = parser.parse_args()
    for law in args.laws:
        for scale in args.scales:
            value = objective(lambda wall, law=law, scale=scale: pressed(
                args.robot, law, scale, wall))
            settled = pressed(args.robot, law, 2.0 * scale, STIFFEST)["settling"] is not None
            print(f"{law:<32}{scale:>6.2f}{value:>10.3g} N{'' if settled else '  no margin'}",
                  flush=True)


if __name__ == "__main__":
    main()
