"""The sub-command `errata` of the paper.

No other file outside of `papers` imports a paper; scenarios name one by their key `modules`.
"""

import argparse
import logging
import sys
from contextlib import closing

from uvms_drake.command.files import folder, take_quiet
from uvms_drake.command.progress import Bar, stream_of
from uvms_drake.common.alarm import LOGGER
from uvms_drake.common.output import output_folder
from uvms_drake.common.progress import part_of

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
    from uvms_drake.papers.nikou2018.errata.choices import CHOICES, draw_choices

    LOGGER.setLevel(logging.ERROR)  # The drawn runs fail on purpose.
    with closing(Bar("computing the errata", stream_of(args))) as progress:
        if args.output is None:
            errata = all_errata(progress)
        else:
            with output_folder(args.output, [ERRATA_FILE, *CHOICES]) as output:
                errata = all_errata(part_of(progress, 0.0, 0.3))
                text = errata_markdown(errata) + "\n"
                (output.folder / ERRATA_FILE).write_text(text, encoding="utf-8")
                draw_choices(output.folder, part_of(progress, 0.3, 1.0))
    print(errata_table(errata))
    if args.output is not None:
        print(f"written to {args.output}: {', '.join(sorted(output.kept))}", file=sys.stderr)
    return 0 if all(erratum.wrong for erratum in errata) else 1
