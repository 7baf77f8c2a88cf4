"""The command: one's own law by one file and one flag, continued runs, tables, and messages."""

import json
from concurrent.futures import Future
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem

import uvms_drake as uv
from uvms_drake.benchmark.benchmark import (
    Run,
    completed,
    read_record,
    run_one,
    runs_of,
    write_record,
)
from uvms_drake.benchmark.controllers import CONTROLLERS, controller_named
from uvms_drake.benchmark.figures import (
    LINES,
    draw_forces,
    draw_overview,
    relative_errors,
    title_of,
)
from uvms_drake.benchmark.table import format_benchmark, summarise
from uvms_drake.campaign.harness import runs, stored
from uvms_drake.campaign.pool import Pool
from uvms_drake.command.main import main
from uvms_drake.common.progress import silent

RESULTS = Path(__file__).parents[2] / "examples" / "results"
ROBOT = "girona500_arm5e"
OWN = '''
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import LeafSystem


@dataclass
class Gains:
    k: float = 0.0


class Float(LeafSystem):
    """No force at all."""

    def __init__(self, size):
        super().__init__()
        self.DeclareVectorInputPort("state", 2 * size)
        self.DeclareVectorInputPort("force_measured", 6)
        self.DeclareVectorOutputPort("tau", size, lambda context, output: output.SetFromVector(
            np.full(size, Gains().k)))


def make_controller(scenario, model):
    return Float(model.size)
'''


@pytest.fixture
def own(tmp_path):
    """The file of a controller of one's own."""
    file = tmp_path / "my_law.py"
    file.write_text(OWN, encoding="utf-8")
    return file


class Now:
    """Workers that find a result for every run, and keep the runs that they compute."""

    def __init__(self, result):
        self.result, self.computed = result, []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def submit(self, function, which):
        future = Future()
        self.computed.append(which)
        future.set_result(self.result)
        return future

    def complete(self, wanted, folder, finished=False):
        return completed(wanted, folder, Pool(lambda: self), silent, finished=finished)


def result(controller: str, index: int, rms: float | None, **other) -> dict:
    return {"controller": controller, "robot": ROBOT, "case": "thrusters", "seed": 1,
            "index": index, "error": None, "ended": None if rms is not None else "force",
            "force_rms": rms, "peak": 21.0, "settling": rms, "touch": 4.0, "lateral": 0.001,
            "lost": 0, "limits": {"q": 0.1 * index}, "saturated": 0.0, "chatter": 1.0,
            "energy": 5.0, "step_ms": 0.2, "worst_step_ms": 0.3, **other}


def test_cases_outside_of_what_is_declared_have_a_table_of_their_own_and_no_overview():
    limits = {"limits": {}, "above": 0.0, "beyond": 0.0}
    summary = summarise([
        result("tube_mpc", 0, 9.0, case="wave", off=0.2, **limits),
        result("impedance", 0, 9.0, case="wave", off=0.1, **limits),
        result("impedance", 0, 0.5, off=0.1, **limits)])
    text = format_benchmark(summary)
    held, outside = text.split("Outside of the class")
    assert "thrusters: " in held and "wave: " not in held
    assert "along the direction | 21 / 0 / 0.2 / 0 | 21 / 0 / 0.1 / 0 |" in outside
    assert [row["metric"] for row in summary["better_than_tube"]] == ["off"]
    assert relative_errors(summary | {"desired": {ROBOT: 10.0}}, ROBOT, ["impedance"]) == (
        pytest.approx(np.array([[5.0]])))


@pytest.mark.parametrize("change", [
    {"error": "ValueError: bad"}, {"ended": "force beyond 500 N"}, {"touch": None},
    {"event": 20.0, "touch": 21.0}])
def test_a_run_that_failed_or_did_not_press_beats_nobody_outside_of_the_class(change):
    tried = {"case": "wave", "limits": {}, "above": 1.0, "beyond": 0.1, "off": 0.2, "event": 20.0}
    summary = summarise([result("tube_mpc", 0, 0.5, **tried), result(
        "impedance", 0, 0.5, **{**tried, "peak": 0.0, "above": 0.0, "off": 0.0, **change})])
    assert summary["better_than_tube"] == []
    assert "| – / – / – / – |" in format_benchmark(summary)


def test_a_law_of_ones_own_has_a_line_and_a_name_of_its_own_in_the_figure():
    own = "/home/me/laws/my_law.py:make_controller"
    assert title_of(own) == "my law.py" and title_of("laws.py:make_pid") == "laws.py:make pid"
    names = [*CONTROLLERS, own, "other.py"]
    results = [result(name, 0, 1.0, case="ideal", desired=20.0, curve={
        "time": [0.0, 1.0], "force": [0.0, 20.0]}) for name in names]
    curves = [line for line in draw_forces(results).axes[0].get_lines()
              if line.get_label() in map(title_of, names)]
    styles = {(line.get_color(), str(line.get_linestyle()), str(line._dash_pattern))
              for line in curves}
    assert len(styles) == len(curves) == len(names) <= len(LINES) + 1


