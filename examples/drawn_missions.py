"""Random missions: wall, place, line, current and, mostly, a fault are drawn.

The vehicle is that of `jacket_inspection_real`, specified for walls within 10 degrees of a
direction, up to 1000 N/m, with friction up to 0.5. Drawn are a plate, a leg or bumps of 5 mm,
within 10 degrees, 150 to 990 N/m, friction up to 0.45; one wall in ten is beyond the search
distance of the mission. Each mission has to end, without more force than is allowed.
"""

import argparse
from collections import Counter

import numpy as np

import uvms_drake as uv

FAULTS = ("!LostForce {{start: {0}, duration: 2.0}}", "!FrozenForce {{start: {0}, duration: 2.0}}",
          "!SolverFailure {{start: {0}, duration: 2.0}}", "!LostState {{start: {0}}}")
"""Faults with their start [s], during the hold or the slide if the wall is within reach."""
SHAPES = ("!Plane {{point: {0}, normal: {1}}}",
          "!Cylinder {{point: {0}, normal: {1}, axis: {2}, radius: 0.6}}",
          "!Bumpy {{point: {0}, normal: {1}, axis: {2}, amplitude: 0.0025, wavelength: 0.15}}")


def drawn(number: int, duration: float) -> uv.Scenario:
    """Returns a random mission at one place."""
    rng = np.random.default_rng([17, number])
    lean, turn = rng.uniform(-0.08, 0.08, 2)
    normal = np.array([-np.cos(lean) * np.cos(turn), np.sin(turn), np.sin(lean) * np.cos(turn)])
    axis = np.cross(normal, [0.0, 1.0, 0.0])
    base = uv.load_scenario("jacket_inspection_real")
    start = np.asarray(base.start.eta) + np.append(rng.uniform(-0.05, 0.05, 3), np.zeros(3))
    tip = uv.load_model(base).task_pose(np.append(start, base.start.q))[:3]
    at = (tip[[2, 1]] * [1.0, -1.0] + rng.uniform(-0.02, 0.02, 2)).tolist()
    along = rng.uniform(0.03, 0.05) * np.array([np.cos(w := rng.uniform(0.0, 6.28)), np.sin(w)])
    distance = rng.choice([rng.uniform(0.03, 0.06), 0.3], p=[0.9, 0.1])
    shape = SHAPES[rng.integers(len(SHAPES))].format(
        (tip + [distance, 0.0, 0.0]).tolist(), normal.tolist(),
        (axis / np.linalg.norm(axis)).tolist())
    fault = FAULTS[rng.integers(len(FAULTS))].format(rng.uniform(6.0, 16.0))
    return uv.load_scenario("jacket_inspection_real", [
        f"seed={number}", f"start.eta={start.tolist()}", f"surface.geometry={shape}",
        f"surface.law.stiffness={np.exp(rng.uniform(*np.log([150.0, 990.0])))}",
        f"surface.friction={rng.uniform(0.0, 0.45)}", "surface.creep=0.025",
        "simulator.max_step_size=0.01", f"current={rng.uniform(-0.07, 0.07, 3).tolist()}",
        f"faults=[{fault if rng.uniform() < 0.8 else ''}]", f"duration={duration}",
        "mission.retries=0",
        f"mission.steps=[!Approach {{at: {at}, within: 0.2, timeout: 20.0, settle: 0.5}}, "
        "!Hold {seconds: 1.0, timeout: 3.0}, "
        f"!Slide {{along: {along.tolist()}, timeout: 5.0}}, !Retreat {{timeout: 5.0}}]"])


def main() -> None:
    """Prints a line for each mission."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--missions", type=int, default=2, help="number of missions; a minute each")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--duration", type=float, default=34.0, help="longest simulated time [s]")
    arguments = parser.parse_args()
    print(f"{'':>3}  {'surface':<10}{'N/m':>5}{'friction':>10}  {'fault':<16}{'at s':>5}"
          f"{'largest N':>11}{'allowed':>9}  mission")
    outcomes, shares = Counter[str](), []
    for number in range(arguments.first, arguments.first + arguments.missions):
        scenario = drawn(number, arguments.duration)
        record = uv.simulate(scenario)
        mission, surface = record.summary()["mission"], scenario.surface
        fault = scenario.faults[0] if scenario.faults else None
        most = np.max(surface.static_force(record.chi))
        failed = [f"{row['kind']}: {row['ended']}" for row in mission["steps"]
                  if row["ended"] != "done"]
        print(f"{number:>3}  {type(surface.geometry).__name__:<10}{surface.law.stiffness:5.0f}"
              f"{surface.friction:10.2f}  {type(fault).__name__ if fault else 'none':<16}"
              f"{fault.start if fault else np.nan:5.1f}{most:11.2f}"
              f"{scenario.contact.force:9.2f}  {'; '.join([mission['outcome'], *failed])}",
              flush=True)
        outcomes[mission["outcome"]] += 1
        shares.append(most / scenario.contact.force)
    counts = ", ".join(f"{n} {outcome}" for outcome, n in outcomes.items())
    print(f"{len(shares)} missions: {counts}; at most {max(shares):.2f} of the allowed force")


if __name__ == "__main__":
    main()
