"""Tests of `uvms_drake.station.scenario.scenario`."""

import dataclasses

import pytest
from pydrake.common.yaml import yaml_dump_typed, yaml_load_data
from support.scenarios import error_of, load_text

from uvms_drake.common.errors import InvalidParameter, ScenarioError
from uvms_drake.common.kinds import kinds_of
from uvms_drake.common.schema import check_values
from uvms_drake.station.scenario.scenario import (
    Scenario,
    dump_scenario,
    load_scenario,
)
from uvms_drake.station.scenario.scenario_file import shipped_scenarios


@pytest.mark.parametrize("name", shipped_scenarios())
def test_a_shipped_scenario_has_its_name_and_a_description(name):
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.description


@pytest.mark.parametrize("name", shipped_scenarios())
def test_loading_the_dump_gives_the_same_scenario(name, tmp_path):
    dump = dump_scenario(load_scenario(name))
    assert dump_scenario(load_text(tmp_path, dump)) == dump


@pytest.mark.parametrize("name", shipped_scenarios())
def test_the_dump_has_the_fields_in_their_order(name):
    data = yaml_load_data(dump_scenario(load_scenario(name)))
    assert list(data) == [field.name for field in dataclasses.fields(Scenario)]
    assert list(data["start"]) == ["eta", "q"]
    assert list(data["simulator"]) == [
        "integration_scheme", "max_step_size", "accuracy", "use_error_control", "start_time",
        "target_realtime_rate"]


@pytest.mark.parametrize("description", [
    "publish_every_time_step: is mentioned first",
    "One line.\npublish_every_time_step: false\n",
    "One line.\n  publish_every_time_step: true\nAnother line.",
    yaml_dump_typed(Scenario().simulator, child_name="simulator"),
])
def test_no_text_is_lost_in_the_dump(description, tmp_path):
    """Whatever it says about a setting that is left out for the sake of other versions of Drake."""
    dump = dump_scenario(Scenario(name="mine", description=description))
    assert "publish_every_time_step" not in yaml_load_data(dump)["simulator"]
    loaded = load_text(tmp_path, dump)
    assert loaded.description == description
    assert dump_scenario(loaded) == dump


@pytest.mark.parametrize("text", ["", "null", "{}", "# Nothing."])
def test_an_empty_file_is_no_scenario(text, tmp_path):
    with pytest.raises(ScenarioError, match=r"^the file = (None|\{\}): must be a mapping of keys"):
        load_text(tmp_path, text)


def test_what_a_file_does_not_say_is_the_default_and_its_name_the_files(tmp_path):
    scenario = load_text(tmp_path, "seed: 0")
    assert dump_scenario(scenario) == dump_scenario(Scenario(name="mine"))


def test_the_default_of_every_choice_is_its_first_type():
    for field in dataclasses.fields(Scenario):
        if kinds_of(field.type):
            assert type(getattr(Scenario(), field.name)) is kinds_of(field.type)[0]


def test_a_mistake_in_the_file_is_reported_without_mention_of_overrides(tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text("mpc: {horizn: 5}", encoding="utf-8")
    error = error_of(str(path), ["seed=1"])
    assert error.startswith("mpc.horizn = 5: must be under")
    assert error.endswith(" (bad.yaml)")


def test_a_file_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    assert error_of(str(path)) == "cannot be read: it is not UTF-8 text (bad.yaml)"


def test_a_scenario_made_in_python_is_checked_too():
    with pytest.raises(InvalidParameter, match="duration = nan: must be positive"):
        check_values(Scenario(duration=float("nan")))


@pytest.mark.parametrize("name", shipped_scenarios())
def test_a_run_of_an_hour_is_no_reason_to_refuse_a_shipped_scenario(name):
    assert load_scenario(name, ["duration=3600"]).duration == 3600.0