@pytest.mark.long
def test_a_law_of_ones_own_enters_by_one_file_and_one_flag(own, tmp_path, capsys):
    out, name = tmp_path / "out", f"{own}:make_controller"
    command = ["benchmark", "--controllers", name, "--robots", ROBOT, "--cases", "ideal",
               "--output", str(out), "--quiet"]
    assert main(command) == 0
    assert "| ideal:" in capsys.readouterr().out
    cell = json.loads((out / "benchmark.json").read_text("utf-8"))["cells"][ROBOT]["ideal"][name]
    assert cell["runs"] == 1 and cell["peak"]["worst"] == 0.0  # It never touches.
    assert (out / "benchmark_girona500_arm5e.png").is_file()
    assert (out / "benchmark.png").is_file()
    written = (out / "runs.jsonl").read_bytes()
    assert main(command) == 0  # The same command repeats no run.
    assert (out / "runs.jsonl").read_bytes() == written


@pytest.mark.parametrize(("option", "value", "said"), [
    ("--controllers", "empty.py", "a file with a function make_controller"),
    ("--controllers", "pid", "FILE.py:FUNCTION"), ("--robots", "otter", "of bluerov2"),
    ("--cases", "storm", "of ideal"), ("--runs", "0", "at least 1"),
    ("--recorded", "log.csv", "the CSV of a benchmark, with"),
    ("--recorded", "benchmark.csv", "some of the")])
