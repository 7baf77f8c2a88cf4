"""The sub-command `scenario`: writes a new scenario for a robot."""

import argparse
import os
from pathlib import Path

import numpy as np

from uvms_drake.command.files import folder, new_at
from uvms_drake.command.interrupt import PROGRAM
from uvms_drake.common.errors import require
from uvms_drake.model.description.robot_folder import shipped_robots


def add_scenario(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    scenario = commands.add_parser("scenario", help="begin a new scenario for a robot",
                                   allow_abbrev=False)
    scenario.set_defaults(command=new_scenario)
    scenario.add_argument("--new", type=folder, metavar="FILE", required=True,
                          help="new YAML file to write")
    scenario.add_argument("--robot", metavar="ROBOT", required=True,
                          help="name of a shipped robot, or a robot's folder")
    scenario.add_argument("--force", type=float, default=5.0, metavar="N",
                          help="desired force (default: %(default)s)")


def new_scenario(args: argparse.Namespace) -> int:
    """Writes a scenario in which a robot presses on a wall, and which a run takes."""
    from uvms_drake.certificate.certify import check_inputs
    from uvms_drake.station.diagram import make_station
    from uvms_drake.station.robot_loading import sound_robot
    from uvms_drake.station.scenario.scenario import load_scenario
    from uvms_drake.station.scenario.scenario_file import reported_in
    from uvms_drake.station.simulation import release
    from uvms_drake.station.step_size import with_step
    from uvms_drake.studies.first_scenario import first_scenario
    from uvms_drake.studies.first_scenario_text import format_first_scenario

    file: Path = args.new
    require(file.suffix == ".yaml" and not file.exists(), "--new", str(file),
            "a .yaml file that is not there yet")
    require(0.0 < args.force < np.inf, "--force", args.force, "positive")
    robot = sound_robot(args.robot)
    found = first_scenario(robot.uvms, args.force)
    shipped = args.robot in shipped_robots()
    # A path, though it may be that of a folder with the name of a shipped robot.
    model = args.robot if shipped else os.path.join(".", os.path.relpath(robot.folder, file.parent))
    text = format_first_scenario(found, model, robot.name)
    above = [path for path in file.parents if not path.exists()]
    with new_at(file):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    # A scenario that `run` would refuse is refused here, and leaves no file.
    try:
        with reported_in(f"the scenario made for {robot.name}"):
            scenario = load_scenario(str(file))
            known = check_inputs(scenario)
            release(make_station(with_step(scenario, known), model=known))
    except BaseException:
        file.unlink()
        for path in above:
            path.rmdir()
        raise
    print(f"written to {file}; '{PROGRAM} certify {file}' says whether it holds")
    return 0
