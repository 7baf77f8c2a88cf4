"""The ledger of attempts: which are of the same task, and which are the same."""

import json
from dataclasses import replace

import pytest
from support.robots import copied

import uvms_drake as uv
from uvms_drake.certificate.attempts import attempt_of, begun, ledger_path, task_of
from uvms_drake.common.errors import InvalidParameter

NAME = "girona500_real_loop"
PROGRAM = {"source": "a", "files": {"robot.sdf": "b"}, "versions": {"drake": "1"}}


@pytest.fixture(autouse=True)
def ledger(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def attempt(*overrides, runs=60, name=NAME, confidence=0.95, **program):
    return attempt_of(uv.load_scenario(name, list(overrides)), PROGRAM | program, runs, confidence)


@pytest.mark.parametrize("change", [
    "limits.nu1=0.250000001", "tube.depth=0.00420000001", "task.force_tolerance=0.5",
    "ancillary.tip.k=12.1", "current=[0.0, 0.1, 1e-12]", "duration=50", "contact.force_line=3",
    "simulator.max_step_size=0.002"])
def test_no_change_of_a_number_makes_another_task_of_it(change):
    first, other = attempt(), attempt(change)
    assert first.identity != other.identity and first.seed != other.seed
    assert len(begun(first)) == 1
    assert begun(other) == (first, other)


def test_program_robot_and_number_of_runs_are_of_the_attempt():
    for other in (attempt(runs=300), attempt(source="c"), attempt(files={"robot.sdf": "c"})):
        assert other.identity != attempt().identity and other.task == attempt().task


def test_what_a_run_does_not_depend_on_is_no_choice_of_its_draws():
    same = ("name=mine", "description=best of ten", "seed=7", "visual.rate=10")
    assert {attempt(each).identity for each in same} == {attempt().identity}
    assert 2**32 < attempt().seed < 2**64  # None that `campaign --seed` takes.


def test_a_copy_of_the_robot_in_another_folder_is_the_same(tmp_path):
    """Its files count by their content, which is not here."""
    folders = [copied("campaign_of_a_urdf/box_urdf", tmp_path / name) for name in ("a", "b")]
    scenario = uv.load_scenario(NAME)
    first, other = (attempt_of(replace(scenario, model=str(each)), PROGRAM, 60, 0.95)
                    for each in folders)
    assert first == other and first.task.startswith("box_urdf, SensedContact, press")


def test_tasks_are_told_apart_by_robot_contact_and_mission():
    tasks = [task_of(uv.load_scenario(each)) for each in (
        NAME, "girona500_tip_first", "girona500_ideal", "bluerov2_real_loop",
        "jacket_inspection_real")]
    assert tasks[0] == tasks[1] == "girona500_arm5e, SensedContact, press"
    assert tasks[4] == "girona500_arm5e, SensedContact, mission"
    assert len(set(tasks)) == 4
    begun(attempt())
    assert len(begun(attempt(name="bluerov2_real_loop"))) == 1


def test_a_further_step_of_another_kind_makes_no_other_task_of_a_mission():
    mission = uv.load_scenario("jacket_inspection_real")
    kinds = {type(step).__name__ for step in mission.mission.steps}
    less = replace(mission, mission=replace(mission.mission, steps=[
        step for step in mission.mission.steps if type(step).__name__ != "Slide"]))
    first, other = (attempt_of(each, PROGRAM, 60, 0.95) for each in (mission, less))
    assert "Slide" in kinds and first.identity != other.identity
    assert len(begun(first)) == 1 and begun(other) == (first, other)


def test_another_confidence_than_that_of_the_first_attempt_is_refused_and_none_is_counted():
    """Of the same draws, and of others: 1 − c is spent by all attempts together."""
    first = attempt()
    begun(first)
    assert attempt(confidence=0.99).identity == first.identity
    for other in (attempt(confidence=0.99), attempt(runs=300, confidence=0.5)):
        with pytest.raises(InvalidParameter, match=r"must be 0\.95, over all attempts at"):
            begun(other)
    assert [json.loads(line)["confidence"] for line in ledger_path().read_text(
        "utf-8").splitlines()] == [0.95]
    assert len(begun(attempt(name="bluerov2_real_loop", confidence=0.99))) == 1


def test_another_numpy_makes_other_runs(monkeypatch):
    first = attempt()
    monkeypatch.setattr("uvms_drake.certificate.attempts.version", lambda name: f"of {name}")
    assert attempt().identity != first.identity and attempt().task == first.task


def test_an_attempt_is_counted_once_and_in_the_order_of_the_first_time():
    first, second = attempt(), attempt(runs=300)
    for each, number in ((first, 1), (second, 2), (first, 1), (second, 2)):
        assert len(begun(each)) == number
    lines = ledger_path().read_text("utf-8").splitlines()
    assert [json.loads(line)["runs"] for line in lines] == [60, 300]