def test_bad_input_is_one_line_and_nothing_is_written(
        option, value, said, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("empty.py").write_text("make = 1\n", encoding="utf-8")
    Path("log.csv").write_text("time,force\n0.0,1.0\n", encoding="utf-8")
    write_record([result("impedance", 0, 0.1)], Path("benchmark.csv"))
    more = ["--cases", "soft"] if option == "--recorded" else []
    assert main(["benchmark", option, value, *more, "--output", "out"]) == 2
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == 1
    assert not Path("out").exists()


def test_a_controller_is_found_by_its_name_or_file_and_first_draws_come_first(own):
    assert isinstance(controller_named(str(own))(None, type("Model", (), {"size": 10})), LeafSystem)
    assert controller_named("impedance") is CONTROLLERS["impedance"]
    wanted = runs_of(["impedance"], [ROBOT], ["soft", "stiff"], 2, 1)
    assert [(run.case, run.draw) for run in wanted] == [
        ("soft", 0), ("stiff", 0), ("soft", 1), ("stiff", 1)]


def test_medians_worst_and_lost_rows_are_those_of_the_runs():
    summary = summarise([
        *(result("impedance", i, rms) for i, rms in enumerate((0.1, 0.2, 0.9))),
        *(result("tube_mpc", i, rms, peak=20.5) for i, rms in enumerate((0.3, 0.4, None)))])
    cells = summary["cells"][ROBOT]["thrusters"]
    assert cells["impedance"]["force_rms"] == pytest.approx({"median": 0.2, "worst": 0.9})
    assert cells["tube_mpc"]["force_rms"] == {"median": 0.4, "worst": np.inf}
    assert cells["impedance"]["limits"] == pytest.approx({"q": 0.2})
    assert cells["tube_mpc"]["failed"] == 1
    assert [(row["metric"], row["by"]) for row in summary["better_than_tube"]] == [
        ("force_rms", "impedance"), ("settling", "impedance")]
    text = format_benchmark(summary)
    assert "| runs that broke a limit | 3 of 3 | 3 of 3 |" in text
    assert "0.2 (0.9) / 21 / 0.2 (0.9)" in text and "0.4 (–) / 20.5 / 0.4 (–)" in text
    # A stiff wall is not of the class.
    text = format_benchmark(summarise([
        result("tube_mpc", 0, 0.3, limits={}), result("tube_mpc", 0, 0.3, case="stiff")]))
    assert "| runs that broke a limit | 1 of 2 |" in text
    assert "| of those within the declared class | 0 of 1 |" in text


def test_the_overview_has_the_medians_over_the_desired_force():
    summary = summarise([
        *(result("impedance", i, rms, desired=20.0) for i, rms in enumerate((0.1, 0.2, 0.9))),
        result("tube_mpc", 0, None, desired=20.0, limits={})])
    errors = relative_errors(summary, ROBOT, ["tube_mpc", "impedance"])
    assert errors.ravel() == pytest.approx([np.inf, 1.0])
    (axis, _) = draw_overview(summary).axes
    assert [label.get_text() for label in axis.get_yticklabels()] == ["tube mpc", "impedance"]
    assert [text.get_text() for text in axis.texts] == ["–", "1.0"]
    assert len(axis.patches) == 1  # The impedance breaks a limit by 0.2.


def test_of_unfinished_runs_the_whole_draws_are_shown(tmp_path, capsys):
    wanted = runs_of(["impedance", "admittance"], [ROBOT], ["thrusters"], 3, 1)

    def finish(*which: Run) -> list[int]:
        runs(which, lambda run: result(run.controller, run.draw, 0.25), tmp_path,
             Pool(lambda: Here()))
        return [each["index"] for each in Now(None).complete(wanted, tmp_path, finished=True)]

    class Here(Now):
        def __init__(self):
            super().__init__(None)

        def submit(self, function, which):
            self.result = function(which)
            return super().submit(function, which)

    with pytest.raises(uv.InvalidParameter, match="none of these runs"):
        finish()
    assert finish(wanted[0]) == [0]  # No draw is whole: all that there is.
    assert finish(wanted[2], wanted[3]) == [1, 1]
    assert finish(wanted[1], wanted[4]) == [0, 0, 1, 1]
    command = ["benchmark", "--finished", "--quiet", "--output", str(tmp_path), "--runs", "2"]
    assert main([*command, "--controllers", "impedance", "--cases", "thrusters"]) == 0
    text = capsys.readouterr().out
    assert "2 runs" in text and "0.25 / 21 / 0.25" in text


def test_a_recorded_benchmark_has_the_same_tables(tmp_path, capsys):
    found = [result("tube_mpc", 0, 0.3, exits=3), result("tube_mpc", 1, 0.3, error="Bad: a, b"),
             *(result("impedance", i, rms, desired=20.0) for i, rms in enumerate((0.1, 0.2, None)))]
    write_record(found, tmp_path / "benchmark.csv")
    read = read_record(tmp_path / "benchmark.csv")
    assert summarise(read) == summarise(found)
    assert read[0] == {key: value for key, value in found[0].items() if key != "ended"}
    command = ["benchmark", "--output", str(tmp_path / "out"), "--quiet"]
    recorded = ["--recorded", str(tmp_path / "benchmark.csv")]
    assert main([*command, *recorded, "--controllers", "impedance"]) == 0
    assert "| tube_mpc" not in capsys.readouterr().out
    again = read_record(tmp_path / "out" / "benchmark.csv")
    assert [run["controller"] for run in again] == ["impedance"] * 3


def test_the_published_page_has_the_tables_and_the_counts_of_its_runs(monkeypatch):
    monkeypatch.syspath_prepend(RESULTS)
    import make_all
    found = read_record(RESULTS / "benchmark.csv")
    page = (RESULTS / "benchmark.md").read_text(encoding="utf-8")
    assert format_benchmark(summarise(found)) in page
    assert make_all.reading(found) in page
    assert make_all.own_controller() in page
    assert {(run["controller"], run["case"], run["index"]) for run in found} == set(
        product(make_all.COMPARED, make_all.TRIED, range(make_all.DRAWS)))


def test_the_published_page_outside_of_the_class_has_the_tables_of_its_runs(monkeypatch):
    monkeypatch.syspath_prepend(RESULTS)
    import make_all
    found = read_record(RESULTS / "benchmark_outside.csv")
    page = (RESULTS / "benchmark_outside.md").read_text(encoding="utf-8")
    assert format_benchmark(summarise(found)).strip() in page
    assert make_all.READING_OUTSIDE.strip() in page
    assert {(run["controller"], run["case"]) for run in found} == set(
        product(make_all.COMPARED, make_all.OUTSIDE))


def test_an_error_another_version_and_a_changed_file_are_computed_again(
        own, tmp_path, monkeypatch):
    def wanted():
        return runs_of([str(own)], [ROBOT], ["soft"], 1, 1)

    def computed(answer, times=1):
        now = Now(answer)
        for _ in range(times):
            assert now.complete(wanted(), tmp_path) == [answer]
        return len(now.computed)

    failed = {**result(str(own), 0, None), "error": "RuntimeError: broken"}
    assert computed(failed, 2) == 2
    assert computed(result(str(own), 0, 0.1), 2) == 1
    own.write_text(OWN.replace("No force", "Still no force"), encoding="utf-8")
    with pytest.raises(uv.InvalidParameter, match="none of these runs"):
        Now(None).complete(wanted(), tmp_path, finished=True)
    assert computed(result(str(own), 0, 0.2), 2) == 1
    assert len(stored(tmp_path)) == 2
    # A worker with other files computes nothing.
    before = wanted()
    monkeypatch.setattr("uvms_drake.benchmark.benchmark.source_digest", lambda *_: "later")
    with pytest.raises(uv.RunFailed, match="of a worker are not those"):
        run_one(before[0])
    assert computed(result(str(own), 0, 0.3), 2) == 1
