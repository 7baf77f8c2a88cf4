"""The sub-commands `run` and `plot`: simulate a scenario, draw its figures and report."""

import argparse
import shlex
import sys
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO, TypeVar

from uvms_drake.certificate.cache import stored
from uvms_drake.certificate.certificate import (
    CERTIFICATE_FILE,
    Certificate,
    stale_reason,
    write_certificate,
)
from uvms_drake.certificate.in_probability import (
    AnyCertificate,
    ProbabilityCertificate,
    cache_key,
    read_any_certificate,
)
from uvms_drake.command.files import (
    BROKEN,
    DATA_FILES,
    MAIN_SCENARIO,
    REPLAY_FILE,
    REPORT_FILE,
    folder,
    picture_files,
    take_scenario,
    write_data,
    write_pictures,
)
from uvms_drake.command.interrupt import PROGRAM, postponed
from uvms_drake.command.paper import run_own
from uvms_drake.command.progress import CERTIFYING, Bar, alarms_above, stream_of
from uvms_drake.common.errors import RunFailed, require
from uvms_drake.common.output import output_folder
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.problem import load_model
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import Scenario, load_scenario, remarks
from uvms_drake.station.scenario.scenario_file import (
    reported_in,
    scenario_source,
    set_options,
    shipped_scenarios,
)

if TYPE_CHECKING:
    from pydrake.geometry import Meshcat

# Slow imports (simulation, summary, figures, replay) are local to their functions.

AnyCert = TypeVar("AnyCert", Certificate, AnyCertificate)

EPILOG = f"""\
scenarios that are shipped (see 'uvms-drake scenarios'):
  {', '.join(shipped_scenarios())}

keys that are changed most, of {MAIN_SCENARIO} ('uvms-drake keys' lists all):
  duration, seed, start.eta, start.q, task.force, surface.law.stiffness, surface.geometry.point,
  surface.friction, contact.stiffness, contact.force, disturbance.bound, current, ancillary.k,
  ancillary.sigma, mpc.horizon, mpc.time_step, limits.u, limits.nu1, simulator.max_step_size,
  log_period

A file of your own that begins with 'base: girona500_ideal' has only the differences.

Exit status {BROKEN}: a certified run has left its tube, or pressed a wall that is not of its class;
or a run has violated a limit, or is not of the distribution of its certificate in probability.
Ctrl-C ends a run: the data up to then are written, without figures ('uvms-drake plot'), status 130.
"""


