"""The command line: `uvms-drake run`, `certify`, `bench`, `campaign`, ...

The exit status is 0 if all went well, 1 if the run could not be carried through or the certificate
is void, 2 for bad input and 130 after Ctrl-C. An error is one line on stderr.
"""

import argparse
import json
import logging
import os
import shlex
import sys
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

# The matrices are small: threads cost more than they give, and very much on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from uvms_drake import __version__
from uvms_drake.certificate.certificate import (
    CERTIFICATE_FILE,
    Certificate,
    read_certificate,
    stale_reason,
    write_certificate,
)
from uvms_drake.command.progress import ProgressLine, alarms_above, announce_certifying
from uvms_drake.common.alarm import LOGGER
from uvms_drake.common.errors import InvalidParameter, RunFailed, ScenarioError, require
from uvms_drake.common.output import output_folder
from uvms_drake.station.record import LOG_FILE, SCENARIO_FILE, TIMING_FILE, Record, save_record
from uvms_drake.station.scenario import (
    Scenario,
    load_scenario,
    reported_in,
    scenario_source,
    set_options,
    shipped_scenarios,
)

# What takes long to import (simulation, summary, figures, replay) is imported where it is used.

PROGRAM = "uvms-drake"
MAIN_SCENARIO = "girona500_contact"
ERRATA_FILE = "errata.md"
SUMMARY_FILE = "summary.json"
REPLAY_FILE = "replay.html"
REPORT_FILE = "report.html"


class _UsageError(Exception):
    """The arguments do not make sense."""


