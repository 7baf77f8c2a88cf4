"""Numbers in the prose of the READMEs: settings of shipped files, or written by a command.

A measured number in prose is right on the day on which it is written. So each number with a unit
has to be a value of a scenario or of a robot, a default of a key, or on a page of results.
"""

import re
from pathlib import Path

import pytest

from uvms_drake.command.keys import keys_of
from uvms_drake.station.scenario.scenario import Scenario

ROOT = Path(__file__).parents[1]
UNITS = r"N/m|N m|kN/m|m/s²|m/s|rad/s|mrad|mm|ms|Hz|kg|N|m|s|%|°|times"
NUMBER = r"(?<![\w.,/^])(\d+(?:\.\d+)?)"
MEASURE = re.compile(rf"{NUMBER}\s?(?:{UNITS})(?![\w/²])")
WRITTEN = {"uvms_drake/papers/nikou2018/errata/README.md"}
"""READMEs that a command writes, see `tests/papers/nikou2018/errata`."""
READMES = sorted(
    path for path in ROOT.rglob("README.md")
    if not any(part.startswith(".") or part in ("build", "out")
               for part in path.relative_to(ROOT).parts)
    and str(path.relative_to(ROOT)) not in WRITTEN)


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


@pytest.mark.parametrize("path", READMES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_number_in_prose_is_a_setting_or_is_written_by_a_command(path):
    text = prose(path.read_text(encoding="utf-8"))
    unknown = [match[0] for match in MEASURE.finditer(text) if float(match[1]) not in FILES]
    assert unknown == []


def test_a_measured_number_would_be_found():
    found = [match[1] for match in MEASURE.finditer(prose(
        "off by 16.83 N and 12.61 mm, `--set x=99 s`, theorem 3, 2 cores"))]
    assert found == ["16.83", "12.61"]
    assert not {16.83, 12.61} & FILES
