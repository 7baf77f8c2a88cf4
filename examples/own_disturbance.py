"""A user-defined disturbance in a scenario: waves that decay with depth.

The certificate holds for the declared bound, which has to be one: here it is the amplitude of the
waves at the surface of the water.
"""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem, OutputPort

import uvms_drake as uv


@uv.register
@dataclass
class Waves(uv.Disturbance):
    """d = bound exp(−k depth) (cos(kx − ωt), 0, sin(kx − ωt)) in Σ_I, ω² = gk."""

    period: float = 4.0
    """Period of the waves [s]."""
    surface: float = -3.0
    """z of the water's surface [m]."""

    def add_to(self, builder: DiagramBuilder, model: uv.UvmsModel, seed: int,
               signals: Mapping[str, OutputPort]) -> OutputPort:
        """Adds a source whose input is the robot's state."""
        source = builder.AddNamedSystem("waves", WaveSource(self, model.size))
        builder.Connect(signals["state"], source.get_input_port())
        return source.get_output_port()


class WaveSource(LeafSystem):
    """Source of d (6+n) in the paper's order; input (𝔮, ζ) (2(6+n)); without state."""

    def __init__(self, waves: Waves, size: int):
        super().__init__()
        self._waves = waves
        self.DeclareVectorInputPort("state", 2 * size)
        self.DeclareVectorOutputPort("disturbance", size, self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        x, _, z, _, pitch, yaw = self.get_input_port().Eval(context)[:6]
        omega = 2.0 * np.pi / self._waves.period
        k = omega**2 / 9.81
        amplitude = self._waves.bound * np.exp(-k * max(z - self._waves.surface, 0.0))
        north, down = amplitude * np.cos(
            k * x - omega * context.get_time() - np.array([0.0, np.pi / 2]))
        forward = np.cos(yaw) * north  # Roll is small and neglected.
        d = np.zeros(output.size())
        d[:3] = (np.cos(pitch) * forward - np.sin(pitch) * down, -np.sin(yaw) * north,
                 np.sin(pitch) * forward + np.cos(pitch) * down)
        output.SetFromVector(d)


def main() -> None:
    """Presses on the wall below the waves."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=8.0, help="simulated time [s]")
    arguments = parser.parse_args()
    scenario = uv.load_scenario("girona500_ideal", [f"duration={arguments.duration}"])
    scenario.disturbance = Waves(bound=0.1)
    record = uv.simulate(scenario)
    surge = record.disturbance[:, 0]
    print(f"surge {np.min(surge):.3f} to {np.max(surge):.3f} m/s²")
    print(f"force at the end: {record.force[-1, 0]:.2f} N, desired {scenario.task.force[0]:.2f} N")


if __name__ == "__main__":
    main()
