"""The sub-commands `campaign` and `calibrate`, and options of all that compute many runs."""

import argparse
from pathlib import Path

from uvms_drake.command.files import folder, take_quiet, take_scenario


def take_workers(command: argparse.ArgumentParser) -> None:
    """Adds the options --workers and --scheduler."""
    where = command.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, metavar="W",
                       help="processes of this machine (default: one for each core)")
    where.add_argument("--scheduler", metavar="ADDRESS",
                       help="of a running Dask cluster, whose workers have this package installed")


def add_campaign(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    campaign = commands.add_parser(
        "campaign", allow_abbrev=False,
        help="many runs with random starts, desired forces and disturbances within the bounds")
    campaign.set_defaults(command=run_campaign, parser=campaign)
    # The scenario, the draws, and the workers.
    take_scenario(campaign)
    campaign.add_argument("--runs", type=int, default=100, metavar="N",
                          help="number of runs (default: %(default)s)")
    campaign.add_argument("--seed", type=int, default=0, metavar="S",
                          help="run i is drawn from this and from i (default: %(default)s)")
    take_workers(campaign)
    campaign.add_argument("--output", type=folder, metavar="DIR",
                          help="folder to write to (default: out/<scenario>-campaign); a campaign "
                               "in it is continued")
    campaign.add_argument("--uncertified", action="store_true",
                          help="run without a certificate, with the tube that the scenario "
                               "declares")
    campaign.add_argument("--replay", type=int, metavar="INDEX",
                          help="repeat a single run of the campaign in --output, and write data "
                               "and figures to its folder run-<INDEX>; the campaign determines all "
                               "other options")


def run_campaign(args: argparse.Namespace) -> int:
    """Runs a campaign, or repeats one of its runs."""
    from uvms_drake.command.drawn_runs import replay_run, run_campaign

    return run_campaign(args) if args.replay is None else replay_run(args)


def add_calibrate(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    calibrate = commands.add_parser(
        "calibrate", allow_abbrev=False,
        help="find the tube of a real loop, and its gains, from pilot runs")
    calibrate.set_defaults(command=run_calibration)
    calibrate.add_argument("scenario", metavar="SCENARIO",
                           help="name of a shipped scenario or a YAML file")
    calibrate.add_argument("--runs", type=int, default=20, metavar="K",
                           help="pilot runs of each of two or three rounds (default: %(default)s); "
                                "they are kept, and the same command goes on with the others")
    calibrate.add_argument("--gains", action="store_true",
                           help="find the gains of the law, too, by a run each with delays that "
                                "are half as long again")
    calibrate.add_argument("--output", type=Path, metavar="FILE",
                           help="file to write, beside that of the scenario if that has relative "
                                "paths (default: <scenario>_calibrated.yaml)")
    take_workers(calibrate)
    take_quiet(calibrate)


def run_calibration(args: argparse.Namespace) -> int:
    """Writes a calibrated scenario."""
    from uvms_drake.command.drawn_runs import calibrate_scenario

    return calibrate_scenario(args)
