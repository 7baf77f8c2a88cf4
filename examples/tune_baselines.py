"""Scale of the force gain of each law, by the same objective, walls and budget for all.

`python examples/tune_baselines.py --robot girona500_arm5e` multiplies the gain from force to
motion, or the rates of the observer of a nominal MPC, by each of `SCALES`, and presses on walls of
300, 1000 and 3000 N/m, of no case of the benchmark, with the robot's thrusters and another seed.
The objective is the rms of the force's error over the last 3 s plus a fifth of the overshoot [N],
infinite for a run that fails or does not touch. From the best scale on, the first with a margin of
two is taken: on a wall of 5000 N/m its rms is below a quarter of the desired force, and that of the
doubled gain at most twice as large. Without such a scale the gain stays. A minute a law.
"""

import argparse
from dataclasses import replace

import numpy as np

from uvms_drake.baselines.baseline import BASELINES, ObserverGains, RobotGains, read_gains
from uvms_drake.benchmark.cases import ROBOTS, Case, drawn_case
from uvms_drake.benchmark.controllers import OFFSET_FREE, controller_with_gains
from uvms_drake.benchmark.press import measure, run_press
from uvms_drake.station.problem import load_model

SCALES = (0.5, 1.0, 2.0)
WALLS = (300.0, 1000.0, 3000.0)
"""Stiffness of the walls for the objective [N/m]."""
STIFFEST = 5000.0
"""Stiffness at which the margin has to be there [N/m]."""
SEED = 977
LAWS = (*(name for name in BASELINES if name != "prescribed_performance"), OFFSET_FREE)
"""Laws with gains of their own: those of the prescribed performance are tuned with gravity."""


def scaled(gains: RobotGains, law: str, scale: float) -> RobotGains:
    """Returns the gains with those from force to motion of a law multiplied."""
    if law == OFFSET_FREE:
        rates = gains.offset_free
        return replace(gains, offset_free=ObserverGains(scale * rates.vehicle, scale * rates.tip))
    section, keys = {
        "impedance": ("impedance", ["integral"]), "admittance": ("admittance", ["force"]),
        "sliding_decoupled": ("decoupled", ["force", "integral"]),
        "sliding_coupled": ("coupled", ["force", "integral"])}.get(
            law, ("performance", ["force_gain"]))
    own = getattr(gains, section)
    return replace(gains, **{section: replace(own, **{
        key: scale * getattr(own, key) for key in keys})})


def cost(robot: str, law: str, scale: float, stiffness: float) -> tuple[float, float]:
    """Returns rms of the force's error and overshoot of a press [N], infinite if it fails."""
    nominal = drawn_case(robot, Case("", ""), SEED, 0)[0].surface.law.stiffness
    case = Case("", "", (f"surface_error.stiffness={stiffness / nominal}",))
    scenario, course = drawn_case(robot, case, SEED, 0)
    model = load_model(scenario)
    controller = controller_with_gains(
        law, scenario, model, scaled(read_gains(robot), law, scale))
    found = measure(scenario, model, run_press(scenario, model, controller, course))
    if found["force_rms"] is None:
        return np.inf, np.inf
    return found["force_rms"], max(found["peak"] - float(scenario.task.force[0]), 0.0)


def objective(robot: str, law: str, scale: float) -> float:
    """Returns the mean objective over the walls [N]."""
    return float(np.mean([rms + 0.2 * over for rms, over in (
        cost(robot, law, scale, wall) for wall in WALLS)]))


def main() -> None:
    """Prints the objective of each scale, and the best with its margin."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robot", choices=ROBOTS, default=next(iter(ROBOTS)))
    parser.add_argument("--laws", choices=LAWS, nargs="+", default=LAWS)
    parser.add_argument("--scales", type=float, nargs="+", default=SCALES)
    args = parser.parse_args()
    desired = float(drawn_case(args.robot, Case("", ""), SEED, 0)[0].task.force[0])
    for law in args.laws:
        found = {scale: objective(args.robot, law, scale) for scale in args.scales}
        print(f"{args.robot}, {law}: " + ", ".join(
            f"x{scale:g} {value:.3g} N" for scale, value in found.items()), flush=True)
        for scale in sorted(found, key=lambda scale: found[scale]):
            single, double = (cost(args.robot, law, gain, STIFFEST)[0]
                              for gain in (scale, 2.0 * scale))
            kept = double <= 2.0 * single and single < 0.25 * desired
            print(f"  x{scale:g} at {STIFFEST:g} N/m: {single:.3g} N, doubled {double:.3g} N"
                  f"{'' if kept else ': no margin'}", flush=True)
            if kept:
                break


if __name__ == "__main__":
    main()
