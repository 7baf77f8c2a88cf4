"""Certified force bands of the scenarios with an unknown wall, in motion and in a hold.

`python examples/results/holds.py > examples/results/holds.md` certifies each scenario, half a
minute to some minutes each, and attacks the bands by random steps of the desired force: on walls at
the corner of the class, with the largest constant error of the readings.
"""

import argparse
from dataclasses import replace

import numpy as np
from adversaries import on_wall
from hold_station import HoldStation
from make_all import provenance

import uvms_drake as uv
from uvms_drake.certificate.certificate import Certificate
from uvms_drake.certificate.certify import certified_once
from uvms_drake.common.wiring import release
from uvms_drake.mission.steps import Mission
from uvms_drake.report.contact_check import summarise_bands
from uvms_drake.station.contact.bounds import largest_force, pressing_force, sensed_contact
from uvms_drake.station.simulation import make_record
from uvms_drake.tube.ultimate_bounds import HOLD, LIKELY

SCENARIOS = ("girona500_contact", "jacket_inspection", "bluerov2_contact", "girona500_stiff",
             "girona500_tip_first", "girona500_inspection", "bluerov2_cp_probe",
             "girona500_unknown_floor")
ATTACKED = {"girona500_contact": ("stiffest", "softer")}
"""Walls of `adversaries.WALLS` for each attacked scenario."""
DURATION = 30.0
"""Duration of an attack, from the first hold on [s]."""
APART = (0.5, 8.0)
"""Shortest and longest time between two steps of the force [s]."""
SOFTLY = 1.2
"""Least desired force over the largest error of a reading, from which on a touch is one."""


def certified(name: str) -> tuple[uv.Scenario, Certificate]:
    """Returns a scenario and its certificate; exits if that does not hold."""
    scenario = uv.load_scenario(name)
    certificate = certified_once(scenario)
    if not certificate.certified:
        raise SystemExit(f"{name}: {certificate.failed}")
    return scenario, certificate


def row_of(name: str) -> str:
    """Returns the row of a scenario."""
    scenario, certificate = certified(name)
    bounds, arrival, hold = certificate.bounds, certificate.arrival, certificate.tube.hold
    slow = sensed_contact(scenario).hold
    declared = "–" if slow is None else f"{slow.force_rate:g}, {slow.force_ripple:g}"
    begins = "–" if np.isinf(arrival.hold) else f"{arrival.hold - arrival.touch:.2g}"
    return (f"| `{name}` | {pressing_force(scenario):g} | {bounds['force']:.3g} | "
            f"{bounds[HOLD]:.3g} | {hold.time:.2g} | {bounds[LIKELY]:.3g} | {declared} | "
            f"{1e3 * arrival.speed:.3g} | {arrival.touch:.3g}, {arrival.target:.3g} | {begins} |")


def attacked(name: str, wall: str, seed: int) -> str:
    """Returns the row of a run with random steps of the desired force, on a wall."""
    scenario, certificate = certified(name)
    scenario = replace(certificate.applied_to(scenario), mission=Mission())
    loop = HoldStation(on_wall(scenario, wall, 1.0), 1.0, DURATION)
    rng = np.random.default_rng(seed)
    begin, steps = loop.first_hold().context.get_time(), 0
    context = loop.simulator.get_mutable_context()
    while (now := context.get_time()) < begin + DURATION:
        force = rng.uniform(SOFTLY * loop.contact.force_error, largest_force(scenario))
        loop.station.GetInputPort("desired_force").FixValue(context, loop.contact.wrench(force))
        loop.simulator.AdvanceTo(now + rng.uniform(*APART))
        steps += 1
    logs = uv.read_logs(loop.station, context)
    record = make_record(loop.scenario, loop.model, logs, 1.0, certified=True)
    release(loop.station)
    bands = summarise_bands(record)["force_bands"]
    left = uv.summarise(record)["contact"]["out_of_class"]
    found = " | ".join("– | –" if row is None else
                       f"{row['worst_ratio']:.2f} | {100.0 * row['share']:.0f} %"
                       for row in (bands["motion"], bands["hold"]))
    return f"| `{name}` | {wall} | {steps} | {found} | {', '.join(left) or 'none'} |"


def main() -> None:
    """Prints the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS)
    parser.add_argument("--seed", type=int, default=1, help="seed of the steps")
    args = parser.parse_args()
    print("# Force bands in motion and in a hold\n\n"
          f"{provenance()} Command: `python examples/results/holds.py`.\n\n"
          "Bands are for a plan at its target, which `deepest` does not clip: in motion at any "
          "speed within the limits, and in a hold\nafter so long at no more than 2 mm/s, 2 mrad/s "
          "and joints 10 mrad/s. *Likely* takes the noise of the tare for independent,\nand is not "
          "certified. Friction is the declared rate and ripple of a hold, those of any motion "
          "where there is none. Approach,\ntouch and target are those of the nominal loop, and "
          "*after the touch* is when its hold is in force.\n\n"
          "Since the page before, the declared error of a reading of `girona500_contact` is 4.25 N "
          "(with 4.2 N its certificate did not\nhold: the tip's speed across the direction was "
          "left out between two readings), and *likely* counts the rounding of a tare in\nfull, as "
          "its samples may all be rounded alike.\n\n"
          "| scenario | F [N] | in motion [N] | in a hold [N] | from [s] | likely [N] "
          "| friction [N/s, N] | approach [mm/s] | touch, target [s] | after the touch [s] |\n"
          "|---|---|---|---|---|---|---|---|---|---|")
    for name in args.scenarios:
        print(row_of(name), flush=True)
    print(f"\nRandom steps of the desired force, {APART[0]:g} to {APART[1]:g} s apart, on walls at "
          f"the corner of the class, with the largest constant error of the readings (seed "
          f"{args.seed}): largest error over the band\nof its "
          "instant, and share of the run, in motion and in a hold; bounds of the class that the "
          "run has left.\n\n"
          "| scenario | wall | steps | in motion | share | in a hold | share | left |\n"
          "|---|---|---|---|---|---|---|---|")
    for name, walls in ATTACKED.items():
        if name in args.scenarios:
            for wall in walls:
                print(attacked(name, wall, args.seed), flush=True)


if __name__ == "__main__":
    main()
