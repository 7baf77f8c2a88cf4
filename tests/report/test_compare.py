"""Tests of `uvms_drake.report.compare`, and of the command that writes it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from support.drawings import panels_of
from support.synthetic import synthetic_record, synthetic_sensed_record

from uvms_drake.command.compare import short_names
from uvms_drake.command.main import main
from uvms_drake.report.compare import (
    comparison_drawing,
    differing_keys,
    format_comparison,
    metrics_of,
    normal_force,
)
from uvms_drake.report.summary import summarise
from uvms_drake.station.record import save_record
from uvms_drake.station.scenario.scenario import load_scenario


def test_the_keys_that_differ_are_found_at_any_depth_and_no_others():
    scenarios = [load_scenario("girona500_ideal", changes) for changes in (
        [], ["seed=7", "surface.stiffness=700", "limits.u.0=0.3"])]
    found = differing_keys(scenarios)
    assert set(found) == {"seed", "surface.stiffness", "limits.u"}
    assert found["seed"] == ["0", "7"]
    assert found["surface.stiffness"][1] == "700.0"


def test_of_a_list_with_other_parts_there_are_the_kinds_alone():
    steps = "mission.steps=[!Approach {}, !Hold {seconds: 7.0}, !Retreat {}]"
    found = differing_keys([load_scenario("girona500_inspection", changes) for changes in (
        [], [steps], ["mission.steps.1.seconds=7.0"])])
    assert set(found) == {"mission.steps"}
    assert found["mission.steps"] == [
        "Approach, Hold, Retreat, Approach, Hold, Slide, Retreat", "Approach, Hold, Retreat",
        "Approach, Hold, Retreat, Approach, Hold, Slide, Retreat"]
    found = differing_keys([load_scenario("girona500_inspection", changes) for changes in (
        [], ["mission.steps.1.seconds=7.0"])])
    assert found == {"mission.steps.1.seconds": ["5.0", "7.0"]}


def test_what_another_kind_of_part_does_not_have_is_a_dash():
    found = differing_keys([load_scenario("girona500_ideal", changes) for changes in (
        [], ["surface=!BilateralSpring {}"])])
    assert found["surface._tag"] == ["-", "!BilateralSpring"]  # The first is the default kind.
    assert found["surface.normal"][1] == "-"


def test_the_table_has_a_column_for_each_run():
    first, second = synthetic_record(), synthetic_record(wall_time_s=5.0)
    first, second = (summarise(replace(each, force=force)) for each, force in (
        (first, first.force), (second, 0.9 * second.force)))
    text = format_comparison(["a", "b"], [first, second], {"seed": ["0", "7"]})
    rows = {cells[1].strip(): [cell.strip() for cell in cells[2:-1]]
            for line in text.splitlines() if (cells := line.split("|"))[1:]}
    assert rows[""] == ["a", "b"]
    assert rows["seed"] == ["0", "7"]
    assert [float(x) for x in rows["normal force error, end [N]"]] == pytest.approx(
        [0.0, -2.0], abs=1e-3)
    assert rows["times real time [-]"] == ["2", "4"]
    assert set(metrics_of(first)) <= set(rows)


def test_the_force_of_a_sensed_wall_is_that_along_the_direction_into_it():
    record = synthetic_sensed_record(2.0)
    force, desired = normal_force(record)
    np.testing.assert_array_equal(force, record.force[:, 0])
    np.testing.assert_array_equal(desired, record.desired_force[:, 0])


def test_every_run_is_a_line_in_every_panel():
    records = [synthetic_record(), synthetic_record(10.0)]
    drawing = comparison_drawing(["one", "two"], records)
    for panel in panels_of(drawing):
        assert "[" in panel.label
        for name, record in zip(("one", "two"), records, strict=True):
            (found,) = (each for each in panel.series if each.style.get("label") == name)
            assert len(found.y) == len(found.x) == len(record.time)
    np.testing.assert_allclose(drawing.columns[0][0].series[0].y, records[0].force[:, 0])


def test_the_command_writes_table_data_and_picture(tmp_path, capsys):
    for name, seed in (("a", 1), ("b", 2)):
        record = synthetic_record(3.0)
        (tmp_path / name).mkdir()
        save_record(replace(record, scenario=replace(record.scenario, seed=seed)), tmp_path / name)
    output = tmp_path / "both"
    folders = [str(tmp_path / name) for name in "ab"]
    assert main(["compare", *folders, "--output", str(output)]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith((output / "compare.md").read_text("utf-8").rstrip())
    data = json.loads((output / "compare.json").read_text("utf-8"))
    assert (data["runs"], data["differences"]) == (["a", "b"], {"seed": ["1", "2"]})
    with Image.open(output / "compare.png") as image:
        assert image.width > 900
    assert main(["compare", folders[0], "--output", str(output)]) == 2
    assert "two to 6 folders" in capsys.readouterr().err
    assert main(["compare", folders[0], str(tmp_path / "c")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_folders_are_named_by_as_much_of_their_path_as_is_needed(tmp_path):
    assert short_names([tmp_path / "x" / "a", tmp_path / "x" / "b"]) == ["a", "b"]
    assert short_names([tmp_path / "x" / "a", tmp_path / "y" / "a"]) == ["x/a", "y/a"]
    assert len(short_names([tmp_path, tmp_path])) == 2
