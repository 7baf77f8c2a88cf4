"""Tests of a signal that is postponed until the results so far are kept."""

import signal

import pytest

from uvms_drake.command.interrupt import postponed, run_interruptible


@pytest.fixture(autouse=True)
def interrupted():
    """Signals that a process in the background ignores interrupt here too."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_one_signal_waits_for_the_end_of_the_block(number, status, capsys):
    seen = []

    def command():
        with postponed() as asked:
            seen.append(asked())
            signal.raise_signal(number)
            seen.append(asked())
        seen.append("not here")
        return 0

    assert run_interruptible(lambda: command) == status
    assert seen == [False, True]
    assert capsys.readouterr().err == "uvms-drake: error: interrupted, nothing written\n"


def test_a_second_signal_does_not_wait():
    seen = []

    def command():
        with postponed():
            for number in range(3):
                seen.append(number)
                signal.raise_signal(signal.SIGINT)
        return 0

    assert run_interruptible(lambda: command) == 130
    assert seen == [0, 1]


def test_without_a_signal_the_handlers_are_those_of_before():
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with postponed() as asked:
        assert signal.getsignal(signal.SIGINT) is not before[0]
        assert not asked()
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_what_fails_after_a_signal_says_why():
    with pytest.raises(ValueError, match="why"), postponed():
        signal.raise_signal(signal.SIGINT)
        raise ValueError("why")
