"""A wall with a modelling error, without and with a force sensor.

Without a sensor the law takes the contact force from the model of the wall, and the robot leaves
its tube. With one the wall is no longer in the error dynamics, only the errors of the sensor, here
mostly its lag while the force rises. The *plan* still presses to the depth at which the modelled
wall gives 20 N, so the modelling error remains in the force.
"""

import argparse

import numpy as np

import uvms_drake as uv

WIDER = ["tube.e=0.012", "tube.position=0.008", "tube.orientation=0.008", "tube.joints=0.004",
         "tube.z=0.06"]
"""Four times the tube of a known wall: the errors of the sensor are a disturbance, too."""
CLOSE = "start.eta=[-1.13, -0.05, -0.05, 0.02, 0.02, 0.05]"
"""The tip starts 4 cm off the modelled wall."""


def main() -> None:
    """Presses on a wall, with and without a force sensor."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=4.0, help="simulated time [s]")
    parser.add_argument("--shift", type=float, default=0.02, help="of the wall, along x [m]")
    parser.add_argument("--stiffness", type=float, default=1.0, help="over that of the model")
    arguments = parser.parse_args()
    scenario = uv.load_scenario("girona500_ideal", [
        f"duration={arguments.duration}", f"surface_error.shift=[{arguments.shift}, 0, 0]",
        f"surface_error.stiffness={arguments.stiffness}", CLOSE, *WIDER])
    tube = scenario.tube
    for name, sensing in (("modelled", []), ("measured", [uv.sensors.ForceSensor(tare=0.2)])):
        scenario.sensing = sensing
        record = uv.simulate(scenario)
        ratio = max(np.max(record.deviation_of(part)) / getattr(tube, part)
                    for part in ("position", "orientation", "joints"))
        print(f"{name} force: deviation up to {ratio:.2f} of the tube, {record.force[-1, 0]:.2f} N "
              f"at the end, planned {scenario.task.force[0]:.2f} N")


if __name__ == "__main__":
    main()
