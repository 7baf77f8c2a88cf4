"""The sub-command `errata` of the paper, and scenarios with a simulation of their own, as its is.

No other file outside of `papers` imports a paper; scenarios name one by their keys `modules` and
`simulation`. The latter is a module with `FILES`, `run_into`, `certify_into` and `format_summary`,
such as `papers.nikou2018.kinematic_run`.
"""

import argparse
import importlib
import logging
import sys
from pathlib import Path
from typing import Any

from uvms_drake.certificate.run_verdict import BROKEN
from uvms_drake.command.files import folder, left_out, take_quiet
from uvms_drake.command.progress import CERTIFYING, bar
from uvms_drake.common.alarm import LOGGER
from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.common.output import output_folder
from uvms_drake.common.progress import part_of
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.scenario.scenario_file import reported_in

ERRATA_FILE = "errata.md"


def add_errata(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    errata = commands.add_parser("errata", help="compute the errata of the paper",
                                 allow_abbrev=False)
    errata.set_defaults(command=list_errata)
    take_quiet(errata)
    errata.add_argument("--output", type=folder, metavar="DIR",
                        help="also write errata.md, and a figure for each of three "
                             "ambiguous choices of the paper, simulated both ways")


def list_errata(args: argparse.Namespace) -> int:
    """Prints the computed errata of the paper, and returns 1 if one is not confirmed.

    With an output folder, writes them as Markdown, and the figures of `choices`.
    """
    from uvms_drake.papers.nikou2018.errata import all_errata, errata_markdown, errata_table
    from uvms_drake.papers.nikou2018.errata.choices import FIGURES, draw_choices

    LOGGER.setLevel(logging.ERROR)  # The drawn runs fail on purpose.
    with bar(args, "computing the errata") as progress:
        if args.output is None:
            errata = all_errata(progress)
        else:
            with output_folder(args.output, [ERRATA_FILE, *FIGURES]) as output:
                errata = all_errata(part_of(progress, 0.0, 0.3))
                text = errata_markdown(errata) + "\n"
                (output.folder / ERRATA_FILE).write_text(text, encoding="utf-8")
                draw_choices(output.folder, part_of(progress, 0.3, 1.0))
    print(errata_table(errata))
    if args.output is not None:
        print(f"written to {args.output}: {', '.join(sorted(output.kept))}", file=sys.stderr)
    return 0 if all(erratum.wrong for erratum in errata) else 1


def run_own(args: argparse.Namespace, scenario: Scenario, source: str, path: Path) -> int:
    """Simulates a scenario by its own module, prints the summary, and writes the files."""
    left_out(args, ("meshcat", "full", "no_replay"), "of a scenario with a simulation of its own")
    with reported_in(source), bar(args, "simulating") as progress:
        module = _module_of(scenario)
        with output_folder(path, module.FILES, replaces=True) as output:
            summary = module.run_into(
                scenario, output.folder, certified=not args.uncertified,
                figures=not args.no_figures, progress=progress)
    print(f"{module.format_summary(summary)}\n"
          f"written to {path}: {', '.join(sorted(output.kept))}")
    return 0 if summary["kept"] else BROKEN


def certify_own(args: argparse.Namespace, scenario: Scenario, source: str, path: Path) -> int:
    """Prints and writes the certificate of a scenario by its own module; 0 if it holds, else 1."""
    with reported_in(source), bar(args, CERTIFYING, is_steady=False) as progress:
        module = _module_of(scenario)
        with output_folder(path, module.FILES, replaces=True) as output:
            certificate = module.certify_into(scenario, output.folder, progress)
    print(certificate.text)
    print(f"written to {path}: {', '.join(sorted(output.kept))}", file=sys.stderr)
    return 0 if certificate.certified else 1


def _module_of(scenario: Scenario) -> Any:
    try:
        module = importlib.import_module(scenario.simulation)
        require(hasattr(module, "run_into"), "simulation", scenario.simulation,
                "a module with a simulation, as of papers.nikou2018")
    except ImportError as error:
        raise InvalidParameter("simulation", scenario.simulation,
                               f"a Python module ({error})") from None
    return module
