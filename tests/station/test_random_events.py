"""Random events outside of the class: their draws, scenarios, and what a page counts as missed."""

from collections import Counter
from pathlib import Path

import pytest

import uvms_drake as uv

RESULTS = Path(__file__).parents[2] / "examples" / "results"
KEPT = {"robot": "girona500_real_loop", "cut": False, "error": None, "finite": True, "beyond": 0.0,
        "above": 0.0, "peak": 21.0, "rate": 0.3, "trip": 9.0, "cause": "drift"}


@pytest.fixture
def random_events(monkeypatch):
    monkeypatch.syspath_prepend(RESULTS)
    import random_events
    return random_events


def test_events_are_a_function_of_the_index_and_of_every_kind(random_events):
    found = [random_events.drawn(index) for index in range(200)]
    assert found[7] == random_events.drawn(7)
    kinds = Counter(kind for _, events, _ in found for kind, _, _ in events)
    assert set(kinds) == set(random_events.KINDS) and min(kinds.values()) > 5
    assert {len(events) for _, events, _ in found} == {1, 2}
    assert all(events[0][1] <= events[-1][1] for _, events, _ in found)


def test_every_fault_is_one_of_a_scenario(random_events):
    for index in range(40):
        robot, events, _ = random_events.drawn(index)
        faults = [text for kind, _, text in events if text.startswith("!")]
        scenario = uv.load_scenario(robot, [f"faults=[{', '.join(faults)}]"])
        assert [fault.start for fault in scenario.faults] == [
            instant for _, instant, text in events if text.startswith("!")]


@pytest.mark.parametrize(("change", "bad"), [
    ({}, False), ({"beyond": 0.01}, False), ({"beyond": 0.03}, True), ({"above": 0.4}, False),
    ({"above": 0.6}, True), ({"finite": False}, True), ({"error": "ended early"}, True)])
def test_a_run_that_misses_what_is_asked_is_counted(random_events, change, bad):
    run = {**KEPT, "index": 0, "events": [("wave", 3.0, ""), ("no fixes", 4.0, "")], **change}
    assert random_events.missed(run) == bad
    text = random_events.page([run, {**KEPT, "index": 1, "events": [("wave", 3.0, "")]}])
    rows = {line.split(" | ")[0]: line for line in text.splitlines() if line.startswith("| ")}
    assert rows["| wave"].startswith("| wave | 2 |")
    assert rows["| no fixes"].startswith("| no fixes | 1 |")