def add_run(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    run = commands.add_parser("run", help="simulate a scenario and write data and figures",
                              allow_abbrev=False, epilog=EPILOG,
                              formatter_class=argparse.RawDescriptionHelpFormatter)
    run.set_defaults(command=run_scenario)
    take_scenario(run)
    run.add_argument("--output", type=folder, metavar="DIR",
                     help="folder to write to (default: out/<scenario>); files of a former run in "
                          "it are replaced or deleted, and no others")
    run.add_argument("--seed", metavar="N", help="short for --set seed=N")
    run.add_argument("--duration", metavar="S", help="short for --set duration=S [s]")
    run.add_argument("--meshcat", action="store_true",
                     help="show the run in a browser, in real time: it begins when a browser has "
                          "opened the page, which stays until the button on it or Ctrl-C")
    run.add_argument("--host", metavar="ADDRESS",
                     help="with --meshcat: address of this machine that the page is served at, or "
                          "'*' for all of them; whoever reaches it can move the sliders and stop "
                          "the run (default: localhost, this machine alone)")
    run.add_argument("--no-wait", action="store_true",
                     help="with --meshcat: do not wait, neither before nor after the run")
    run.add_argument("--uncertified", action="store_true",
                     help="run without a certificate, with the tube that the scenario declares")
    run.add_argument("--no-figures", action="store_true",
                     help=f"write no PNG files and no {REPORT_FILE}")
    run.add_argument("--no-replay", action="store_true", help=f"write no {REPLAY_FILE}")


def add_plot(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    plot = commands.add_parser("plot", help=f"draw figures and {REPORT_FILE} of a run again",
                               allow_abbrev=False)
    plot.set_defaults(command=plot_run)
    plot.add_argument("folder", type=folder, metavar="DIR", help="folder that 'run' has written")
    plot.add_argument("--replay", action="store_true", help=f"also write {REPLAY_FILE}")
    plot.add_argument("--mcap", action="store_true",
                      help="also write log.mcap, for Foxglove (pip install 'uvms_drake[mcap]')")


def run_scenario(args: argparse.Namespace) -> int:
    """Simulates a scenario, prints the summary and writes the files."""
    from uvms_drake.station.step_size import with_step

    require(args.meshcat or args.host is None, "--host", args.host, "left out without --meshcat")
    overrides = scenario_overrides(args)
    options = [*set_options(args.overrides), *(f"--{name}={value}" for name, value in _named(args))]
    scenario = load_scenario(args.scenario, overrides, options)
    source = scenario_source(args.scenario, options)
    path = args.output if args.output is not None else Path("out") / scenario.name
    if scenario.simulation:
        return run_own(args, scenario, path)
    # The certificate that `certify` or a former run has left, if it fits.
    certificate = None
    with reported_in(source):
        model = load_model(scenario)
    if not args.uncertified:
        again = shlex.join([PROGRAM, "certify", args.scenario, *set_options(overrides),
                            "--output", str(path)])
        certificate = _committed(scenario, model, source, path / CERTIFICATE_FILE, again)
    own = (*DATA_FILES, *picture_files(), *([] if certificate else [CERTIFICATE_FILE]))
    with output_folder(path, own, replaces=True) as output:
        if not args.uncertified:
            if certificate is None:
                certificate = _new_certificate(scenario, model, source, stream_of(args))
                write_certificate(certificate, output.folder)
            scenario = certificate.applied_to(scenario)
            for line in _announced(certificate, scenario, model):
                print(line, file=sys.stderr)
        # The run itself, and its files; an interrupted run is kept, too.
        with reported_in(source):
            scenario = with_step(scenario, model)
            note(scenario)
        show = _open_meshcat(args) if args.meshcat else None
        with postponed() as interrupted:
            record = _simulate(args, scenario, model, source, show, interrupted,
                               certified=isinstance(certificate, Certificate))
            summary = write_data(record, output.folder, certificate)
            output.keep(replaces=True)  # Even if the pictures fail.
        failed = failures_in_words(record, certificate, summary)
        write_pictures(record, certificate, output.folder, figures=not args.no_figures,
                       replay=not args.no_replay, failed=failed)
    status = _report(summary, path, output.kept, failed)
    if show is not None and not args.no_wait:
        from uvms_drake.visual.controls import wait_for_end

        print(f"still at {show.web_url()}: Ctrl-C, or the button there, ends it", file=sys.stderr)
        wait_for_end(show)
    return status


def _report(summary: dict[str, Any], path: Path, names: list[str], failed: list[str]) -> int:
    """Prints the summary of a run, its files and the verdict; returns the exit status."""
    from uvms_drake.report.summary import format_summary

    certified = summary["tube"]["certified"]
    print(f"{format_summary(summary)}\n\nwritten to {path}: {', '.join(sorted(names))}")
    if summary["in_probability"] is not None:
        return _report_in_probability(summary, failed)
    if failed:
        print(f"{'GUARANTEES BROKEN' if certified else 'LIMITS VIOLATED'}: {', '.join(failed)}")
        return BROKEN
    if certified and (out := summary["contact"].get("out_of_class")):
        print("NO GUARANTEE for this wall: the certificate is for walls of the class that "
              f"`contact` declares, and it was not of it ({', '.join(out)})")
        return BROKEN
    print("all guarantees kept" if certified else "all limits kept, without a certificate")
    return 0


def failures_in_words(record: Record, certificate: AnyCertificate | None, summary: dict[str, Any]
                      ) -> list[str]:
    """Returns the ways in which a run failed, of `broken`.

    One of the declared distribution of a certificate in probability fails as the certificate's own
    would.
    """
    from uvms_drake.report.summary import NAMED, broken

    failed, claim = broken(summary), summary["in_probability"]
    if isinstance(certificate, ProbabilityCertificate) and not claim["outside"]:
        from uvms_drake.campaign.probability.failures import failures_of
        from uvms_drake.campaign.run import outcome
        from uvms_drake.certificate.in_probability import FAILURES

        result = {"error": None, **outcome(record)}
        failed += [f"it {FAILURES[kind]}" for kind in failures_of(result) if kind not in NAMED]
    return failed


def _report_in_probability(summary: dict[str, Any], failed: list[str]) -> int:
    """Prints the verdict of a run with a certificate in probability; returns the exit status."""
    claim = summary["in_probability"]
    print(f"this run FAILED: {', '.join(failed)}" if failed else
          "this run did not fail: tube and all limits kept")
    print("; ".join(claim["outside"]) or claim["verdict"])
    return BROKEN if failed or claim["outside"] else 0


def _announced(certificate: AnyCertificate, scenario: Scenario, model: ContactModel) -> list[str]:
    """Returns the lines that a run begins with: kind and scope of its certificate."""
    if isinstance(certificate, ProbabilityCertificate):
        return [certificate.verdict]
    from uvms_drake.certificate.table import scope

    return [*scope(certificate), f"certified: {certificate.force_sentence}"]


def plot_run(args: argparse.Namespace) -> int:
    """Draws figures and report of a finished run, from its data."""
    from uvms_drake.report.html import load_run
    from uvms_drake.report.log_export import MCAP_FILE, write_mcap
    from uvms_drake.report.summary import summarise

    record, certificate = load_run(args.folder)
    failed = failures_in_words(record, certificate, summarise(record, certificate))
    with output_folder(args.folder, (*picture_files(), MCAP_FILE)) as output:
        if args.mcap:
            write_mcap(record, output.folder / MCAP_FILE)
        write_pictures(record, certificate, output.folder, figures=True, replay=args.replay,
                       failed=failed)
    print(f"written to {args.folder}: {', '.join(output.kept)}")
    return 0


def scenario_overrides(args: argparse.Namespace) -> list[str]:
    """Returns the overrides of the arguments; --seed and --duration go over --set."""
    return [*args.overrides, *(f"{key}={value}" for key, value in _named(args))]


def _named(args: argparse.Namespace) -> list[tuple[str, str]]:
    """Returns the given keys with an option of their own, with their values."""
    named = (("seed", args.seed), ("duration", args.duration))
    return [(key, value) for key, value in named if value is not None]


def _committed(scenario: Scenario, model: ContactModel, source: str, path: Path, again: str
               ) -> AnyCertificate | None:
    """Returns the certificate in a run's folder if it fits, or None if a new one is needed.

    One that `certify` has written is a commitment: if it no longer fits, the run is refused, with
    the command `again` that computes it for this scenario. One of a former run is replaced.
    """
    from uvms_drake.certificate.certify import check_inputs

    with reported_in(source):
        check_inputs(scenario, model)
    if not path.is_file():
        return None
    certificate = read_any_certificate(path)
    if changed := stale_reason(certificate, scenario):
        if certificate.made_by == "certify":
            if isinstance(certificate, ProbabilityCertificate):  # Its runs are of another campaign.
                again += f" --runs {certificate.runs} --seed {certificate.seed}, in a new folder"
            raise RunFailed(f"{path}: stale, {changed} has changed since 'certify' made it; "
                            f"use another --output, or make it again: {again}")
        return None
    return sound(certificate, source)


def _new_certificate(scenario: Scenario, model: ContactModel, source: str, stream: TextIO
                     ) -> AnyCertificate:
    """Returns the worst-case certificate; if it does not hold, one in probability from the cache.

    Raises:
        RunFailed: There is neither.
    """
    from uvms_drake.certificate.certify import certified_once

    with reported_in(source), closing(Bar(CERTIFYING, stream, is_steady=False)) as progress:
        certificate = certified_once(scenario, progress, model)
    known = None if certificate.certified else stored(cache_key(scenario))
    if known is not None:
        return sound(replace(ProbabilityCertificate.from_data(known), made_by="run"), source)
    return sound(replace(certificate, made_by="run"), source)


def note(scenario: Scenario) -> None:
    """Notes on stderr the values of a scenario without effect."""
    for line in remarks(scenario):
        print(f"note: {line}", file=sys.stderr)


def sound(certificate: AnyCert, source: str) -> AnyCert:
    """Returns a certificate that holds, or raises `RunFailed`; one in probability is none less."""
    from uvms_drake.certificate.table import verdict

    if isinstance(certificate, ProbabilityCertificate):
        if not certificate.holds:
            raise RunFailed(f"{source}: {certificate.verdict}; --uncertified takes the scenario's "
                            "declared tube")
    elif not certificate.certified:
        raise RunFailed(f"{source}: {verdict(certificate)}; 'certify --runs N' bounds the "
                        "probability that a run fails; --uncertified takes the scenario's "
                        "declared tube")
    return certificate


def _open_meshcat(args: argparse.Namespace) -> "Meshcat":
    """Returns a Meshcat with a browser on it, or at once with --no-wait."""
    from uvms_drake.visual.controls import wait_for_browser
    from uvms_drake.visual.stage import LOCAL, open_meshcat

    meshcat = open_meshcat(args.host or LOCAL)
    waiting = "" if args.no_wait else "; the run begins when a browser has opened it"
    print(f"watch at {meshcat.web_url()}{waiting}", file=sys.stderr)
    if not args.no_wait:
        wait_for_browser(meshcat)
    return meshcat


def _simulate(args: argparse.Namespace, scenario: Scenario, model: ContactModel, source: str,
              meshcat: "Meshcat | None", interrupted: Callable[[], bool], *, certified: bool
              ) -> Record:
    """Returns the record of a run, with progress and alarms on stderr.

    The button in Meshcat, or an interrupt, ends it before its duration. `certified` is whether the
    tube is that of a worst-case certificate.
    """
    from uvms_drake.station.simulation import simulate
    from uvms_drake.visual.controls import stop_button

    pressed = interrupted if meshcat is None else stop_button(meshcat)
    with ExitStack() as stack:
        stack.enter_context(reported_in(source))
        progress = stack.enter_context(closing(Bar("simulating", stream_of(args))))
        if not args.quiet:  # Else alarms go to Python's logging.
            stack.enter_context(alarms_above(progress))
        return simulate(scenario, model=model, certified=certified, meshcat=meshcat,
                        progress=progress, stop=lambda: interrupted() or pressed(),
                        realtime_rate=None if meshcat is None else 1.0)
