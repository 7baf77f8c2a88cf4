"""The sub-commands `robot`, which shows, checks or writes a robot's folder, and `identify`."""

import argparse
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from uvms_drake.command.files import folder, new_at, take_quiet
from uvms_drake.command.interrupt import PROGRAM
from uvms_drake.command.progress import bar
from uvms_drake.common.errors import InvalidFile, require, vector
from uvms_drake.common.output import output_folder
from uvms_drake.model.description.robot_files import model_dir

TEMPLATE = "box_uvms"
PICTURE_FILE = "robot.png"
PAGE_FILE = "robot.html"

EPILOG = f"""\
Without --output nothing is written. With it: {PICTURE_FILE}, and {PAGE_FILE}, in which every joint
goes through its limits; red is the centre of mass, blue that of buoyancy, yellow where thrusters
push.

Exit status 2: the robot is not sound, and no certificate of it would be worth anything; one line
each on stderr, by file and key.
"""
LOGS = """\
A log is the folder or log.npz of a run of this program; a log of ArduSub (.BIN, .tlog) or a bag of
ROS 2 (its folder, or .mcap), by pip install 'uvms_drake[logs]'; or CSV files of numbers. But for a
run of this program --signals names a YAML file, such as

  world: ENU
  body: FLU
  attitude: xyzw
  signals:
    - {signal: attitude, columns: [qx, qy, qz, qw], file: _imu.csv, time: stamp, time_unit: ns}
    - {signal: joints, columns: [a, b, c, d], file: _arm.csv, time: t, unit: deg, delay: 0.1}

Signals: joints, attitude (both needed), angular_velocity, velocity, depth (positive down), position
(its depth), wrench (of the thrusters; without it the vehicle drifts), specific_force, force, armed.
Velocity and depth are those of the vehicle's origin: a DVL or pressure sensor that is elsewhere has
to be brought there before. `file` is added to LOG, as /imu.csv to a folder; of ArduSub it is the
message, as ATT or IMU[0], of ROS 2 the topic, and columns are fields, as Roll, orientation.x,
position[0], time_s (of recording), header.stamp. Gyro and accelerometer are checked against the
attitude where the log has them; senses of joints and wrench are taken as declared.

The water is taken to be at rest: the folder of a run with a current or waves is refused, but a bare
log.npz or CSV does not show it. At least 12 windows of 8 s without contact are needed. An interval
is of the scatter of windows: an error of the model that all of them share is not in it.

Exit status 2: bad input, or no parameter was identified; 1: the estimate does not converge.
"""


