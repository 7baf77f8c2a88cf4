"""The option --largest of `certify`: the largest value of a key that certifies, by bisection."""

import argparse
import csv
import math
import sys
import time
from collections.abc import Callable

from pydrake.common.yaml import yaml_load_data

from uvms_drake.command.files import asked, new_at
from uvms_drake.command.progress import bar
from uvms_drake.common.errors import InvalidParameter, ScenarioError, require
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario, load_scenario
from uvms_drake.station.scenario.scenario_file import reported_in, scenario_source

LARGEST_FILE = "largest.csv"
COLUMNS = ("key", "value", "certified", "seconds", "verdict")
"""File of all values tried in a folder, and its columns."""
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


def steps_left(low: float, high: float) -> int:
    """Returns the largest number of values that `largest` tries between its ends."""
    from_zero = 0 if low > 0.0 else math.ceil(math.log2(1.0 / SMALLEST))
    ratio = high / low if low > 0.0 else 2.0
    return from_zero + max(math.ceil(math.log2(math.log(ratio) / math.log(FINE))), 0)


def take_largest(certify: argparse.ArgumentParser) -> None:
    """Adds the option and its range."""
    certify.add_argument("--largest", metavar="KEY",
                         help="find the largest value of a key, such as contact.stiffness or "
                              "current.0, that certifies, all else as it is, by bisection: a line "
                              f"for every value tried, which is also added to {LARGEST_FILE} in "
                              "DIR, so that an interrupt loses none")
    certify.add_argument("--within", type=float, nargs=2, metavar=("A", "B"),
                         help="with --largest: the range, 0 <= A < B (default: from the scenario's "
                              f"value to {FARTHEST:g} times that)")


def find_largest(args: argparse.Namespace) -> int:
    """Prints and writes every value of a key that is tried, and prints the largest that certifies.

    Certificates are in the cache: after an interrupt the same command is soon where it was. Returns
    1 if none does.
    """
    key, kept, failed, longest = args.largest, list[float](), list[float](), 0.0
    scenario, _, folder = asked(args)
    value, file = number_at(scenario, key), folder / LARGEST_FILE
    low, high = args.within or (value, FARTHEST * value)
    require(0.0 <= low < high < math.inf, "--within", args.within,
            f"given as A B with 0 <= A < B: {key} is {value:g}")

    def certifies(tried: float) -> bool:
        """Prints and writes the verdict on a value; one that is not allowed raises if asked for."""
        nonlocal longest
        ends = max(2 - len(kept) - len(failed), 0)
        left = ends + steps_left(max(kept, default=low), min(failed, default=high))
        about = f", up to {left * longest:.0f} s" if longest else ""
        title = f"{key}={tried:g} (at most {left} values to go{about})"
        started = time.perf_counter()
        try:
            certified, text = _verdict(args, f"{key}={tried!r}", title)
        except (InvalidParameter, ScenarioError) as error:
            if tried == low or args.within:
                raise
            certified, text = False, f"not certified: {error}"
        seconds = time.perf_counter() - started
        longest = max(longest, seconds)
        print(f"{key} = {tried:g}: {text}", flush=True)
        with new_at(file, "--output"):
            folder.mkdir(parents=True, exist_ok=True)
            with file.open("a", encoding="utf-8", newline="") as out:
                rows = csv.writer(out)
                if not out.tell():
                    rows.writerow(COLUMNS)
                rows.writerow([key, repr(tried), int(certified), f"{seconds:.1f}", text])
        (kept if certified else failed).append(tried)
        return certified

    # An interrupt names the largest so far.
    try:
        found = largest(certifies, low, high, whole=isinstance(value, int))
    except KeyboardInterrupt as interrupt:
        interrupt.add_note(f"largest {key} so far: {max(kept, default='none')}; {file} has the "
                           f"{len(kept) + len(failed)} values tried")
        raise
    print(f"no {key} from {low:g} on certifies" if found is None else
          f"largest {key} that certifies: {found:g}" + ", the end of the range" * (found == high))
    print(f"added to {file}", file=sys.stderr)
    return 1 if found is None else 0


def _verdict(args: argparse.Namespace, override: str, title: str) -> tuple[bool, str]:
    """Returns whether a scenario certifies with one more override, and the verdict in words."""
    from uvms_drake.certificate.certify import certified_once
    from uvms_drake.station.problem import check_inputs

    scenario = load_scenario(args.scenario, [*args.overrides, override])
    with (reported_in(scenario_source(args.scenario)),
          bar(args, f"certifying {title}", is_steady=False) as progress):
        certificate = certified_once(scenario, progress, check_inputs(scenario))
    return certificate.certified, certificate.verdict
