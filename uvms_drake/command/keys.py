"""The sub-command `keys`: lists the keys of a scenario, or the signals of a run."""

import argparse
import re
import typing
from collections.abc import Iterator

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.common.schema import field_docs, field_types, structs_of
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.signals import format_signals


def add_keys(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    keys = commands.add_parser(
        "keys", help="list the keys of a scenario with default, unit and meaning, or the signals",
        allow_abbrev=False)
    keys.set_defaults(command=list_keys)
    keys.add_argument("--signals", action="store_true",
                      help="list the signals of a run instead, with components, unit, frame and "
                           "source")
    keys.add_argument("prefix", nargs="?", default="", metavar="PREFIX",
                      help="only those that begin with it, such as mpc or surface.stiffness")


def list_keys(args: argparse.Namespace) -> int:
    """Prints the keys that begin with a prefix, in which tags can be left out, a line each."""
    if args.signals:
        require(not args.prefix, "PREFIX", args.prefix, "left out with --signals")
        print(format_signals())
        return 0
    lines = [line for key, line in keys_of(Scenario())
             if any(name.startswith(args.prefix) for name in (key, re.sub(r"!\w+", "", key)))]
    require(bool(lines), "PREFIX", args.prefix, "the beginning of a key, or left out for all")
    print("\n".join(lines))
    return 0


def keys_of(defaults: typing.Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Yields every key of a struct and of those inside of it, with its line of description.

    Args:
        defaults: The struct, with its defaults.
        prefix: Prefix of its keys.
    """
    types = field_types(type(defaults))
    for name, doc in field_docs(type(defaults)).items():
        key, value, options = f"{prefix}{name}", getattr(defaults, name), structs_of(types[name])
        tags = [f"!{option.__name__}" for option in options]
        shown = "" if type(value) in options else f" = {_shown(value)}"
        said = f" {' | '.join(tags)}" if len(tags) > 1 else ""
        yield key, f"{key}{shown}{said}{'  # ' if doc else ''}{doc}"
        for option, tag in zip(options, tags, strict=True):
            inside = value if type(value) is option else option()
            yield from keys_of(inside, f"{key}{tag if said else ''}.")


def _shown(value: object) -> str:
    """Returns a default in the form of a scenario."""
    if isinstance(value, np.ndarray):
        return str(value.tolist())
    words = {None: "null", True: "true", False: "false"}
    return words[value] if value is None or isinstance(value, bool) else str(value)
