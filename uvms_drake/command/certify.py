"""The sub-command `certify`: computes, checks and writes a scenario's certificate."""

import argparse
import sys
import time

from uvms_drake.certificate.certificate import CERTIFICATE_FILE, write_certificate
from uvms_drake.command.campaign import take_workers
from uvms_drake.command.certificates import compare_class, note
from uvms_drake.command.files import asked, folder, left_out, take_scenario
from uvms_drake.command.largest import find_largest, take_largest
from uvms_drake.command.paper import certify_own
from uvms_drake.command.progress import CERTIFYING, bar
from uvms_drake.common.output import output_folder
from uvms_drake.station.scenario.scenario_file import reported_in


def add_certify(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    certify = commands.add_parser("certify", help="compute and check a scenario's certificate",
                                  allow_abbrev=False)
    certify.set_defaults(command=certify_scenario, parser=certify)
    take_scenario(certify)
    certify.add_argument("--output", type=folder, metavar="DIR",
                         help="folder of the files (default: out/<scenario>)")
    certify.add_argument("--full", action="store_true",
                         help="print everything: constants, conditions, tube, budget, estimates")
    take_largest(certify)
    runs = certify.add_argument_group("certificate in probability, from drawn runs")
    runs.add_argument("--runs", type=int, metavar="N",
                      help="draw N runs of the declared distribution and bound the probability "
                           "that a run fails: leaves the declared tube, violates a limit, loses "
                           "the contact, ends a hold off the force line, or in another way that "
                           "--full lists; no worst-case certificate is computed. The seed "
                           "follows from scenario, program and N, and each attempt at a task is "
                           "counted. The runs are kept in the folder runs inside of DIR: the "
                           "same command continues them. If none fails, 20 runs bound it by "
                           "16.9 %% at the first attempt, 60 by 6.0 %%, 300 by 1.3 %%. A run of a "
                           "press behind thrusters takes a minute or two of a core: 60 runs most "
                           "of an hour on two cores, 300 four hours")
    runs.add_argument("--confidence", type=float, default=0.95, metavar="C",
                      help="confidence of that bound (default: %(default)s)")
    take_workers(certify)


def certify_scenario(args: argparse.Namespace) -> int:
    """Prints and writes the certificate; returns 0 if it holds, else 1.

    With --runs it is one in probability, and 3 is returned if a run failed.
    """
    names = [CERTIFICATE_FILE]
    if args.runs is not None:
        from uvms_drake.command.drawn_runs import certify_by_runs

        left_out(args, ("largest", "within"), "with --runs")
        return certify_by_runs(args, names)
    left_out(args, ("confidence", "workers", "scheduler"), "without --runs")
    if args.largest is not None:
        left_out(args, ("full",), "with --largest")
        return find_largest(args)
    left_out(args, ("within",), "without --largest")
    from uvms_drake.certificate.certify import certified_once
    from uvms_drake.certificate.text import format_overview
    from uvms_drake.station.problem import check_inputs

    # Bad input of any kind is refused before anything is computed.
    scenario, source, path = asked(args)
    if scenario.simulation:
        return certify_own(args, scenario, source, path)
    with output_folder(path, names, replaces=True) as output:
        with reported_in(source):
            model = check_inputs(scenario)  # Before anything is announced.
            compare_class(scenario, model)
            note(scenario)
            started, stages = time.perf_counter(), list[str]()
            with bar(args, CERTIFYING, is_steady=False) as progress:
                def said(stage: str, done: float) -> None:
                    stages.append(stage)
                    progress(stage, done)

                certificate = certified_once(scenario, said, model)
            computed = f"in {time.perf_counter() - started:.1f} s" if stages else (
                "before, from the cache")
        write_certificate(certificate, output.folder)
        files = sorted((item.name for item in output.folder.iterdir()), reverse=True)
    print(format_overview(certificate, scenario, computed))
    print(f"\n{certificate}" if args.full else "everything: --full")
    print(f"written to {path}: {', '.join(files)}", file=sys.stderr)
    return 0 if certificate.certified else 1
