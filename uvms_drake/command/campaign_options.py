"""The options of the sub-command `campaign`, whose own file takes long to import."""

import argparse

from uvms_drake.command.files import folder, take_scenario


def add_campaign(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    campaign = commands.add_parser(
        "campaign", allow_abbrev=False,
        help="many runs with random starts, desired forces and disturbances within the bounds")
    campaign.set_defaults(command=run_campaign, parser=campaign)
    take_scenario(campaign)
    campaign.add_argument("--runs", type=int, default=100, metavar="N",
                          help="how many (default: %(default)s)")
    campaign.add_argument("--seed", type=int, default=0, metavar="S",
                          help="run i is drawn from this and from i (default: %(default)s)")
    where = campaign.add_mutually_exclusive_group()
    where.add_argument("--workers", type=int, metavar="W",
                       help="processes of this machine (default: one for each core)")
    where.add_argument("--scheduler", metavar="ADDRESS",
                       help="of a running Dask cluster, whose workers have this package installed")
    campaign.add_argument("--output", type=folder, metavar="DIR",
                          help="where to write (default: out/<scenario>-campaign); if runs of this "
                               "campaign are there, it goes on with the others")
    campaign.add_argument("--uncertified", action="store_true",
                          help="run without a certificate, with the tube that the scenario "
                               "declares")
    campaign.add_argument("--model-error", type=float, default=0.2, metavar="E",
                          help="largest relative error of the model that is drawn, as far as the "
                               "disturbance's bound covers it (where that is 0, the scenario's "
                               "own errors are drawn); 0 for a controller that knows "
                               "robot, surface and water exactly, and nothing is drawn where it "
                               "feels the surface (default: %(default)s)")
    campaign.add_argument("--outside", action="store_true",
                          help="in every run one thing happens that the theory does not cover: "
                               "sensor faults, a stuck joint, a disturbance, current or error of "
                               "the model or of the surface that is too large")
    campaign.add_argument("--replay", type=int, metavar="INDEX",
                          help="run one of the campaign in --output once more, alone, and write "
                               "data and figures to its folder run-<INDEX>; the campaign decides "
                               "all other options")


def run_campaign(args: argparse.Namespace) -> int:
    """Runs a campaign, or one of its runs once more."""
    from uvms_drake.command.campaign import replay_run, run_campaign

    return run_campaign(args) if args.replay is None else replay_run(args)
