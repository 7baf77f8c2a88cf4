"""A user-defined feedback law: proportional and derivative in the coordinates of the robot.

It is a dataclass of its gains with one method, the command. No tube is known for it, so it is not
certified (`uv.tubes.register_tube` would register one); the scenario runs all the same, and is
monitored.
"""

import argparse
from dataclasses import dataclass

import numpy as np

import uvms_drake as uv


@uv.register
@dataclass
class ProportionalDerivative(uv.AncillaryLaw):
    """u = ū − derivative (ζ − ζ̄) − proportional J_x(𝔮)⁻¹(y − ȳ) (6+n,) [m/s², rad/s²]."""

    proportional: float = 100.0  # of the errors of pose and joints [1/s²]
    derivative: float = 25.0  # of the error of the velocity [1/s]

    def command(self, model, now, nominal_acceleration, nominal_input):
        """Returns u; the feedback sends M(𝔮)u."""
        pose_error = now.inverse @ uv.pose_difference(*now.y)
        velocity_error = now.zeta[0] - now.zeta[1]
        return nominal_input() - self.derivative * velocity_error - self.proportional * pose_error


def main() -> None:
    """Presses on the wall with the law."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=8.0, help="simulated time [s]")
    arguments = parser.parse_args()
    scenario = uv.load_scenario("girona500_ideal", [f"duration={arguments.duration}"])
    scenario.ancillary = ProportionalDerivative()
    print(f"certificate: {uv.certify(scenario).failed}")

    record = uv.simulate(scenario)
    print(f"largest deviation from the plan: {np.max(record.deviation_of('task')):.4f} m, rad")
    print(f"force at the end: {record.force[-1, 0]:.2f} N, desired {scenario.task.force[0]:.2f} N")


if __name__ == "__main__":
    main()
