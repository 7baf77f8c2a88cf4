"""A user-defined surface, for the plant and for the controller's model: a soft sphere.

`Surface` documents the methods. A limit of the force, and a certificate, need more of them.
"""

import argparse
from dataclasses import dataclass, field

import numpy as np

import uvms_drake as uv


@uv.register
@dataclass
class Buoy(uv.Surface):
    """𝔉 along the inward radius, stiffness · depth past a soft skin; it never pulls."""

    center: np.ndarray = field(default_factory=lambda: np.array([0.3, 0.0, 0.0]))  # [m]
    radius: float = 0.3  # [m]
    stiffness: float = 800.0  # [N/m]
    skin: float = 0.002  # [m]

    @property
    def anchor(self) -> np.ndarray:
        return self.center - np.array([self.radius, 0.0, 0.0])

    def force(self, chi: np.ndarray, chi_dot: np.ndarray) -> np.ndarray:
        inward = self.center - chi[..., :3]
        distance = np.sqrt(np.sum(inward**2, axis=-1, keepdims=True))  # For complex numbers.
        load = self.stiffness * uv.surfaces.plane_load(self.radius - distance, self.skin)
        return np.concatenate([load * inward / distance, np.zeros_like(inward)], axis=-1)

    def penetration(self, chi: np.ndarray) -> np.ndarray:
        return np.maximum(self.radius - np.linalg.norm(chi[..., :3] - self.center, axis=-1), 0.0)

    def force_jacobian(self) -> np.ndarray:
        return self.stiffness * np.eye(3, 6)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=6.0, help="simulated time [s]")
    scenario = uv.load_scenario("girona500_ideal", [f"duration={parser.parse_args().duration}"])
    scenario.surface, scenario.limits.static_force = Buoy(), None
    force = uv.simulate(scenario).force[-1, 0]
    print(f"force at the end: {force:.2f} N, desired {scenario.task.force[0]:.2f} N")
