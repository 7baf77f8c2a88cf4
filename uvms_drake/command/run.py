"""The sub-commands `run` and `plot`: simulate a scenario, write its data, figures and report."""

import argparse
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uvms_drake.certificate.certificate import CERTIFICATE_FILE, Certificate, write_certificate
from uvms_drake.certificate.run_verdict import BROKEN, FAILED
from uvms_drake.command import certificates, files
from uvms_drake.command.interrupt import postponed
from uvms_drake.command.paper import run_own
from uvms_drake.command.progress import alarms_above, bar
from uvms_drake.common.errors import require
from uvms_drake.common.output import output_folder
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.scenario.scenario_file import reported_in, set_options, shipped_scenarios

if TYPE_CHECKING:
    from pydrake.geometry import Meshcat

# Slow imports (simulation, summary, figures, replay) are local to their functions.

EPILOG = f"""\
scenarios that are shipped (see 'uvms-drake scenarios'):
  {', '.join(shipped_scenarios())}

keys that are changed most, of {files.MAIN_SCENARIO} ('uvms-drake keys' lists all):
  duration, seed, start.eta, start.q, task.force, surface.law.stiffness, surface.geometry.point,
  surface.friction, contact.stiffness, contact.force, disturbance.bound, current, ancillary.k,
  ancillary.sigma, mpc.horizon, mpc.time_step, limits.u, limits.nu1, simulator.max_step_size,
  log_period

A file of your own that begins with 'base: girona500_ideal' has only the differences.

Exit status {BROKEN}: the run has passed a limit, of which contact.force is one, or left its tube,
declared or certified, or pressed a wall that is not of its declared class; a certified one also if
a command was cut or the MPC had no plan; or it is not of the distribution of its certificate in
probability. Exit status {FAILED}: an exception of a law, the
MPC, a sensor or the plant ended it, and what was simulated until then is written.
Ctrl-C ends a run: the data up to then are written, without figures ('uvms-drake plot'), status 130.
"""


def add_run(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    run = commands.add_parser("run", help="simulate a scenario and write data and figures",
                              allow_abbrev=False, epilog=EPILOG,
                              formatter_class=argparse.RawDescriptionHelpFormatter)
    run.set_defaults(command=run_scenario, parser=run)
    files.take_scenario(run)
    run.add_argument("--output", type=files.folder, metavar="DIR",
                     help="folder to write to (default: out/<scenario>); files of a former run in "
                          "it are replaced or deleted, and no others")
    for key, unit, text in (("seed", "N", "N"), ("duration", "S", "S [s]")):
        run.add_argument(f"--{key}", action="append", default=[], metavar=unit, dest="overrides",
                         type=f"{key}={{}}".format, help=f"short for --set {key}={text}")
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
    run.add_argument("--full", action="store_true",
                     help="print the whole summary, with every limit, and not a screen of it")
    run.add_argument("--no-figures", action="store_true",
                     help=f"write no PNG files and no {files.REPORT_FILE}")
    run.add_argument("--no-replay", action="store_true", help=f"write no {files.REPLAY_FILE}")


def add_plot(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    plot = commands.add_parser("plot", help=f"draw figures and {files.REPORT_FILE} of a run again",
                               allow_abbrev=False)
    plot.set_defaults(command=plot_run)
    plot.add_argument("folder", type=files.folder, metavar="DIR",
                      help="folder that 'run' has written")
    plot.add_argument("--replay", action="store_true", help=f"also write {files.REPLAY_FILE}")
    plot.add_argument("--mcap", action="store_true",
                      help="also write log.mcap, for Foxglove (pip install 'uvms_drake[mcap]')")


def run_scenario(args: argparse.Namespace) -> int:
    """Simulates a scenario, prints the summary and writes the files."""
    from uvms_drake.station.problem import check_inputs, load_model
    from uvms_drake.station.step_size import with_step

    require(args.meshcat or args.host is None, "--host", args.host, "left out without --meshcat")
    require(args.meshcat or not args.no_wait, "--no-wait", True, "left out without --meshcat")
    scenario, source, path = files.asked(args)
    if scenario.simulation:
        return run_own(args, scenario, source, path)
    with reported_in(source):
        model = load_model(scenario) if args.uncertified else check_inputs(scenario)
        if args.uncertified:
            certificates.compare_class(scenario, model)
    kept = None if args.uncertified else certificates.kept_certificate(
        path / CERTIFICATE_FILE, scenario, source,
        ["certify", args.scenario, *set_options(args.overrides), "--output", str(path)],
        named=args.output is not None)
    own = (*files.DATA_FILES, *files.picture_files(), *([] if kept else [CERTIFICATE_FILE]))
    with output_folder(path, own, replaces=True) as output:
        certificate = kept
        if not args.uncertified:
            if certificate is None:
                certificate = certificates.new_certificate(args, scenario, model, source)
                write_certificate(certificate, output.folder)
            scenario = certificate.applied_to(scenario)
            certificates.announce(certificate, scenario)
        with reported_in(source):
            scenario = with_step(scenario, model)
            certificates.note(scenario)
        meshcat = _open_meshcat(args) if args.meshcat else None
        # An interrupted run is kept, too; and any run, even if the pictures fail.
        with postponed() as interrupted:
            with reported_in(source):
                record = _simulate(args, scenario, model, meshcat, interrupted,
                                   certified=isinstance(certificate, Certificate))
            summary = files.write_data(record, output, certificate)
        files.write_pictures(record, certificate, output.folder, summary,
                             figures=not args.no_figures, replay=not args.no_replay)
    status = print_outcome(summary, path, output.kept, full=args.full)
    if meshcat is not None and not args.no_wait:
        from uvms_drake.visual.controls import wait_for_end

        print(f"still at {meshcat.web_url()}: Ctrl-C, or the button there, ends it",
              file=sys.stderr)
        wait_for_end(meshcat)
    return status


def print_outcome(summary: dict[str, Any], path: Path, names: Sequence[str], *,
                  full: bool = False) -> int:
    """Prints the summary of a run, its files and the verdict; returns the exit status."""
    from uvms_drake.report.summary import format_summary

    verdict = summary["verdict"]
    print(f"{format_summary(summary, full=full)}\n\n"
          f"{'' if full else 'everything: --full, summary.json; '}"
          f"written to {path}: {', '.join(sorted(names))}\n{verdict['text']}")
    return int(verdict["status"])


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


def _simulate(args: argparse.Namespace, scenario: Scenario, model: ContactModel,
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
        progress = stack.enter_context(bar(args, "simulating"))
        if not args.quiet:  # Else alarms go to Python's logging.
            stack.enter_context(alarms_above(progress))
        return simulate(scenario, model=model, certified=certified, meshcat=meshcat,
                        progress=progress, stop=lambda: interrupted() or pressed(),
                        realtime_rate=None if meshcat is None else 1.0)


def plot_run(args: argparse.Namespace) -> int:
    """Draws figures and report of a finished run, from its data."""
    from uvms_drake.report.html import load_run
    from uvms_drake.report.log_export import MCAP_FILE, write_mcap

    record, certificate = load_run(args.folder)
    with output_folder(args.folder, (*files.picture_files(), MCAP_FILE)) as output:
        if args.mcap:
            write_mcap(record, output.folder / MCAP_FILE)
        summary = files.summary_of(record, certificate)
        files.write_pictures(record, certificate, output.folder, summary, figures=True,
                             replay=args.replay)
    print(f"written to {args.folder}: {', '.join(output.kept)}")
    return 0
