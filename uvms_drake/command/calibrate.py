"""The sub-command `calibrate`: tube and gains of a real loop from pilot runs."""

import argparse
import sys
from pathlib import Path

from uvms_drake.command.campaign import take_workers
from uvms_drake.command.files import new_at, take_quiet
from uvms_drake.command.interrupt import PROGRAM
from uvms_drake.command.progress import bar
from uvms_drake.common.errors import require
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.scenario.scenario_file import reported_in, scenario_path


def add_calibrate(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    calibrate = commands.add_parser(
        "calibrate", allow_abbrev=False,
        help="find the tube of a real loop, and its gains, from pilot runs")
    calibrate.set_defaults(command=calibrate_scenario)
    calibrate.add_argument("scenario", metavar="SCENARIO",
                           help="name of a shipped scenario or a YAML file")
    calibrate.add_argument("--runs", type=int, default=20, metavar="K",
                           help="pilot runs of each of two or three rounds (default: %(default)s); "
                                "they are kept, and the same command goes on with the others")
    calibrate.add_argument("--gains", action="store_true",
                           help="find the gains of the law, too, by a run each with delays that "
                                "are half as long again")
    calibrate.add_argument("--output", type=Path, metavar="FILE",
                           help="file to write, beside that of the scenario if that has relative "
                                "paths (default: <scenario>_calibrated.yaml)")
    take_workers(calibrate)
    take_quiet(calibrate)


def calibrate_scenario(args: argparse.Namespace) -> int:
    """Writes the calibrated scenario and prints the rows of its tube."""
    from uvms_drake.campaign.pool import make_pool
    from uvms_drake.command.drawn_runs import check_declared, drawable
    from uvms_drake.setup.calibrate import PilotsFailed, calibrate
    from uvms_drake.setup.calibrated_file import calibrated_text

    scenario, path = load_scenario(args.scenario), scenario_path(args.scenario)
    file = args.output or Path(f"{scenario.name}_calibrated.yaml")
    require(file.suffix == ".yaml", "--output", str(file), "a .yaml file")
    pool = make_pool(args.workers, args.scheduler)
    with reported_in(args.scenario), bar(args, "pilot runs") as progress:
        try:
            found = calibrate(scenario, args.runs, args.gains, pool, progress)
        except PilotsFailed as error:
            for line in error.lines:
                print(line, file=sys.stderr)
            raise
    command = " ".join([PROGRAM, "calibrate", args.scenario, *(["--gains"] if args.gains else [])])
    text = calibrated_text(path.read_text(encoding="utf-8"), found, command)
    with new_at(file, "--output"):
        file.write_text(text, encoding="utf-8")
    # What is in the file is what was found.
    with reported_in(str(file)):
        check_declared(drawable(load_scenario(str(file))))
    print(f"{found}\n\nwritten to {file}; '{PROGRAM} certify {file} --runs 300' draws other runs")
    return 0
