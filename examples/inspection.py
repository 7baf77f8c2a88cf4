"""An inspection mission on an unknown wall, put together in a script.

The mission is a system next to the station: it reads the measurements and puts out desired force
and place. In a scenario file it is the key `mission`, see `girona500_inspection`. Here the wall is
5 cm from the tip, for a short approach.
"""

import argparse

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder

import uvms_drake as uv

PLACE = np.array([0.0, -0.06, -0.06])  # m, (0, 0) of the mission: in front of the tip's start
NEAR = "surface.geometry.point.0=-0.25"
JOB = uv.mission.Mission(steps=[
    uv.mission.Approach(at=np.zeros(2), force=10.0, on_failure="retry"),
    uv.mission.Hold(force=10.0, seconds=2.0),
    uv.mission.Slide(along=np.array([0.1, 0.0]), speed=0.02, force=10.0, amplitude=2.0,
                     frequency=0.1),
    uv.mission.Retreat(distance=0.1)])


def main() -> None:
    """Runs the mission and prints its progress."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=35.0, help="simulated time [s]")
    arguments = parser.parse_args()
    scenario = uv.load_scenario("girona500_inspection", [NEAR, "mission.steps=[]"])
    n, walls = scenario.contact.direction, scenario.contact.walls

    builder = DiagramBuilder()
    station = builder.AddSystem(uv.make_station(scenario))
    mission = builder.AddNamedSystem(
        "mission", uv.mission.MissionControl(JOB, uv.load_model(scenario), walls, PLACE))
    for name in ("state", "force_last_valid", "touched", "force_lost"):
        builder.Connect(station.GetOutputPort(name), mission.GetInputPort(name))
    for name in ("desired_force", "place", "deepest"):
        builder.Connect(mission.GetOutputPort(name), station.GetInputPort(name))
    builder.ExportOutput(mission.GetOutputPort("progress"), "progress")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    ApplySimulatorConfig(uv.with_step(scenario).simulator, simulator)

    print(f"{'t [s]':>6}  {'step':<10}{'desired [N]':>13}{'force [N]':>11}")
    context = simulator.get_mutable_context()
    for t in np.arange(0.0, arguments.duration + 1e-9, 1.0):
        simulator.AdvanceTo(t)
        step, outcome, *_ = diagram.GetOutputPort("progress").Eval(context)
        name = type(JOB.steps[int(step)]).__name__ if outcome == uv.mission.RUNNING else "over"
        own = station.GetMyContextFromRoot(context)
        desired, force = (station.GetOutputPort(port).Eval(own)[:3] @ n
                          for port in ("desired_force", "force"))
        print(f"{t:6.1f}  {name:<10}{desired:13.2f}{force:11.2f}")
    logs = uv.read_logs(station, context)
    most = np.max(logs["force"][:, :3] @ n)
    print(f"largest force {most:.2f} N of {scenario.contact.force:.2f} N")


if __name__ == "__main__":
    main()