class _Parser(argparse.ArgumentParser):
    """Raises instead of printing its usage in front of the error."""

    def error(self, message: str) -> NoReturn:
        raise _UsageError(f"{message} (see {self.prog} --help)")


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line and returns the exit status.

    Args:
        argv: The arguments, without the program's name; the process's own if it is None.
    """
    for logger in (logging.getLogger("drake"), LOGGER):
        logger.setLevel(logging.WARNING)
    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # A slow machine is no warning.
    try:
        args = make_parser().parse_args(argv)
        return args.command(args)
    except (_UsageError, ScenarioError, InvalidParameter) as error:
        return _report(error, 2)
    except RunFailed as error:
        return _report(error, 1)
    except KeyboardInterrupt:
        return _report("interrupted, nothing written", 130)


def _report(error: object, status: int) -> int:
    print(f"{PROGRAM}: error: {' '.join(str(error).split())}", file=sys.stderr)
    return status


def make_parser() -> argparse.ArgumentParser:
    """Returns the parser; the function of a subcommand is the `command` of its arguments."""
    parser = _Parser(prog=PROGRAM, allow_abbrev=False, description=(
        "Robust interaction control of underwater vehicle-manipulator systems."))
    parser.add_argument("--version", action="version", version=f"{PROGRAM} {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Parser)
    _add_run(commands)
    _add_plot(commands)
    _add_certify(commands)
    _add_bench(commands)
    _add_campaign(commands)
    _add_errata(commands)
    scenarios = commands.add_parser(
        "scenarios", help="list the shipped scenarios with motion and law", allow_abbrev=False)
    scenarios.set_defaults(command=list_scenarios)
    return parser


def _take_scenario(command: argparse.ArgumentParser) -> None:
    """Adds what names a scenario and changes it for once."""
    command.add_argument("scenario", nargs="?", default=MAIN_SCENARIO, metavar="SCENARIO",
                         help="name of a shipped scenario or a YAML file (default: %(default)s)")
    command.add_argument("--set", action="append", default=[], metavar="KEY.PATH=VALUE",
                         dest="overrides",
                         help="any value of the scenario, in YAML, such as limits.u.0=0.2; can be "
                              "repeated")


def _add_run(commands: argparse._SubParsersAction) -> None:
    run = commands.add_parser("run", help="simulate a scenario and write data and figures",
                              allow_abbrev=False)
    run.set_defaults(command=run_scenario)
    _take_scenario(run)
    run.add_argument("--output", type=Path, metavar="DIR",
                     help="where to write (default: out/<scenario>); files of a former run in it "
                          "are replaced or deleted, others left alone")
    run.add_argument("--seed", metavar="N", help="short for --set seed=N")
    run.add_argument("--duration", metavar="S", help="short for --set duration=S [s]")
    run.add_argument("--meshcat", action="store_true",
                     help="show the run in a browser, in real time")
    run.add_argument("--uncertified", action="store_true",
                     help="run without a certificate, with the tube that the scenario declares")
    run.add_argument("--no-figures", action="store_true",
                     help=f"write no PNG files and no {REPORT_FILE}")
    run.add_argument("--no-replay", action="store_true", help=f"write no {REPLAY_FILE}")


def _add_plot(commands: argparse._SubParsersAction) -> None:
    plot = commands.add_parser("plot", help=f"draw figures and {REPORT_FILE} of a run again",
                               allow_abbrev=False)
    plot.set_defaults(command=plot_run)
    plot.add_argument("folder", type=Path, metavar="DIR", help="where 'run' has written")
    plot.add_argument("--replay", action="store_true", help=f"also write {REPLAY_FILE}")


def _add_certify(commands: argparse._SubParsersAction) -> None:
    certify = commands.add_parser("certify", help="compute and check a scenario's certificate",
                                  allow_abbrev=False)
    certify.set_defaults(command=certify_scenario)
    _take_scenario(certify)
    certify.add_argument("--output", type=Path, metavar="DIR",
                         help="where to write certificate.json (default: out/<scenario>)")
    certify.add_argument("--front", action="store_true",
                         help="also print what other gains and disturbance bounds would give")
    certify.add_argument("--propose", type=float, metavar="BANDWIDTH",
                         help="also propose gains up to BANDWIDTH [1/s] for the smallest certified "
                              "force error")
    certify.add_argument("--laws", action="store_true",
                         help="also print both laws with several gains: certified radius, what an "
                              "adversary reaches, what the paper's form gives")


def _add_bench(commands: argparse._SubParsersAction) -> None:
    bench = commands.add_parser("bench", help="measure how long the parts of a scenario take",
                                allow_abbrev=False)
    bench.set_defaults(command=bench_scenario)
    _take_scenario(bench)
    bench.add_argument("--output", type=Path, metavar="DIR",
                       help="where to write bench.json (default: out/<scenario>)")


def _add_campaign(commands: argparse._SubParsersAction) -> None:
    campaign = commands.add_parser(
        "campaign", allow_abbrev=False,
        help="many runs with random starts, desired forces and disturbances within the bounds")
    campaign.set_defaults(command=run_campaign)
    _take_scenario(campaign)
    campaign.add_argument("--runs", type=int, default=100, metavar="N",
                          help="how many (default: %(default)s)")
    campaign.add_argument("--seed", type=int, default=0, metavar="S",
                          help="run i is drawn from this and from i (default: %(default)s)")
    where = campaign.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, metavar="W",
                       help="processes of this machine (default: one for each core)")
    where.add_argument("--scheduler", metavar="ADDRESS",
                       help="of a running Dask cluster, whose workers have this package installed")
    campaign.add_argument("--output", type=Path, metavar="DIR",
                          help="where to write (default: out/<scenario>-campaign); if runs of this "
                               "campaign are there, it goes on with the others")
    campaign.add_argument("--uncertified", action="store_true",
                          help="run without a certificate, with the tube that the scenario "
                               "declares")
    campaign.add_argument("--model-error", type=float, default=0.2, metavar="E",
                          help="largest relative error of the model that is drawn, as far as the "
                               "disturbance's bound covers it; 0 for a controller that knows "
                               "robot, surface and water exactly (default: %(default)s)")
    campaign.add_argument("--outside", action="store_true",
                          help="in every run one thing happens that the theory does not cover: "
                               "sensor faults, a stuck joint, a disturbance, current or error of "
                               "the model or of the surface that is too large")
    campaign.add_argument("--replay", type=int, metavar="INDEX",
                          help="run one of the campaign in --output once more, alone, and write "
                               "data and figures to its folder run-<INDEX>; the campaign decides "
                               "all other options")


def _add_errata(commands: argparse._SubParsersAction) -> None:
    errata = commands.add_parser("errata", help="compute what is wrong in the paper",
                                 allow_abbrev=False)
    errata.set_defaults(command=list_errata)
    errata.add_argument("--output", type=Path, metavar="DIR",
                        help="also write errata.md, and a figure for each of three choices that "
                             "the paper's text leaves, simulated both ways")


def certify_scenario(args: argparse.Namespace) -> int:
    """Prints the certificate, writes it, and returns 0 if it holds and 1 if it is void."""
    from uvms_drake.certificate.certify import certified_once
    from uvms_drake.certificate.table import format_certificate
    from uvms_drake.studies.compare_laws import compare_laws, format_laws
    from uvms_drake.studies.gain_front import format_front, front
    from uvms_drake.studies.propose_gains import propose_gains

    scenario = load_scenario(args.scenario, args.overrides)
    output = args.output if args.output is not None else Path("out") / scenario.name
    with output_folder(output, ()) as folder:
        with reported_in(scenario_source(args.scenario, args.overrides)):
            certificate = certified_once(scenario)
        write_certificate(certificate, folder)
        print(format_certificate(certificate))
        if args.front:
            print(f"\n{format_front(front(scenario))}")
        if args.propose is not None:
            law, error = propose_gains(scenario, args.propose)
            print(f"\nproposed: k = {law.k:g} 1/s, σ = {law.sigma:g} 1/s for a force error of "
                  f"{error:.3g} N at most")
        if args.laws:
            print(f"\n{format_laws(compare_laws(scenario))}")
    print(f"written to {output}: {CERTIFICATE_FILE}", file=sys.stderr)
    return 0 if certificate.certified else 1


def bench_scenario(args: argparse.Namespace) -> int:
    """Prints how long the parts of a scenario take, and writes it."""
    from uvms_drake.studies.bench import BENCH_FILE, measure, write_bench
    from uvms_drake.studies.bench_table import format_bench

    def progress(what: str) -> None:
        print(f"measuring {what} ...", file=sys.stderr)

    scenario = load_scenario(args.scenario, args.overrides)
    output = args.output if args.output is not None else Path("out") / scenario.name
    with output_folder(output, ()) as folder:
        with reported_in(scenario_source(args.scenario, args.overrides)):
            bench = measure(scenario, progress=progress)
        write_bench(bench, folder)
    print(format_bench(bench))
    print(f"written to {output}: {BENCH_FILE}", file=sys.stderr)
    return 0


def run_campaign(args: argparse.Namespace) -> int:
    """Runs a campaign, or one of its runs once more."""
    from uvms_drake.command.campaign import folder_of, replayed, run_campaign

    if args.replay is None:
        return run_campaign(args)
    for name, default in vars(make_parser().parse_args(["campaign"])).items():
        if name not in ("scenario", "output", "outside", "replay"):
            option = "--set" if name == "overrides" else f"--{name.replace('_', '-')}"
            require(getattr(args, name) == default, option, getattr(args, name),
                    "left out with --replay: the campaign in the folder decides it")
    campaign = folder_of(args, load_scenario(args.scenario))
    record = replayed(campaign, args.replay)
    output = campaign / f"run-{args.replay}"
    with output_folder(output, ()) as folder:
        text = write_data(record, folder)
        write_pictures(record, None, folder, figures=True, replay=False)
        names = sorted(path.name for path in folder.iterdir())
    print(f"{text}\n\nthe tube is the campaign's; a run of it has no certificate of its own\n"
          f"written to {output}: {', '.join(names)}")
    return 0


def list_errata(args: argparse.Namespace) -> int:
    """Prints the errata of the paper, as they are computed, and returns 1 if one is not confirmed.

    With an output folder, writes them as Markdown, and the figures of `choices`.
    """
    from uvms_drake.errata import all_errata, errata_markdown, errata_table
    from uvms_drake.errata.choices import draw_choices

    def progress(what: str) -> None:
        print(f"drawing {what} ...", file=sys.stderr)

    LOGGER.setLevel(logging.ERROR)  # What is drawn goes wrong on purpose.
    if args.output is None:
        errata = all_errata()
    else:
        with output_folder(args.output, ()) as folder:
            errata = all_errata()
            (folder / ERRATA_FILE).write_text(errata_markdown(errata) + "\n", encoding="utf-8")
            draw_choices(folder, progress)
    print(errata_table(errata))
    return 0 if all(erratum.wrong for erratum in errata) else 1


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


def plot_run(args: argparse.Namespace) -> int:
    """Draws what a finished run left, from its data."""
    from uvms_drake.report.html import load_run

    record, certificate = load_run(args.folder)
    with output_folder(args.folder, ()) as folder:
        write_pictures(record, certificate, folder, figures=True, replay=args.replay)
        names = sorted(path.name for path in folder.iterdir())
    print(f"written to {args.folder}: {', '.join(names)}")
    return 0


def run_scenario(args: argparse.Namespace) -> int:
    """Simulates a scenario, prints the summary and writes the files."""
    from uvms_drake.report.figures import FIGURES

    overrides = scenario_overrides(args)
    scenario = load_scenario(args.scenario, overrides)
    source = scenario_source(args.scenario, overrides)
    output = args.output if args.output is not None else Path("out") / scenario.name
    owned = (SCENARIO_FILE, LOG_FILE, TIMING_FILE, SUMMARY_FILE, REPLAY_FILE, REPORT_FILE,
             CERTIFICATE_FILE, *FIGURES)
    certificate = None
    with output_folder(output, owned) as folder:
        if not args.uncertified:
            again = shlex.join([PROGRAM, "certify", args.scenario, *set_options(overrides),
                                "--output", str(output)])
            certificate = _certificate(scenario, source, output / CERTIFICATE_FILE, again)
            write_certificate(certificate, folder)
            scenario = certificate.applied_to(scenario)
            print("certified: the force is off by less than "
                  f"{certificate.bounds['force']:.3g} N once the plan is at the task",
                  file=sys.stderr)
        record = _simulate(scenario, source, args.meshcat, certified=not args.uncertified)
        text = write_data(record, folder)
        write_pictures(record, certificate, folder, figures=not args.no_figures,
                       replay=not args.no_replay)
        names = sorted(path.name for path in folder.iterdir())
    print(f"{text}\n\nwritten to {output}: {', '.join(names)}")
    return 0


def scenario_overrides(args: argparse.Namespace) -> list[str]:
    """Returns the overrides of the arguments; --seed and --duration go over --set."""
    named = (("seed", args.seed), ("duration", args.duration))
    return [*args.overrides, *(f"{key}={value}" for key, value in named if value is not None)]


def _certificate(scenario: Scenario, source: str, path: Path, again: str) -> Certificate:
    """Returns the certificate of a run: the one in its folder if it is fit, else a new one.

    One that `certify` has written is a commitment: if it no longer fits, the run is refused, and
    the command `again` named, which makes it for this scenario. One that a former run has written
    is that run's, and makes room for a new one.
    """
    from uvms_drake.certificate.certify import certified_once, check_inputs
    from uvms_drake.certificate.table import verdict

    with reported_in(source):
        check_inputs(scenario)
        certificate = read_certificate(path) if path.is_file() else None
        if certificate is not None and (changed := stale_reason(certificate, scenario)):
            if certificate.made_by == "certify":
                raise RunFailed(f"{path}: stale, {changed} has changed since 'certify' made it; "
                                f"use another --output, or make it again: {again}")
            certificate = None
        if certificate is None:
            certificate = replace(certified_once(scenario, announce_certifying), made_by="run")
    if not certificate.certified:
        raise RunFailed(f"{source}: {verdict(certificate)}; "
                        "--uncertified takes the scenario's declared tube")
    return certificate


def _simulate(scenario: Scenario, source: str, show: bool, certified: bool) -> Record:
    """Returns the record of a run, with progress and alarms on stderr."""
    from uvms_drake.station.simulation import simulate

    meshcat = stop = None
    if show:
        from pydrake.geometry import Meshcat

        from uvms_drake.visual.controls import stop_button

        meshcat = Meshcat()
        stop = stop_button(meshcat)
        print(f"watch at {meshcat.web_url()}", file=sys.stderr)
    with (closing(ProgressLine(scenario.duration, sys.stderr)) as progress, alarms_above(progress),
          reported_in(source)):
        return simulate(scenario, certified=certified, meshcat=meshcat, progress=progress,
                        stop=stop, realtime_rate=1.0 if show else None)


def write_data(record: Record, folder: Path) -> str:
    """Writes the data of a run into a folder and returns its summary as text."""
    from uvms_drake.report.summary import format_summary, summarise

    summary = summarise(record)
    save_record(record, folder)
    text = json.dumps(summary, indent=2, allow_nan=False, ensure_ascii=False)
    (folder / SUMMARY_FILE).write_text(text + "\n", encoding="utf-8")
    return format_summary(summary)


def write_pictures(record: Record, certificate: Certificate | None, folder: Path, *,
                   figures: bool, replay: bool) -> None:
    """Writes what there is to see of a run into a folder; the report comes with the figures."""
    if figures:
        from uvms_drake.report.figures import make_figures
        from uvms_drake.report.html import format_report

        report = format_report(record, make_figures(record, folder), certificate)
        (folder / REPORT_FILE).write_text(report, encoding="utf-8")
    if replay:
        from uvms_drake.report.replay import write_replay

        write_replay(record, folder / REPLAY_FILE)
