"""Thrusters that lag, on two laws: one holds the tip with the vehicle, the other with the arm.

The law `resolved` keeps the arm's angles and asks the vehicle to hold the tip. It does so too late:
beyond a lag of (k + sigma)/(k sigma), 0.25 s here, the loop swings up. The law `tip first` takes
what the thrusters give now as it is, and holds the tip with the arm whatever that is.
"""

import argparse
from dataclasses import replace

import numpy as np

import uvms_drake as uv
from uvms_drake.actuation.thrusters import Thrusters
from uvms_drake.control.laws import Resolved, TipFirst


def main() -> None:
    """Presses on the wall with each law."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=8.0, help="simulated time [s]")
    parser.add_argument("--lag", type=float, default=0.3, help="of the thrusters [s]")
    arguments = parser.parse_args()
    scenario = uv.load_scenario("girona500_ideal", [f"duration={arguments.duration}"])
    scenario.actuation = [Thrusters(period=0.02, lag=arguments.lag, dead_time=0.0)]
    # There are five thrusters: roll is left to weight and buoyancy.
    for law in (Resolved(k=20.0, sigma=5.0), TipFirst(undriven=["roll"])):
        record = uv.simulate(replace(scenario, ancillary=law))
        vehicle = np.linalg.norm(record.state[:, :3] - record.nominal_state[:, :3], axis=1)
        print(f"{law.name}: the tip is off by up to "
              f"{1e3 * np.max(record.deviation_of('position')):.1f} mm, the vehicle by up to "
              f"{1e3 * np.max(vehicle):.1f} mm; force at the end {record.force[-1, 0]:.2f} N, "
              f"desired {scenario.task.force[0]:.2f} N")


if __name__ == "__main__":
    main()
