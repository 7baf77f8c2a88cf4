"""Force error during slides: along a leg, over bumps, across a weld.

The vehicle is that of `jacket_inspection_real`: thrusters with lag, 50 Hz, a navigation, a current,
an unknown surface; it starts nearby, for a short approach. The error is that of the real force
along the declared direction, from the desired force of that instant.
"""

import argparse

import numpy as np

import uvms_drake as uv

PLACE = "!Approach {at: [-0.096, 0.065]}, !Hold {seconds: 3.0}"
LEANS = "normal: [-0.9975641, 0.0, 0.0697565]"
"""Normal of a surface that leans by 4 degrees."""
JOBS = {
    "leg": ("!Cylinder {point: [-0.27, 0.0, 0.0], axis: [0.0697565, 0.0, 0.9975641], radius: 0.75, "
            f"{LEANS}}}",
            "!Slide {along: [0.5, 0.0], speed: 0.02}, !Slide {along: [-0.5, 0.0], speed: 0.037}, "
            "!Slide {along: [0.3, 0.0], speed: 0.015, amplitude: 2.0, frequency: 0.1}, "
            "!Slide {along: [-0.25, 0.0], speed: 0.005, amplitude: 2.0, frequency: 0.02}"),
    "bumps of 5 mm": (
        f"!Bumpy {{point: [-0.27, 0.0, 0.0], {LEANS}, axis: [0.0, 1.0, 0.0], amplitude: 0.0025, "
        "wavelength: 0.1}",
        "!Slide {along: [0.3, 0.0], speed: 0.02}"),
    "weld of 3 mm": (
        f"!Bead {{point: [-0.27, 0.0, 0.0], {LEANS}, axis: [0.0, 1.0, 0.0], height: 0.003, "
        "width: 0.03}", "!Slide {along: [0.2, 0.0], speed: 0.02}")}
"""Geometry and slides of each surface."""


def main() -> None:
    """Prints a line for each slide of every job."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=140.0, help="longest simulated time [s]")
    parser.add_argument("--job", choices=JOBS, action="append", help="all if it is left out")
    arguments = parser.parse_args()
    print(f"{'':<15}{'m':>6}{'mm/s':>7}{'N':>6}{'+- N':>6}{'Hz':>6}{'rms N':>8}{'worst':>7}"
          f"{'+- 2 N %':>10}{'off mm':>8}{'behind mm':>11}")
    for job in arguments.job or JOBS:
        geometry, slides = JOBS[job]
        scenario = uv.load_scenario("jacket_inspection_real", [
            f"duration={arguments.duration}", f"surface.geometry={geometry}",
            f"mission.steps=[{PLACE}, {slides}, !Retreat {{}}]"])
        mission = scenario.mission
        over = 30.0 + sum(step.least_time for step in mission.steps
                          if isinstance(step, uv.mission.Slide))
        scenario.duration = min(arguments.duration, over)
        for row in uv.simulate(scenario).summary()["mission"]["steps"]:
            step = mission.steps[row["step"]]
            if isinstance(step, uv.mission.Slide):
                length = np.linalg.norm(step.along)
                print(f"{job:<15}{length:6.2f}{1e3 * step.speed:7.0f}{step.force:6.1f}"
                      f"{step.amplitude:6.1f}{step.frequency:6.2f}{row['force_rms']:8.2f}"
                      f"{row['force_worst']:7.2f}{100.0 * row['within']:10.1f}"
                      f"{1e3 * row['off_worst']:8.2f}{1e3 * row['behind']:11.1f}  {row['ended']}",
                      flush=True)


if __name__ == "__main__":
    main()
