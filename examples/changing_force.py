"""A time-varying desired force on an unknown wall.

A user-defined system puts out the desired force, 20 N ± 5 N with a period of 10 s, at the port
`desired_force` of the station; the plan has a feasible problem for every force. The port `place`
likewise sets the place. The wall is 5 cm from the tip, for a short approach. A plan does not know
the force to come, so the force lags by 0.7 s (`--lead 0`: an error of 2.2 N). This profile is
known: it is put out that much earlier.
"""

import argparse

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem

import uvms_drake as uv

MEAN, AMPLITUDE, FREQUENCY = 20.0, 5.0, 0.1  # N, N, Hz
NEAR = "surface.geometry.point.0=-0.25"


def reference(t: np.ndarray | float) -> np.ndarray | float:
    """Returns the reference force [N] at times t [s]."""
    return MEAN + AMPLITUDE * np.sin(2.0 * np.pi * FREQUENCY * t)


class ForceProfile(LeafSystem):
    """Source of 𝔉_des (6) [N, N m]: the reference in `lead` [s], along a direction (3,)."""

    def __init__(self, direction: np.ndarray, lead: float):
        super().__init__()
        self._direction, self._lead = direction, lead
        self.DeclareVectorOutputPort("desired_force", 6, self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.append(
            reference(context.get_time() + self._lead) * self._direction, np.zeros(3)))


def main() -> None:
    """Presses by the profile and prints the error."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=30.0, help="simulated time [s]")
    parser.add_argument("--lead", type=float, default=0.7, help="preview of the reference [s]")
    arguments = parser.parse_args()
    scenario = uv.load_scenario("girona500_contact", [NEAR])

    builder = DiagramBuilder()
    station = builder.AddSystem(uv.make_station(scenario))
    profile = builder.AddNamedSystem("profile", ForceProfile(
        scenario.contact.direction, arguments.lead))
    builder.Connect(profile.get_output_port(), station.GetInputPort("desired_force"))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    ApplySimulatorConfig(uv.with_step(scenario).simulator, simulator)
    simulator.AdvanceTo(arguments.duration)

    logs = uv.read_logs(station, simulator.get_context())
    force, desired = logs["force"][:, :3] @ scenario.contact.direction, reference(logs["time"])
    print(f"{'t [s]':>6}{'reference [N]':>15}{'force [N]':>11}")
    for t in np.arange(0.0, arguments.duration + 1e-9, 1.0):
        i = np.searchsorted(logs["time"], t - 1e-9)
        print(f"{t:6.1f}{desired[i]:15.2f}{force[i]:11.2f}")
    pressing = logs["time"] > arguments.duration - 1.0 / FREQUENCY
    error = (force - desired)[pressing]
    print(f"force error in the last {min(1.0 / FREQUENCY, arguments.duration):.1f} s: "
          f"{np.sqrt(np.mean(error**2)):.2f} N rms, {np.max(np.abs(error)):.2f} N at most")


if __name__ == "__main__":
    main()
