"""Numbers in the prose of the READMEs: settings of shipped files, or written by a command.

A measured number in prose is right on the day on which it is written. So each number with a unit
has to be a value of a scenario or of a robot, a default of a key, or on a page of results.
"""

import re

import pytest
from support.pages import READMES, ROOT

from uvms_drake.command.keys import keys_of
from uvms_drake.station.scenario.scenario import Scenario

UNITS = r"N/m|N m|kN/m|m/s²|m/s|rad/s|mrad|mm|ms|Hz|kg|N|m|s|%|°|times"
NUMBER = r"(?<![\w.,/^])(\d+(?:\.\d+)?)"
MEASURE = re.compile(rf"{NUMBER}\s?(?:{UNITS})(?![\w/²])")
def prose(text: str) -> str:
    """Returns a page without code, formulas, links' targets, and rows of tables of settings."""
    text = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    return re.sub(r"`[^`]*`|\]\([^)]*\)|\$[^$]*\$", " ", text)


def values_of_files() -> set[float]:
    """Returns all numbers of the shipped files, of the defaults of keys and of results' pages."""
    texts = [path.read_text(encoding="utf-8") for pattern in (
        "uvms_drake/scenarios/*.yaml", "models/*/*.yaml", "examples/results/*.md",
        "examples/comparison/*.md") for path in ROOT.glob(pattern)]
    texts += [line for _, line in keys_of(Scenario())]
    return {float(number) for text in texts for number in re.findall(r"\d+(?:\.\d+)?", text)}


FILES = values_of_files()


WRITTEN = ROOT / "uvms_drake/papers/nikou2018/errata/README.md"
"""A command writes it, see `tests/papers/nikou2018/errata`."""


@pytest.mark.parametrize("path", [path for path in READMES if path != WRITTEN],
                         ids=lambda path: str(path.relative_to(ROOT)))
def test_a_number_in_prose_is_a_setting_or_is_written_by_a_command(path):
    text = prose(path.read_text(encoding="utf-8"))
    unknown = [match[0] for match in MEASURE.finditer(text) if float(match[1]) not in FILES]
    assert unknown == []
