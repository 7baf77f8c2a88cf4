"""The sub-commands `scenario`, that writes a new scenario or checks one, and `scenarios`."""

import argparse
import os
from pathlib import Path

import numpy as np

from uvms_drake.actuation.thrusters import Thrusters
from uvms_drake.command.files import folder, left_out, new_file, take_quiet
from uvms_drake.command.interrupt import PROGRAM
from uvms_drake.command.progress import CERTIFYING, bar
from uvms_drake.common.errors import RunFailed, require
from uvms_drake.common.schema import read_yaml
from uvms_drake.common.wiring import release
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.description.robot_files import shipped_robots
from uvms_drake.model.surface.surface_class import axis_names
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.scenario.scenario import Scenario, load_scenario, remarks
from uvms_drake.station.scenario.scenario_file import (
    base_of,
    not_inherited,
    reported_in,
    scenario_path,
    shipped_scenarios,
)
from uvms_drake.station.true_wall import in_words, outside


def add_scenario(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    scenario = commands.add_parser(
        "scenario", help="begin a new scenario for a robot, or check one", allow_abbrev=False)
    scenario.set_defaults(command=new_or_checked, parser=scenario)
    task = scenario.add_mutually_exclusive_group(required=True)
    task.add_argument("--new", type=folder, metavar="FILE", help="new YAML file to write")
    task.add_argument("--check", metavar="FILE",
                      help="scenario to check, without a run: each difference from its base, the "
                           "keys that a tag replaces, the places of a mission in words")
    scenario.add_argument("--robot", metavar="ROBOT",
                          help="with --new: name of a shipped robot, or a robot's folder")
    scenario.add_argument("--force", type=float, default=5.0, metavar="N",
                          help="desired force (default: %(default)s)")
    scenario.add_argument("--unknown-wall", action="store_true",
                          help="with --new: the place, tilt and stiffness of the wall are unknown, "
                               "and a wrist sensor measures the force")
    scenario.add_argument("--real-loop", action="store_true",
                          help="with --new: an unknown wall behind the robot's own thrusters, a "
                               "clock and a navigation, for `calibrate`; no worst-case certificate")
    scenario.add_argument("--uncertified", action="store_true",
                          help="with --new: write it without computing its certificate, which "
                               "takes some ten seconds and may change it by the advice there")
    take_quiet(scenario)


def new_or_checked(args: argparse.Namespace) -> int:
    """Writes a new scenario, or checks one."""
    if args.check is not None:
        left_out(args, ("robot", "force", "uncertified", "unknown_wall", "real_loop"),
                 "with --check")
        return check_scenario(args.check)
    require(args.robot is not None, "--robot", args.robot, "a robot, with --new")
    return new_scenario(args)


def check_scenario(file: str) -> int:
    """Prints each difference of a scenario from its base; raises if it cannot be simulated."""
    from uvms_drake.report.compare import differing_keys

    # Keys that a tag has replaced come first: they explain many a refusal below.
    path = scenario_path(file)
    with reported_in(path.name):
        replaced = not_inherited(file)
    for key, lost in replaced.items():
        print(f"{key}: its tag replaces the base's mapping; not inherited, so at the default or "
              f"absent: {', '.join(lost) or 'nothing'}")
    scenario = load_scenario(file)
    with reported_in(path.name):
        model = require_runnable(scenario)
        if words := in_words(outside(scenario, model)):
            print(f"its own surface is outside of its declared class: {words}")
    if (base := base_of(read_yaml(path), path)) is not None:
        for key, (before, now) in differing_keys([load_scenario(str(base)), scenario]).items():
            print(f"{key}: {now} (base: {before})")
    for line in [*place_words(scenario), *(f"note: {each}" for each in remarks(scenario))]:
        print(line)
    print(f"{path.name}: a valid scenario; {verdict_by(file, has_thrusters(scenario))}")
    return 0


def has_thrusters(scenario: Scenario) -> bool:
    """Returns whether thrusters make the wrench, which no proof of the worst case covers."""
    return any(isinstance(part, Thrusters) for part in scenario.actuation)


def verdict_by(file: Path | str, real: bool) -> str:
    """Returns the commands that decide on a scenario, of a real loop or not."""
    return (f"'{PROGRAM} calibrate {file}' finds its tube, and of the result 'certify --runs N' "
            "bounds the probability of a failure" if real else
            f"'{PROGRAM} certify {file}' says whether it holds")


def require_runnable(scenario: Scenario) -> ContactModel:
    """Returns the controller's model, or raises the error with which a run would be refused."""
    from uvms_drake.station.diagram import make_station
    from uvms_drake.station.problem import check_inputs
    from uvms_drake.station.step_size import with_step

    known = check_inputs(scenario)
    release(make_station(with_step(scenario, known), model=known))
    return known


def place_words(scenario: Scenario) -> list[str]:
    """Returns a line for each approach and slide of a mission: its lengths by `axis_names`."""
    lines = []
    for i, step in enumerate(scenario.mission.steps):
        for key in ("at", "along"):
            lengths = getattr(step, key, None)
            if lengths is not None and np.any(lengths):
                names = axis_names(sensed_contact(scenario).direction)
                lines.append(f"mission.steps[{i}], {type(step).__name__}.{key}: " + ", ".join(
                    f"{x:.3g} m {name}" for x, name in zip(lengths, names, strict=True)))
    return lines


def new_scenario(args: argparse.Namespace) -> int:
    """Writes a scenario in which a robot presses on a wall; 1 if its certificate does not hold."""
    from uvms_drake.plant.model_check import sound_robot
    from uvms_drake.setup.first_scenario import first_scenario
    from uvms_drake.setup.settle import forbidding, settle
    from uvms_drake.setup.unknown_wall import press

    file: Path = args.new
    require(0.0 < args.force < np.inf, "--force", args.force, "positive")
    verdict, status = verdict_by(file, args.real_loop), 0
    # A scenario that `run` would refuse is refused here, and leaves no file.
    with new_file(file, "--new"):
        robot = sound_robot(args.robot)
        # A path, though it may be that of a folder with the name of a shipped robot.
        model = args.robot if args.robot in shipped_robots() else os.path.join(
            ".", os.path.relpath(robot.folder, file.parent))
        found = first_scenario(robot.uvms, args.force)
        with reported_in(f"the scenario made for {robot.name}"), bar(
                args, CERTIFYING, is_steady=False) as progress:
            found, text_of = press(
                robot, found, model, file, unknown=args.unknown_wall, real=args.real_loop)
            file.write_text(text_of(found), encoding="utf-8")
            require_runnable(load_scenario(str(file)))
            if not (args.uncertified or args.real_loop):
                certificate = settle(found, text_of, file, progress)
                if args.unknown_wall and certificate.failed is not None:
                    raise RunFailed(forbidding(found, certificate.failed))
                verdict, status = certificate.verdict, 0 if certificate.certified else 1
    print(f"written to {file}; {verdict}")
    return status


def add_scenarios(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    scenarios = commands.add_parser(
        "scenarios", help="list the shipped scenarios with their law", allow_abbrev=False)
    scenarios.set_defaults(command=list_scenarios)


def list_scenarios(args: argparse.Namespace) -> int:
    """Prints the shipped scenarios: a line each with law and description."""
    del args
    rows = [("scenario", "law", "description")]
    for name in shipped_scenarios():
        scenario = load_scenario(name)
        rows.append((name, scenario.law, " ".join(scenario.description.split())))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        print("  ".join(f"{x:<{w}}" for x, w in zip(row, widths, strict=True)).rstrip())
    return 0
