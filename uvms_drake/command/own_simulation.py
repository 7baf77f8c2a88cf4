"""Scenarios with a simulation of their own: `run` and `certify` by the module that they name.

Such a module has `FILES`, `run_into`, `certify_into` and `format_summary`, as that of a paper,
`papers.nikou2018.kinematic_run`.
"""

import argparse
import importlib
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

from uvms_drake.command.files import BROKEN
from uvms_drake.command.progress import CERTIFYING, Bar, stream_of
from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.common.output import output_folder
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.scenario.scenario_file import reported_in, scenario_source, set_options


def run_own(args: argparse.Namespace, scenario: Scenario, path: Path) -> int:
    """Simulates a scenario by its own module, prints the summary, and writes the files."""
    require(not args.meshcat, "--meshcat", True, "left out: it has a simulation of its own")
    with (reported_in(scenario_source(args.scenario, set_options(args.overrides))),
          closing(Bar("simulating", stream_of(args))) as progress):
        module = _module_of(scenario)
        with output_folder(path, module.FILES, replaces=True) as output:
            summary = module.run_into(
                scenario, output.folder, certified=not args.uncertified,
                figures=not args.no_figures, progress=progress)
    print(f"{module.format_summary(summary)}\n"
          f"written to {path}: {', '.join(sorted(output.kept))}")
    return 0 if summary["kept"] else BROKEN


def certify_own(args: argparse.Namespace, scenario: Scenario, path: Path) -> int:
    """Prints and writes the certificate of a scenario by its own module; 0 if it holds, else 1."""
    with (reported_in(scenario_source(args.scenario, set_options(args.overrides))),
          closing(Bar(CERTIFYING, stream_of(args), is_steady=False)) as progress):
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
