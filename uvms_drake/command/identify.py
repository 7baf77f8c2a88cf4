"""The sub-command `identify`: a robot's hydrodynamic parameters by its logs."""

import argparse
import sys
from pathlib import Path

from uvms_drake.command.files import folder, take_quiet
from uvms_drake.command.progress import bar
from uvms_drake.common.output import output_folder

EPILOG = """\
A log is the folder of a run of this program, or a CSV file; for the latter --signals names a YAML
file that says where each signal is, in which unit, frame and by which clock. Frames are checked,
never guessed: a log that contradicts them is refused with a line.

Exit status 1: no parameter was identified.
"""


def add_identify(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    identify = commands.add_parser(
        "identify", help="identify a robot's parameters in the water from its logs",
        allow_abbrev=False, epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter)
    identify.set_defaults(command=identify_robot)
    identify.add_argument("robot", metavar="ROBOT", help="name of a shipped robot, or its folder")
    identify.add_argument("logs", nargs="+", type=folder, metavar="LOG",
                          help="a log; of several files, the part of their paths that is common")
    identify.add_argument("--signals", type=folder, metavar="FILE",
                          help="where the signals of the logs are")
    identify.add_argument("--confidence", type=float, default=0.95, metavar="C",
                          help="of each interval (default: %(default)s)")
    identify.add_argument("--output", type=folder, metavar="DIR",
                          help="where to write (default: out/<robot>-identified)")
    take_quiet(identify)


def identify_robot(args: argparse.Namespace) -> int:
    """Prints and writes the parameters; returns 0 if one was identified."""
    from uvms_drake.common.schema import load_file
    from uvms_drake.identification.figures import FIGURES, PAGE_FILE, write_page
    from uvms_drake.identification.identify import identify
    from uvms_drake.identification.readers import digest, read_log
    from uvms_drake.identification.robot_file import FILE
    from uvms_drake.identification.signals_file import LogSignals
    from uvms_drake.identification.written import (
        DATA_FILE,
        UNKNOWNS_FILE,
        format_result,
        validation_rms,
        write_files,
    )
    from uvms_drake.model.robot import Robot

    # Robot, signals and logs, each refused in a line.
    robot = Robot.load(args.robot)
    signals = None if args.signals is None else load_file(args.signals, LogSignals)
    logs = [read_log(path, len(robot.uvms.joints), signals) for path in args.logs]
    output = args.output or Path("out") / f"{robot.name}-identified"
    names = [FILE, UNKNOWNS_FILE, DATA_FILE, PAGE_FILE, *FIGURES]
    with bar(args, "identifying") as progress:
        found = identify(robot, logs, args.confidence, progress)
    # The table, then the files, all or none.
    digests = {str(path): digest(path, signals) for path in args.logs}
    for line in (*map(format_result, found.results), *(f"not used: {each}"
                                                       for each in found.refused)):
        print(line)
    print("held-out prediction, rms: " + ", ".join(
        f"{name} {size:.3g}" for name, size in validation_rms(found).items()))
    with output_folder(output, names) as staged:
        write_files(found, digests, staged.folder)
        write_page(found, digests, staged.folder)
    print(f"written to {output}: {', '.join(names)}", file=sys.stderr)
    return 0 if found.identified else 1
