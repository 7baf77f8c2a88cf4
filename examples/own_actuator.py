"""User-defined actuators between controller and plant: a thruster lag behind a zero-order hold.

The lag is a user-defined part, made of Drake's FirstOrderLowPassFilter; the hold comes with the
project. Each part declares the assumption of the proofs that it violates.
"""

import argparse
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import FirstOrderLowPassFilter

import uvms_drake as uv

FASTEST = 4e-3  # s, of the joints, practically without lag


@uv.register
@dataclass
class ThrusterLag(uv.Actuator):
    """The vehicle's wrench follows its command with a lag of first order."""

    time_constant: float = 0.05
    """Time constant of the thrusters [s]."""

    def assumption(self) -> str:
        """Returns the assumption of the proofs that it violates."""
        return "the proofs assume ideal actuators"

    def add_to(self, builder: DiagramBuilder, model: uv.UvmsModel, port: OutputPort,
               signals: uv.Signals, seed: int) -> OutputPort:
        """Adds Drake's filter."""
        lags = np.repeat([self.time_constant, FASTEST], [6, model.num_joints])
        lag = builder.AddNamedSystem("lag", FirstOrderLowPassFilter(lags))
        builder.Connect(port, lag.get_input_port())
        return lag.get_output_port()


def main() -> None:
    """Presses on the wall with thrusters that lag."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=8.0, help="simulated time [s]")
    arguments = parser.parse_args()
    scenario = uv.load_scenario("girona500_ideal", [
        f"duration={arguments.duration}", "simulator.max_step_size=0.004"])
    scenario.actuation = [uv.actuators.SampledCommand(period=0.02, delay=0.005), ThrusterLag()]
    broken = [item.name for item in uv.certify(scenario).conditions if not item.holds]
    print(*broken, sep="\n")

    record = uv.simulate(scenario)
    print(f"force at the end: {record.force[-1, 0]:.2f} N, desired {scenario.task.force[0]:.2f} N")


if __name__ == "__main__":
    main()
