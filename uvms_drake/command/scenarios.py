"""The sub-command `scenarios`: lists the shipped scenarios."""

import argparse

from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.scenario.scenario_file import shipped_scenarios


def add_scenarios(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    scenarios = commands.add_parser(
        "scenarios", help="list the shipped scenarios with motion and law", allow_abbrev=False)
    scenarios.set_defaults(command=list_scenarios)


def list_scenarios(args: argparse.Namespace) -> int:
    """Prints the shipped scenarios: a line each with motion, law and description."""
    del args
    rows = [("scenario", "motion", "law", "description")]
    for name in shipped_scenarios():
        scenario = load_scenario(name)
        rows.append((name, scenario.motion, scenario.law, " ".join(scenario.description.split())))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        print("  ".join(f"{x:<{w}}" for x, w in zip(row, widths, strict=True)).rstrip())
    return 0
