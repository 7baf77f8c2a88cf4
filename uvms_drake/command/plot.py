"""The sub-command `plot`: draws figures and report of a finished run again."""

import argparse

from uvms_drake.command.files import (
    REPLAY_FILE,
    REPORT_FILE,
    failures_in_words,
    folder,
    picture_files,
    write_pictures,
)
from uvms_drake.common.output import output_folder


def add_plot(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    plot = commands.add_parser("plot", help=f"draw figures and {REPORT_FILE} of a run again",
                               allow_abbrev=False)
    plot.set_defaults(command=plot_run)
    plot.add_argument("folder", type=folder, metavar="DIR", help="folder that 'run' has written")
    plot.add_argument("--replay", action="store_true", help=f"also write {REPLAY_FILE}")
    plot.add_argument("--mcap", action="store_true",
                      help="also write log.mcap, for Foxglove (pip install 'uvms_drake[mcap]')")


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
