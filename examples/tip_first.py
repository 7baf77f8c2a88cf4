"""Thruster lag under three laws: two position the tip by the vehicle, the third by the arm.

The laws `resolved` and `transpose` ask the vehicle to hold the tip: beyond a lag of
(k + sigma)/(k sigma), 0.25 s for the first, the loop is unstable. The law `tip first` takes the
present wrench of the thrusters as given, and holds the tip with the arm. To a lag of 0.15 s comes a
dead time of 0.05 s. The wall is 5 mm nearer than modelled, a wrist sensor measures the force, and a
pulse of the disturbance, as large as the declared bound, acts backwards and sideways.
"""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from pydrake.systems.framework import LeafSystem

import uvms_drake as uv
from uvms_drake.papers import nikou2018

DEAD_TIME = 0.05  # s, of the thrusters


@dataclass
class Pulse(uv.OpenLoopDisturbance):
    """Half a sine that accelerates the vehicle backwards and sideways."""

    start: float = 5.0
    """Start [s]."""
    length: float = 1.0
    """Duration [s]."""

    def system(self, size: int, seed: int = 0) -> LeafSystem:
        """Returns its source; see `OpenLoopDisturbance`."""
        a = np.zeros(size)
        a[:2] = self.bound * np.array([-0.6, 0.8])
        return uv.DirectedDisturbance(a, lambda time: np.sin(np.pi * min(max(
            (time - self.start) / self.length, 0.0), 1.0)))


def main() -> None:
    """Presses on the wall with each law."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=9.0, help="simulated time [s]")
    parser.add_argument("--lag", type=float, default=0.15, help="of the thrusters [s]")
    parser.add_argument("--figure", type=Path, help="PNG file to write")
    arguments = parser.parse_args()
    scenario = uv.load_scenario("girona500_ideal", [
        f"duration={arguments.duration}", "surface_error.shift=[-0.005, 0, 0]"])
    scenario.actuation = [uv.actuators.Thrusters(lag=arguments.lag, dead_time=DEAD_TIME)]
    pulse = scenario.disturbance = Pulse(bound=0.1)
    figure, panels = plt.subplots(3, sharex=True, figsize=(5.0, 4.5), layout="constrained")
    # With five thrusters roll is not driven: weight and buoyancy restore it.
    for law in (nikou2018.Transpose(k=20.0, sigma=1.0), uv.laws.Resolved(k=20.0, sigma=5.0),
                uv.laws.TipFirst(undriven=["roll"])):
        sensing = [uv.sensors.ForceSensor()] if law.takes_force else []
        record = uv.simulate(replace(scenario, ancillary=law, sensing=sensing))
        tip = 1e3 * record.deviation_of("position")
        vehicle = 1e3 * np.linalg.norm(record.state[:, :3] - record.nominal_state[:, :3], axis=1)
        print(f"{law.name}: the tip is off by up to {np.max(tip):.1f} mm, the vehicle by up to "
              f"{np.max(vehicle):.1f} mm; force at the end {record.force[-1, 0]:.2f} N, "
              f"desired {scenario.task.force[0]:.2f} N")
        for axis, values in zip(panels, (tip, vehicle, record.force[:, 0]), strict=True):
            axis.plot(record.time, values, label=law.name)
    for axis, name in zip(panels, ("tip off [mm]", "vehicle off [mm]", "force [N]"), strict=True):
        axis.set_ylabel(name)
        axis.set_yscale("linear" if axis is panels[-1] else "log")
        axis.grid(alpha=0.3)
        axis.axvspan(pulse.start, pulse.start + pulse.length, color="0.9")
    for axis in panels[:2]:
        axis.set_ylim(bottom=0.05)
    panels[-1].axhline(scenario.task.force[0], color="0.4", linestyle=":", linewidth=1.0)
    panels[-1].annotate("desired", (0.0, scenario.task.force[0]), va="bottom", color="0.4")
    panels[0].legend(ncols=3, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    panels[-1].set_xlabel(f"time [s]; thrusters: dead time {DEAD_TIME:g} s, lag "
                          f"{arguments.lag:g} s; grey: the pulse")
    if arguments.figure:
        figure.savefig(arguments.figure, dpi=200)


if __name__ == "__main__":
    main()
