"""Tests of `uvms_drake.command.progress`."""

import io
import logging

from uvms_drake.command.progress import LINES, ProgressLine, StageBar, alarms_above
from uvms_drake.common.alarm import LOGGER, warn


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_log_file_gets_few_lines():
    stream = io.StringIO()
    report = ProgressLine(20.0, stream)
    for step in range(2000):
        report(0.01 * step)
    report.close()
    lines = stream.getvalue().splitlines()
    assert len(lines) == LINES
    assert lines[0].startswith("simulating: 0.0 of 20 s")


def test_a_terminal_gets_one_line_that_is_taken_away():
    stream = Terminal()
    report = ProgressLine(20.0, stream)
    report(0.0)
    report.close()
    report.close()
    assert stream.getvalue().startswith("\rsimulating")
    assert stream.getvalue().endswith("\r\033[K")
    assert "\n" not in stream.getvalue()


def test_an_alarm_takes_the_place_of_the_line_which_goes_on_below(caplog):
    caplog.set_level(logging.WARNING, LOGGER.name)
    stream = Terminal()
    report = ProgressLine(20.0, stream)
    with alarms_above(report):
        report(0.7)
        warn(0.74, "left the tube")
        report._due = 0.0
        report(0.8)
    warn(0.9, "left the tube")
    first, second = stream.getvalue().split("\n")
    assert first.startswith("\rsimulating: 0.7")
    assert first.endswith("\r\033[Kt = 0.74 s: left the tube")
    assert second.startswith("\rsimulating: 0.8")


def test_nothing_reported_is_nothing_written():
    stream = Terminal()
    ProgressLine(20.0, stream).close()
    assert stream.getvalue() == ""


def test_stages_are_a_bar_with_the_time_left_on_a_terminal_and_one_line_in_a_log_file():
    for stream in (Terminal(), io.StringIO()):
        report = StageBar("certifying", stream)
        for what, done in (("constants", 0.0), ("tube", 0.5), ("first plan", 0.9)):
            report(what, done)
        report.close()
        if not stream.isatty():
            assert stream.getvalue() == "certifying ...\n"
            continue
        first, second, third, end = stream.getvalue().split("\r")[1:]
        assert first == f"[{' ' * 20}] certifying: constants\033[K"
        assert second.startswith(f"[{'#' * 10}{' ' * 10}] certifying: tube, about 0 s left")
        assert third.startswith(f"[{'#' * 18}  ] certifying: first plan, about ")
        assert end == "\033[K"


def test_no_stage_is_nothing_written():
    stream = Terminal()
    StageBar("certifying", stream).close()
    assert stream.getvalue() == ""
