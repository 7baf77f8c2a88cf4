"""The option --largest of `certify`: the largest value of a key that certifies, by bisection."""

import argparse
import math
from collections.abc import Callable

from pydrake.common.yaml import yaml_load_data

from uvms_drake.command.progress import bar
from uvms_drake.common.errors import InvalidParameter, ScenarioError, require
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario, load_scenario
from uvms_drake.station.scenario.scenario_file import reported_in, scenario_source

FARTHEST = 8.0
"""Upper end of the range over the scenario's value, if no range is given."""
FINE = 1.02
"""Largest ratio of the smallest value that fails to the largest that certifies."""
SMALLEST = 1e-3
"""Fraction of the range's upper end below which a value counts as zero."""


def number_at(scenario: Scenario, key: str) -> float:
    """Returns the number that a key of a scenario has, an int if only integers are allowed.

    Raises:
        InvalidParameter: There is no number.
    """
    value = yaml_load_data(dump_scenario(scenario))
    for name in key.split("."):
        items = dict(enumerate(value)) if isinstance(value, list) else value
        inside = items if isinstance(items, dict) else {}
        value = inside.get(int(name) if isinstance(value, list) and name.isdecimal() else name)
    require(isinstance(value, int | float) and not isinstance(value, bool), "--largest", key,
            "the key of a number, such as disturbance.bound or current.0 ('uvms-drake keys')")
    return value


def largest(certifies: Callable[[float], bool], low: float, high: float, *, whole: bool = False
            ) -> float | None:
    """Returns the largest value found that certifies; None if the lowest does not.

    A value that certifies is taken to stand for all smaller ones of the range.

    Args:
        certifies: Whether a value does.
        low: Smallest value, zero or positive.
        high: Largest value.
        whole: Whether only integers are tried.
    """
    if not certifies(low):
        return None
    if certifies(high):
        return high
    zero = SMALLEST * high
    while high > (FINE * low if low > 0.0 else zero):
        middle = math.sqrt(low * high) if low > 0.0 else 0.5 * high
        middle = round(middle) if whole else float(f"{middle:.3g}")
        if middle in (low, high):
            break
        low, high = (middle, high) if certifies(middle) else (low, middle)
    return low


def take_largest(certify: argparse.ArgumentParser) -> None:
    """Adds the option and its range."""
    certify.add_argument("--largest", metavar="KEY",
                         help="find the largest value of a key, such as contact.stiffness or "
                              "current.0, that certifies, all else as it is, by bisection: a line "
                              "for every value tried; nothing is written")
    certify.add_argument("--within", type=float, nargs=2, metavar=("A", "B"),
                         help="with --largest: the range, 0 <= A < B (default: from the scenario's "
                              f"value to {FARTHEST:g} times that)")


def find_largest(args: argparse.Namespace) -> int:
    """Prints every value of a key that is tried, and the largest that certifies; 1 if none does.

    Certificates are in the cache: after an interrupt the same command is soon where it was.
    """
    key, kept = args.largest, list[float]()
    value = number_at(load_scenario(args.scenario, args.overrides), key)
    low, high = args.within or (value, FARTHEST * value)
    require(0.0 <= low < high < math.inf, "--within", args.within,
            f"given as A B with 0 <= A < B: {key} is {value:g}")

    def certifies(tried: float) -> bool:
        """Prints the verdict on a value; one that is not allowed raises, if it was asked for."""
        try:
            certified, text = _verdict(args, f"{key}={tried!r}")
        except (InvalidParameter, ScenarioError) as error:
            if tried == low or args.within:
                raise
            certified, text = False, f"not certified: {error}"
        print(f"{key} = {tried:g}: {text}", flush=True)
        kept.extend([tried] * certified)
        return certified

    # An interrupt names the largest so far.
    try:
        found = largest(certifies, low, high, whole=isinstance(value, int))
    except KeyboardInterrupt as interrupt:
        interrupt.add_note(f"largest {key} so far: {max(kept, default='none')}")
        raise
    print(f"no {key} from {low:g} on certifies" if found is None else
          f"largest {key} that certifies: {found:g}" + ", the end of the range" * (found == high))
    return 1 if found is None else 0


def _verdict(args: argparse.Namespace, override: str) -> tuple[bool, str]:
    """Returns whether a scenario certifies with one more override, and the verdict in words."""
    from uvms_drake.certificate.certify import certified_once
    from uvms_drake.station.problem import check_inputs

    scenario = load_scenario(args.scenario, [*args.overrides, override])
    with (reported_in(scenario_source(args.scenario)),
          bar(args, f"certifying {override}", is_steady=False) as progress):
        certificate = certified_once(scenario, progress, check_inputs(scenario))
    return certificate.certified, certificate.verdict
