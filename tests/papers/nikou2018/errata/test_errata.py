"""Tests of `papers.nikou2018.errata`: each is confirmed, in the table and in the README."""

import re
from pathlib import Path

import numpy as np
import pytest

from uvms_drake.papers.nikou2018.errata import Erratum, all_errata, errata_markdown, errata_table
from uvms_drake.papers.nikou2018.errata.choices import (
    CHOICES,
    FIGURES,
    TASK_ERROR,
    draw_choices,
    panels_of,
)
from uvms_drake.papers.nikou2018.errata.paper import numbers
from uvms_drake.papers.nikou2018.kinematics import simulate
from uvms_drake.station.scenario.scenario import load_scenario

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def errata() -> list[Erratum]:
    return all_errata()


PRINTED = re.compile(r"[-−]?\d+(?:\.\d+)?")


def test_every_erratum_is_there_and_confirmed(errata):
    assert [item.number for item in errata] == [f"E{i}" for i in range(1, 15)]
    assert all(item.wrong is True for item in errata)
    for item in errata:
        assert PRINTED.search(item.computed), item.number
        assert item.title and item.printed and item.consequence


def test_the_table_has_all_of_it(errata):
    text = errata_table(errata)
    assert text.startswith("14 of 14 errata confirmed")
    assert max(map(len, text.splitlines())) <= 100
    flat = " ".join(text.split())
    for item in errata:
        for part in (f"{item.number} {item.title}", item.printed, item.computed, item.consequence):
            assert " ".join(part.split()) in flat


def test_the_markdown_is_a_table(errata):
    odd = Erratum("E0", "t", "a, b", "|x| ≤ 1", "c", "d", wrong=False)
    lines = errata_markdown([*errata, odd]).splitlines()
    assert len(lines) == len(errata) + 3
    cells = [re.split(r"(?<!\\)\|", line) for line in lines]
    assert {len(row) for row in cells} == {8}
    assert all(row[0] == row[-1] == "" for row in cells)
    assert set(cells[1][1:-1]) == {" --- "}
    assert [row[1].strip() for row in cells[2:-1]] == [item.number for item in errata]
    assert [cell.strip() for cell in cells[-1][1:-1]] == [
        "E0", "**t** (`a`, `b`)", "\\|x\\| ≤ 1", "c", "d", "not confirmed"]


def test_a_vector_is_written_without_negative_zeros():
    assert numbers(np.array([-1e-9, -1.5, 2.0004])) == "(0, −1.5, 2)"


def cells_of(row: str) -> list[str]:
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]]


def test_the_table_of_the_readme_is_the_output(errata):
    """Word for word, and number for number but for rounding."""
    path = Path(__file__).parents[4] / "uvms_drake/papers/nikou2018/errata/README.md"
    readme = path.read_text(encoding="utf-8")
    written = [line for line in readme.splitlines() if re.match(r"\| E\d+ \|", line)]
    computed = errata_markdown(errata).splitlines()[2:]
    assert len(written) == len(computed) == len(errata)
    number = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e[+-]\d+)?")
    for here, there in zip(written, computed, strict=True):
        assert cells_of(number.sub("#", here)) == cells_of(number.sub("#", there))
        for one, other in zip(number.findall(here), number.findall(there), strict=True):
            assert float(one) == pytest.approx(float(other), rel=0.1, abs=1e-3), here[:60]


def test_the_choices_show_what_the_errata_state(tmp_path):
    """E9: the nominal motion jumps at every sample; E5: the paper's law leaves the joints alone."""
    draw_choices(tmp_path, overrides=["duration=0.6"])
    assert all((tmp_path / name).stat().st_size > 10_000 for name in FIGURES)
    (nominal, measured), (resolved, transpose) = (
        [simulate(load_scenario("paper_kinematic", [each])) for each in CHOICES[name]]
        for name in ("initial_state.png", "law.png"))
    jumps = [np.max(np.linalg.norm(np.diff(run.chi_nominal, axis=0), axis=1)[300:])
             for run in (nominal, measured)]
    assert jumps[1] > 2.0 * jumps[0]
    late = nominal.time > 4.5
    errors = panels_of([nominal, measured])[TASK_ERROR]
    assert np.max(errors[1][late]) > 1.4 * np.max(errors[0][late])
    drift = [np.max(np.abs((run.config - run.nominal_config)[:, 6:]))
             for run in (resolved, transpose)]
    assert drift[0] < 1e-6
    assert drift[1] > 0.2
