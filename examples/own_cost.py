"""A user-defined cost term of the MPC: it penalises the speed of one joint.

A term is a dataclass with a residual r of a point of the motion, and adds ‖r‖² per second; its
derivatives follow by complex steps. No proof covers it, so the scenario is not certified.
"""

import argparse
from dataclasses import dataclass

import numpy as np

import uvms_drake as uv


@uv.register
@dataclass
class SlowElbow(uv.CostTerm):
    """weight q̇₂²: the second joint, which carries the arm, moves as little as possible."""

    about = "speed"
    weight: float = 2000.0
    """Cost of 1 rad²/s² for 1 s."""

    def residual(self, at: uv.Points) -> np.ndarray:
        """Returns √weight q̇₂ (..., 1)."""
        return np.sqrt(self.weight) * at.zeta[..., 7:8]


def main() -> None:
    """Presses on the wall, with and without the term."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=8.0, help="simulated time [s]")
    arguments = parser.parse_args()
    for terms in ([], [SlowElbow()]):
        scenario = uv.load_scenario("girona500_ideal", [f"duration={arguments.duration}"])
        scenario.mpc.terms = terms
        if terms:
            print(f"certificate: {uv.certify(scenario).failed}")
        record = uv.simulate(scenario)
        fastest = np.max(np.abs(record.nominal_zeta[:, 7]))
        print(f"{'with' if terms else 'without'} the term: "
              f"the second joint turns at {fastest:.3f} rad/s at most")
    print(f"force at the end: {record.force[-1, 0]:.2f} N, desired {scenario.task.force[0]:.2f} N")


if __name__ == "__main__":
    main()
