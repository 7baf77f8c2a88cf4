"""Tests of `uvms_drake.progress`."""

import io

from uvms_drake.progress import LINES, ProgressLine


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


def test_nothing_reported_is_nothing_written():
    stream = Terminal()
    ProgressLine(20.0, stream).close()
    assert stream.getvalue() == ""
