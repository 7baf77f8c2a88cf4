"""The paper on the command line: the sub-command `errata`, and the option `--paper` of `certify`.

No other file outside of `papers` imports a paper; scenarios name one by their key `modules`.
"""

import argparse
import logging
import sys
from contextlib import closing

from uvms_drake.certificate.certificate import Certificate
from uvms_drake.command.files import folder, take_quiet
from uvms_drake.command.progress import Bar, stream_of
from uvms_drake.common.alarm import LOGGER
from uvms_drake.common.output import output_folder
from uvms_drake.common.progress import part_of
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.motions.motions import motion_of
from uvms_drake.station.scenario.scenario import Scenario

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


def take_paper(certify: argparse.ArgumentParser) -> None:
    """Adds the option of `certify` that compares with the paper."""
    certify.add_argument("--paper", action="store_true",
                         help="also search for the constants of the paper's Lemma, and print its "
                              "radii with these gains and this disturbance")


def check_paper(args: argparse.Namespace, scenario: Scenario) -> None:
    """Raises `InvalidParameter` if the paper's radii are requested, but there are none."""
    if args.paper:
        from uvms_drake.papers.nikou2018.comparison import check_comparison

        check_comparison(motion_of(scenario), scenario.ancillary)


def beside_the_paper(args: argparse.Namespace, certificate: Certificate, scenario: Scenario,
                     model: ContactModel) -> Certificate:
    """Returns the certificate, with the paper's radii if they are requested."""
    if not args.paper:
        return certificate
    from uvms_drake.papers.nikou2018.comparison import with_paper

    return with_paper(certificate, scenario, model)

