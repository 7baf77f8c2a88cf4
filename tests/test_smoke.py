"""The smoke subset of the tests: every file of it is there, and every room has one."""

from pathlib import Path

from conftest import SMOKE

TESTS = Path(__file__).parent
ROOMS = {"common", "model", "plant", "control", "sensing", "mission", "actuation", "tube",
         "station", "certificate", "report", "command", "visual"}


def test_every_file_of_it_is_there_and_every_room_has_one():
    assert [name for name in sorted(SMOKE) if not (TESTS / name).is_file()] == []
    assert {name.split("/")[0] for name in SMOKE if "/" in name} == ROOMS