def add_robot(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    robot = commands.add_parser("robot", help="show and check a robot, or begin a new one",
                                allow_abbrev=False, epilog=EPILOG,
                                formatter_class=argparse.RawDescriptionHelpFormatter)
    robot.set_defaults(command=show_robot)
    robot.add_argument("model", nargs="?", metavar="ROBOT",
                       help="name of a shipped robot, or a robot's folder")
    robot.add_argument("--posture", type=float, nargs="+", metavar="RAD",
                       help="joint angles for the sheet and pictures (default: middle of limits)")
    robot.add_argument("--output", type=folder, metavar="DIR", help="where to write its pictures")
    robot.add_argument("--new", type=folder, metavar="DIR",
                       help="write the folder of a new robot, a box with two joints, every line "
                            "explained")
    robot.add_argument("--from", dest="source", type=folder, nargs=2, metavar=("FILE", "DIR"),
                       help="write the folder of the robot in a URDF or SDFormat file as it is "
                            "found, and list values taken, changed and missing")


def show_robot(args: argparse.Namespace) -> int:
    """Prints the data sheet of a robot and the complaints about it, or writes a new robot."""
    # One of three: import a file, write the template, or show a robot.
    require(sum(item is not None for item in (args.model, args.new, args.source)) == 1, "ROBOT",
            args.model, "a robot's name or folder; or left out, with --new or --from")
    for kind in ("new", "from"):
        if (args.new if kind == "new" else args.source) is not None:
            for option in ("output", "posture"):
                require(getattr(args, option) is None, f"--{option}", getattr(args, option),
                        f"left out, with --{kind}")
    if args.source is not None:
        return write_robot(*args.source)
    if args.new is not None:
        write_template(args.new)
        print(f"written to {args.new}; '{PROGRAM} robot {args.new}' shows it")
        return 0
    from uvms_drake.plant.model_check import sound_robot

    try:
        robot = sound_robot(args.model)
    except InvalidFile as error:
        for complaint in error.complaints:
            print(f"{PROGRAM}: error: {complaint}", file=sys.stderr)
        return 2
    # Imported here: a robot with a mistake is refused at once.
    uvms = robot.uvms
    from uvms_drake.model.trim import middle_posture
    from uvms_drake.report.robot.robot_sheet import format_sheet, sheet_of

    posture = middle_posture(uvms) if args.posture is None else vector(
        "--posture", args.posture, len(uvms.joints))
    print(format_sheet(sheet_of(uvms, robot.name, posture), robot.notes))
    if args.output is not None:
        import matplotlib

        from uvms_drake.report.figure_style import STYLE
        from uvms_drake.report.robot.robot_page import write_page
        from uvms_drake.report.robot.robot_views import draw_views

        with output_folder(args.output, [PICTURE_FILE, PAGE_FILE]) as output:
            with matplotlib.rc_context(STYLE):
                draw_views(uvms, args.model, posture).savefig(output.folder / PICTURE_FILE)
            write_page(uvms, args.model, posture, output.folder / PAGE_FILE)
        print(f"written to {args.output}: {PICTURE_FILE}, {PAGE_FILE}", file=sys.stderr)
    return 0


def write_template(robot: Path) -> None:
    """Writes a copy of the template, by the name of the folder."""
    source = sorted(model_dir(TEMPLATE).iterdir())
    _write_folder(robot, "--new", lambda name: {
        file.name.replace(TEMPLATE, name):
            file.read_text(encoding="utf-8").replace(TEMPLATE, name).encode() for file in source})


def write_robot(file: Path, robot: Path) -> int:
    """Writes the folder of the robot in a file as it was found, and prints the notes of the import.

    Args:
        file: URDF or SDFormat.
        robot: The folder.

    Returns:
        Exit status.

    Raises:
        InvalidParameter: The file is no robot, or the folder cannot be written; nothing is left.
    """
    from uvms_drake.model.robot_import.importer import import_robot
    from uvms_drake.plant.model_check import sound_robot

    found = []

    def imported(name: str) -> dict[str, bytes]:
        found.append(import_robot(file, name))
        return found[0].files

    try:
        _write_folder(robot, "--from", imported, sound_robot)
    except InvalidFile as error:
        if not found:
            raise
        # The checks of `robot`, at the end of the list: numbers that the file has are at fault.
        print(f"{found[0].notes.format()}\nRefused, and nothing is written, for these numbers of "
              "the file, by the place where they would be:", flush=True)
        for complaint in error.complaints:
            print(f"{PROGRAM}: error: {complaint}", file=sys.stderr)
        return 2
    listed = "" if found[0].is_copy else ", with this list in README.md"
    print(f"{found[0].notes.format()}\nwritten to {robot}{listed}; '{PROGRAM} robot {robot}' shows "
          "it")
    return 0


def _write_folder(robot: Path, option: str, files: Callable[[str], dict[str, bytes]],
                  check: Callable[[str], object] = str) -> None:
    """Writes the files of a robot into a folder that appears when all of them are there.

    Args:
        robot: The folder.
        option: Of the command line, that asked for it.
        files: Function of the robot's name that returns the files, by path in the folder.
        check: Function of the path of the folder, before it appears, that raises if it is not good.

    Raises:
        InvalidParameter: The folder is there, cannot be written, or its name is none for a robot.
    """
    name = robot.name
    require(name.isidentifier() and name.isascii(), option, str(robot),
            "a folder by the name of the robot: letters, digits and _")
    require(not os.path.lexists(robot), option, str(robot), "a folder that is not there yet")
    content = files(name)
    with new_at(robot, option):
        robot.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{name}-", dir=robot.parent) as above:
            staging = Path(above) / name
            for path, data in content.items():
                (staging / path).parent.mkdir(parents=True, exist_ok=True)
                (staging / path).write_bytes(data)
            try:
                check(str(staging))
            except InvalidFile as error:
                raise InvalidFile([complaint.replace(str(staging), str(robot))
                                   for complaint in error.complaints]) from None
            staging.rename(robot)


def add_identify(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    identify = commands.add_parser(
        "identify", help="identify a robot's parameters in the water from its logs",
        allow_abbrev=False, epilog=LOGS, formatter_class=argparse.RawDescriptionHelpFormatter)
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
    """Prints and writes the parameters."""
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
    # The table, then the files, all or none; a folder that cannot take them is refused before.
    with output_folder(output, names) as staged:
        with bar(args, "identifying") as progress:
            found = identify(robot, logs, args.confidence, progress)
        digests = {log.name: digest(Path(log.name), signals) for log in found.used}
        for line in (*map(format_result, found.results), *(f"not used: {each}"
                                                           for each in found.refused)):
            print(line)
        print("held-out prediction, rms: " + ", ".join(
            f"{name} {size:.3g}" for name, size in validation_rms(found).items()))
        write_files(found, digests, staged.folder)
        write_page(found, digests, staged.folder)
    print(f"written to {output}: {', '.join(names)}", file=sys.stderr)
    return 0
