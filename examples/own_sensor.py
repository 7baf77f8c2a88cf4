"""A user-defined sensor between plant and controller: a compass with a constant error.

A part is a dataclass with `add_to`; its `signals` are logged. No proof covers this one, so it is
not certified; the scenario runs all the same.
"""

import argparse
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import Adder, ConstantVectorSource

import uvms_drake as uv

YAW = 5  # in 𝔮 = (x, y, z, φ, θ, ψ, q₁, ...)


@uv.register
@dataclass
class CompassError(uv.Sensor):
    """The measured heading is the true one plus `offset`."""

    offset: float = 0.02
    """Error of the heading [rad]."""

    def add_to(self, builder: DiagramBuilder, model: uv.UvmsModel, port: OutputPort,
               signals: uv.Signals, seed: int) -> OutputPort:
        """Adds a constant to the measured state."""
        offset = np.zeros(port.size())
        offset[YAW] = self.offset
        error = builder.AddNamedSystem("error", ConstantVectorSource(offset))
        measured = builder.AddNamedSystem("measured", Adder(num_inputs=2, size=port.size()))
        builder.Connect(port, measured.get_input_port(0))
        builder.Connect(error.get_output_port(), measured.get_input_port(1))
        signals["compass_state"] = measured.get_output_port()
        return measured.get_output_port()


def main() -> None:
    """Presses on the wall with an error of the heading."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=8.0, help="simulated time [s]")
    arguments = parser.parse_args()
    scenario = uv.load_scenario("girona500_ideal", [f"duration={arguments.duration}"])
    scenario.sensing = [CompassError()]
    print(f"certificate: {uv.certify(scenario).failed}")

    record = uv.simulate(scenario)
    heading = record.signals["compass_state"][-1, YAW] - record.config[-1, YAW]
    print(f"error of the heading: {heading:.3f} rad")
    print(f"force at the end: {record.force[-1, 0]:.2f} N, desired {scenario.task.force[0]:.2f} N")


if __name__ == "__main__":
    main()
