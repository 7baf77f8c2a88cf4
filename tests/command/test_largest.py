"""`certify --largest`: bisection against a known threshold, and the command on a real key."""

import csv
from pathlib import Path

import pytest

from uvms_drake.certificate import certify
from uvms_drake.command.largest import FINE, LARGEST_FILE, largest, number_at, steps_left
from uvms_drake.command.main import main
from uvms_drake.common.errors import InvalidParameter
from uvms_drake.station.scenario.scenario import load_scenario


@pytest.mark.parametrize(("threshold", "low", "high"), [
    (0.37, 0.0, 10.0), (1.7, 1.0, 8.0), (1e3, 1.0, 1e9), (5.0, 0.0, 5.0)])
def test_bisection_finds_a_threshold_to_two_per_cent_and_tries_no_value_twice(
        threshold, low, high):
    tried = []

    def certifies(value):
        tried.append(value)
        return value <= threshold

    found = largest(certifies, low, high)
    assert found <= threshold < FINE**2 * found  # The tried values are rounded.
    assert len(tried) == len(set(tried)) < 30


def test_integers_are_found_exactly_and_none_if_not_even_the_lowest_holds():
    assert largest(lambda value: value <= 61, 10, 80, whole=True) == 61
    assert largest(lambda value: value <= 0.5, 1.0, 8.0) is None
    assert largest(lambda value: value <= 0.0, 0.0, 8.0) == 0.0


@pytest.mark.parametrize(("key", "value"), [
    ("contact.stiffness", 1000.0), ("limits.u.0", 0.5), ("mpc.horizon", 20),
    ("sensing.0.rate", 500.0)])
def test_the_number_of_a_key_is_found(key, value):
    scenario = load_scenario("girona500_contact", [f"{key}={value}"])
    assert number_at(scenario, key) == value
    assert type(number_at(scenario, key)) is type(value)


@pytest.mark.parametrize("key", ["", "nothing", "limits.u", "limits.u.99", "limits.u.x", "faults",
                                 "contact", "model", "mpc.terminal_set", "seed.0"])
def test_a_key_without_a_number_is_refused(key):
    with pytest.raises(InvalidParameter, match="must be the key of a number"):
        number_at(load_scenario("girona500_contact"), key)


class Verdict:
    """A certificate that holds up to a bound of the disturbance."""

    def __init__(self, scenario):
        self.bound = scenario.disturbance.bound
        self.certified = self.bound < 0.2
        self.verdict = "certified" if self.certified else "not certified: no"


@pytest.fixture
def quick(monkeypatch):
    """Certificates of a moment."""
    monkeypatch.setattr(certify, "certified_once", lambda scenario, *_: Verdict(scenario))


def run(*args):
    """Runs the command on a scenario whose bound of the disturbance is 0.1."""
    return main(["certify", "girona500_ideal", "--set", "disturbance.bound=0.1", "--quiet",
                 "--largest", "disturbance.bound", *args])


def test_every_value_is_a_line_and_the_last_line_has_the_largest(quick, capsys, tmp_path,
                                                                 monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run() == 0
    first, second, *_, last = capsys.readouterr().out.splitlines()
    assert first == "disturbance.bound = 0.1: certified"
    assert second == "disturbance.bound = 0.8: not certified: no"
    name, value = last.split(": ")
    assert name == "largest disturbance.bound that certifies"
    assert 0.196 < float(value) < 0.2
    assert run("--within", "0.3", "0.5") == 1
    assert capsys.readouterr().out.splitlines()[-1] == (
        "no disturbance.bound from 0.3 on certifies")
    assert run("--within", "0", "0.1") == 0
    assert capsys.readouterr().out.splitlines()[-1].endswith("0.1, the end of the range")
    with (tmp_path / "out/girona500_ideal" / LARGEST_FILE).open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [(row["value"], row["certified"]) for row in rows[:2]] == [("0.1", "1"), ("0.8", "0")]
    assert rows[1]["verdict"] == "not certified: no"
    assert {row["key"] for row in rows} == {"disturbance.bound"}
    assert [row["value"] for row in rows[-2:]] == ["0.0", "0.1"]  # All three commands are there.


@pytest.mark.parametrize(("threshold", "low", "high"), [
    (0.37, 0.0, 10.0), (1e-4, 0.0, 10.0), (9.9, 0.0, 10.0), (1.7, 1.0, 8.0), (7.9, 1.0, 8.0),
    (1e3, 1.0, 1e9)])
def test_the_count_of_values_to_go_is_never_too_small(threshold, low, high):
    kept, failed = [], []

    def certifies(value):
        (kept if value <= threshold else failed).append(value)
        return value <= threshold

    largest(certifies, low, high)
    assert 2 + steps_left(low, high) >= len(kept) + len(failed)
    assert steps_left(1.0, FINE) == 0 and steps_left(1.0, FINE**4) == 2


def test_the_count_comes_down_with_the_time_left(quick, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["certify", "girona500_ideal", "--set", "disturbance.bound=0.1",
                 "--largest", "disturbance.bound"]) == 0
    assert "added to out/girona500_ideal/largest.csv" in capsys.readouterr().err


def test_an_interrupt_keeps_what_was_found(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)

    def interrupted(scenario, *_):
        if scenario.disturbance.bound > 0.25:
            raise KeyboardInterrupt
        return Verdict(scenario)

    monkeypatch.setattr(certify, "certified_once", interrupted)
    with pytest.raises(KeyboardInterrupt) as caught:
        run()
    file = Path("out/girona500_ideal") / LARGEST_FILE
    assert caught.value.__notes__ == [
        f"largest disturbance.bound so far: 0.1; {file} has the 1 values tried"]
    assert file.read_text(encoding="utf-8").splitlines()[1].startswith("disturbance.bound,0.1,1,")
    assert capsys.readouterr().out == "disturbance.bound = 0.1: certified\n"
