"""The sub-command `certify`: computes, checks and writes a scenario's certificate."""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

import numpy as np

from uvms_drake.certificate.certificate import (
    CERTIFICATE_FILE,
    Certificate,
    write_certificate,
)
from uvms_drake.command.campaign import take_workers
from uvms_drake.command.files import folder, take_scenario
from uvms_drake.command.paper import (
    beside_the_paper,
    check_comparisons,
    print_laws,
    take_comparisons,
)
from uvms_drake.command.progress import CERTIFYING, Bar, stream_of
from uvms_drake.command.run import note
from uvms_drake.common.errors import require
from uvms_drake.common.jsonable import jsonable
from uvms_drake.common.output import output_folder
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.station.motions.motion import Motion
from uvms_drake.station.motions.motions import motion_of
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.scenario.scenario_file import reported_in, scenario_source, set_options

BUDGET_FILE = "budget.png"
TOLERANCES_FILE = "tolerances.json"


def add_certify(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    certify = commands.add_parser("certify", help="compute and check a scenario's certificate",
                                  allow_abbrev=False)
    certify.set_defaults(command=certify_scenario, parser=certify)
    take_scenario(certify)
    certify.add_argument("--output", type=folder, metavar="DIR",
                         help="folder of certificate.json and, with a budget, budget.png "
                              "(default: out/<scenario>)")
    certify.add_argument("--full", action="store_true",
                         help="print everything: constants, conditions, tube, budget, estimates")
    certify.add_argument("--tolerances", action="store_true",
                         help="also print, and write to tolerances.json, the largest value of each "
                              "source of error alone: noise, lag, stiffness, mass, current, ...")
    certify.add_argument("--sweep-gains", action="store_true",
                         help="also print the Pareto front over gains and disturbance bounds")
    certify.add_argument("--tune", type=float, metavar="BANDWIDTH",
                         help="also propose gains up to BANDWIDTH [1/s] for the smallest certified "
                              "force error")
    take_comparisons(certify)
    runs = certify.add_argument_group("certificate in probability, from drawn runs")
    runs.add_argument("--runs", type=int, metavar="N",
                      help="draw N runs of the declared distribution and bound the probability "
                           "that a run leaves the declared tube, violates a limit or loses the "
                           "contact; no worst-case certificate is computed. The runs are kept in "
                           "the folder runs inside of DIR: the same command continues them")
    runs.add_argument("--confidence", type=float, default=0.95, metavar="C",
                      help="confidence of that bound (default: %(default)s)")
    runs.add_argument("--seed", type=int, default=0, metavar="S",
                      help="run i is drawn from this and from i (default: %(default)s)")
    take_workers(certify)


def certify_scenario(args: argparse.Namespace) -> int:
    """Prints and writes the certificate; returns 0 if it holds, else 1.

    With --runs it is one in probability, and 3 is returned if a run failed.
    """
    names = [CERTIFICATE_FILE, BUDGET_FILE, TOLERANCES_FILE]
    if args.runs is not None:
        from uvms_drake.command.drawn_runs import certify_by_runs

        _require_default(args, ("tolerances", "sweep_gains", "tune", "paper", "compare_laws"),
                         "with --runs")
        return certify_by_runs(args, names)
    _require_default(args, ("confidence", "seed", "workers", "scheduler"), "without --runs")
    from uvms_drake.certificate.certify import certified_once, check_inputs
    from uvms_drake.certificate.overview import force_bounds, format_overview
    from uvms_drake.certificate.table import format_certificate
    from uvms_drake.station.step_bounds import largest_step
    from uvms_drake.station.step_size import floored
    from uvms_drake.studies.margins.margins import format_margins, margins
    from uvms_drake.studies.pareto_front import format_pareto_front, pareto_front
    from uvms_drake.studies.propose_gains import propose_gains

    # Bad input of any kind is refused before anything is computed.
    scenario = load_scenario(args.scenario, args.overrides)
    source = scenario_source(args.scenario, set_options(args.overrides))
    require(args.tune is None or 0.0 < args.tune < np.inf, "--tune", args.tune, "positive")
    with reported_in(source):
        _check_studies(args, motion_of(scenario), scenario.ancillary)
    path = args.output if args.output is not None else Path("out") / scenario.name
    with output_folder(path, names, replaces=True) as output:
        with reported_in(source):
            model = check_inputs(scenario)  # Before anything is announced.
            note(scenario)
            started = time.perf_counter()
            with closing(Bar(CERTIFYING, stream_of(args), is_steady=False)) as progress:
                certificate = certified_once(scenario, progress, model)
            seconds = time.perf_counter() - started
            certificate = beside_the_paper(args, certificate, scenario, model)
        write_certificate(certificate, output.folder)
        _draw_budget(certificate, output.folder)
        files = sorted((item.name for item in output.folder.iterdir()), reverse=True)
    force = force_bounds(
        certificate, scenario.contact.force_limit(scenario.limits), scenario.task.force)
    print(format_overview(certificate, force, seconds))
    print(f"\n{format_certificate(certificate)}" if args.full or args.paper else
          "everything: --full")
    print(f"written to {path}: {', '.join(files)}", file=sys.stderr)
    # Requested studies.
    if args.tolerances and not certificate.certified:
        print("\nno tolerances: the scenario is not certified")
    elif args.tolerances:
        with closing(Bar("computing the tolerances", stream_of(args))) as progress:
            found = margins(scenario, model, progress=progress)
        print(f"\n{format_margins(found)}")
        with output_folder(path, [TOLERANCES_FILE]) as output:
            (output.folder / TOLERANCES_FILE).write_text(json.dumps(jsonable(
                [asdict(each) for each in found]), indent=2) + "\n", encoding="utf-8")
        print(f"written to {path}: {TOLERANCES_FILE}", file=sys.stderr)
    if args.sweep_gains:
        with closing(Bar("computing the Pareto front", stream_of(args))) as progress:
            points = pareto_front(scenario, model, progress=progress)
        print(f"\n{format_pareto_front(points)}")
    if args.tune is not None:
        with reported_in(source):
            law, error = propose_gains(scenario, model, args.tune)
        print(f"\nproposed: k = {law.k:g} 1/s, σ = {law.sigma:g} 1/s for a force error of "
              f"{error:.3g} N at most")
        scheme = scenario.simulator.integration_scheme
        step = largest_step(scheme, np.array([-law.k, -law.sigma]))
        if step < scenario.simulator.max_step_size:
            print(f"they need simulator.max_step_size = {floored(step):g} s or less with {scheme}")
    print_laws(args, scenario, model)
    return 0 if certificate.certified else 1


def _require_default(args: argparse.Namespace, options: Sequence[str], where: str) -> None:
    """Raises `InvalidParameter` for the first given option that must be left out."""
    for name in options:
        value = getattr(args, name)
        require(value == args.parser.get_default(name), f"--{name.replace('_', '-')}", value,
                f"left out {where}")


def _draw_budget(certificate: Certificate, folder: Path) -> None:
    """Draws the error budget, or that of the coupled loop, if it exists and is finite."""
    budget, margin = certificate.budget, certificate.margin
    parts = [part for parts in budget.values() for part in parts.values()]
    if parts and np.isfinite(parts).all():
        import matplotlib

        from uvms_drake.report.figure.budget_figure import draw_budget
        from uvms_drake.report.figure_style import STYLE

        with matplotlib.rc_context(STYLE):
            draw_budget(budget, margin).savefig(folder / BUDGET_FILE)


def _check_studies(args: argparse.Namespace, motion: Motion, law: AncillaryLaw) -> None:
    """Raises `InvalidParameter` for the first requested study that does not apply."""
    from uvms_drake.studies.pareto_front import check_pareto_front

    if args.sweep_gains:
        check_pareto_front(motion, law)
    check_comparisons(args, motion, law)
    for option in ("tune", "tolerances"):
        require(getattr(args, option) in (None, False) or motion.has_forces,
                "motion", motion.name, f"dynamic, for --{option.replace('_', '-')}")
