"""Tests of `uvms_drake.command.progress`."""

import io
import logging
from argparse import Namespace

import pytest

from uvms_drake.command.progress import LINES, Bar, alarms_above, bar
from uvms_drake.common.alarm import LOGGER, warn
from uvms_drake.common.progress import part_of


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    """Lets every report come 3 s after the one before, the first 3 s after the start."""
    now = iter(range(0, 10**6, 3))
    monkeypatch.setattr("time.perf_counter", lambda: float(next(now)))


def test_a_log_file_gets_few_lines():
    stream = io.StringIO()
    bar = Bar("simulating", stream)
    for step in range(2001):
        bar(f"{0.01 * step:.1f} of 20 s", step / 2000)
    bar.close()
    lines = stream.getvalue().splitlines()
    assert len(lines) == LINES + 1
    assert lines[0] == "simulating: 0.0 of 20 s"
    assert lines[1] == "simulating: 4.0 of 20 s, about 4812 s left"  # 401 reports took 1203 s.
    assert lines[-1] == "simulating: 20.0 of 20 s, about 0 s left"


def test_a_terminal_gets_a_bar_with_the_time_left_that_is_taken_away():
    stream = Terminal()
    bar = Bar("certifying", stream)
    bar.close()  # Nothing reported is nothing written.
    for what, done in (("constants", 0.0), ("tube", 0.5), ("first plan", 0.9)):
        bar(what, done)
    bar.close()
    bar.close()
    assert stream.getvalue().split("\r") == [
        "", f"[{' ' * 20}] certifying: constants\033[K",
        f"[{'#' * 10}{' ' * 10}] certifying: tube, about 6 s left\033[K",
        f"[{'#' * 18}  ] certifying: first plan, about 1 s left\033[K", "\033[K"]


def test_stages_of_unknown_length_are_counted_and_no_time_is_claimed():
    """D25: `tube, about 0 s left` before two more stages."""
    stream = io.StringIO()
    bar = Bar("certifying", stream, is_steady=False)
    for what, done in (("1 of 4: constants", 0.0), ("2 of 4: tube", 0.01), ("3 of 4: x", 0.98)):
        bar(what, done)
    assert stream.getvalue().splitlines() == [
        "certifying: 1 of 4: constants", "certifying: 2 of 4: tube", "certifying: 3 of 4: x"]


def test_an_alarm_takes_the_place_of_the_bar_which_goes_on_below(caplog):
    caplog.set_level(logging.WARNING, LOGGER.name)
    stream = Terminal()
    bar = Bar("simulating", stream)
    with alarms_above(bar):
        bar("0.7 of 20 s", 0.035)
        warn(0.74, "left the tube")
        bar("0.8 of 20 s", 0.04)
    warn(0.9, "left the tube")
    first, second = stream.getvalue().split("\n")
    assert "simulating: 0.7" in first
    assert first.endswith("\r\033[Kt = 0.74 s: left the tube")
    assert "simulating: 0.8" in second


def test_a_quiet_command_says_nothing(capsys):
    with bar(Namespace(quiet=True), "certifying") as progress:
        progress("tube", 0.5)
    assert capsys.readouterr().err == ""
    with bar(Namespace(quiet=False), "certifying") as progress:
        progress("tube", 0.5)
    assert capsys.readouterr().err == "certifying: tube, about 3 s left\n"


def test_parts_follow_each_other():
    seen = []
    for first, last in ((0.0, 0.25), (0.25, 1.0)):
        part = part_of(lambda what, done: seen.append(done), first, last)
        part("a", 0.0)
        part("b", 0.5)
    assert seen == [0.0, 0.125, 0.25, 0.625]
