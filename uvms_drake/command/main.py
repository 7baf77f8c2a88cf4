"""The command line: `uvms-drake run`, `certify`, `campaign`, ...

The exit status is 0 for success, 1 if a run failed or a scenario is not certified, 2 for bad input,
3 if a run broke a guarantee or violated a limit, 4 if an exception ended a run, whose data until
then are written, and 128 + the signal for an interrupted command: 130 after Ctrl-C, 143 after
SIGTERM. An error is one line on stderr.
"""

import argparse
import logging
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

# The matrices are small: threads cost more than they gain, most of all on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from uvms_drake.command.benchmark import add_benchmark
from uvms_drake.command.campaign import add_calibrate, add_campaign
from uvms_drake.command.certify import add_certify
from uvms_drake.command.compare import add_compare
from uvms_drake.command.interrupt import PROGRAM
from uvms_drake.command.keys import add_keys
from uvms_drake.command.paper import add_errata
from uvms_drake.command.robot import add_identify, add_robot
from uvms_drake.command.run import add_plot, add_run
from uvms_drake.command.scenario import add_scenario, add_scenarios
from uvms_drake.common.alarm import LOGGER
from uvms_drake.common.errors import InvalidParameter, RunFailed, ScenarioError
from uvms_drake.common.program import VERSION

# Slow imports (simulation, summary, figures, replay) are local to their functions.


class _UsageError(Exception):
    """The arguments are not valid."""


class _Parser(argparse.ArgumentParser):
    """Parser that raises instead of printing its usage before the error."""

    def error(self, message: str) -> NoReturn:
        raise _UsageError(f"{message} (see {self.prog} --help)")


class _Command(_Parser):
    """Sub-command that reports its unknown arguments under its own name."""

    def parse_known_args(self, args=None, namespace=None):  # type: ignore[override]
        """Returns the arguments; raises for unknown ones."""
        known, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return known, unknown


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
        if "KeyboardInterrupt" in str(error):  # Drake passes it on from a callback in this form.
            raise
        return _report("; ".join([str(error), *getattr(error, "__notes__", ())]), 1)
    except SystemExit as error:  # The form in which Drake's own assertions end a program.
        if isinstance(error.code, str):
            return _report(error.code, 1)
        raise


def _report(error: object, status: int) -> int:
    print(f"{PROGRAM}: error: {' '.join(str(error).split())}", file=sys.stderr)
    return status


def make_parser() -> argparse.ArgumentParser:
    """Returns the parser; the function of a subcommand is the `command` of its arguments."""
    parser = _Parser(prog=PROGRAM, allow_abbrev=False, description=(
        "Robust interaction control of underwater vehicle-manipulator systems."))
    parser.add_argument("--version", action="version", version=f"{PROGRAM} {VERSION}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Command)
    for add in (add_run, add_plot, add_compare, add_certify, add_benchmark,
                add_calibrate, add_campaign, add_errata,
                add_scenarios, add_keys, add_robot, add_identify, add_scenario):
        add(commands)
    return parser
