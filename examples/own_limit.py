"""A user-defined limit: the vehicle keeps its distance from a pillar next to its path to the wall.

A limit returns the values of a motion that it bounds, for the nominal MPC, tables and figures.
This one has no tightening by the tube (`tube_takes`), so it is not certified.
"""

import argparse
from dataclasses import dataclass, field

import numpy as np

import uvms_drake as uv

FAR = 100.0  # m


@uv.register
@dataclass
class KeepAway(uv.Limit):
    """The vehicle's origin is at least `distance` away from a vertical line."""

    name = "pillar"
    place: np.ndarray = field(default_factory=lambda: np.array([-1.2, -0.25]))
    """Place of the line (2,) in Σ_I [m]."""
    distance: float = 0.22
    """Smallest distance [m]."""

    def values(self, at: uv.Points) -> np.ndarray:
        """Returns the distance (..., 1) [m], for complex numbers, too."""
        away = at.config[..., :2] - self.place
        return np.sqrt(np.sum(away**2, axis=-1, keepdims=True))

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the smallest and the largest distance."""
        return np.array([self.distance]), np.array([FAR])


def main() -> None:
    """Presses on the wall, with and without the limit."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=5.0, help="simulated time [s]")
    arguments = parser.parse_args()
    pillar = KeepAway()
    for limits in ([], [pillar]):
        scenario = uv.load_scenario("girona500_ideal", [f"duration={arguments.duration}"])
        scenario.limits.more = limits
        if limits:
            print(f"certificate: {uv.certify(scenario).failed}")
        record = uv.simulate(scenario)
        away = np.linalg.norm(record.nominal_config[:, :2] - pillar.place, axis=1)
        print(f"{'with' if limits else 'without'} the limit: {np.min(away):.3f} m from the pillar")
    print(f"force at the end: {record.force[-1, 0]:.2f} N, desired {scenario.task.force[0]:.2f} N")


if __name__ == "__main__":
    main()
