"""The command: one's own law by one file and one flag, continued runs, and messages."""

import json
from concurrent.futures import Future
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem

from uvms_drake.benchmark.benchmark import Run, completed, runs_of
from uvms_drake.benchmark.controllers import CONTROLLERS, controller_named, versions_of
from uvms_drake.benchmark.overview import draw_overview, relative_errors
from uvms_drake.benchmark.recorded import read_runs, write_runs
from uvms_drake.benchmark.table import NAVIGATION, STEPS, WHY, format_benchmark, summarise
from uvms_drake.campaign.pool import Pool
from uvms_drake.command.main import main
from uvms_drake.common.errors import InvalidParameter, RunFailed

RESULTS = Path(__file__).parents[2] / "examples" / "results"
OWN = '''
import numpy as np
from pydrake.systems.framework import LeafSystem


class Float(LeafSystem):
    """No force at all."""

    def __init__(self, size):
        super().__init__()
        self.DeclareVectorInputPort("state", 2 * size)
        self.DeclareVectorInputPort("force_measured", 6)
        self.DeclareVectorOutputPort("tau", size, lambda context, output: output.SetFromVector(
            np.zeros(size)))


def make_controller(scenario, model):
    return Float(model.size)
'''


@pytest.mark.slow
def test_a_law_of_ones_own_enters_by_one_file_and_one_flag(tmp_path, capsys):
    own, out = tmp_path / "my_law.py", tmp_path / "out"
    own.write_text(OWN, encoding="utf-8")
    name = f"{own}:make_controller"
    command = ["benchmark", "--controllers", name, "--robots", "girona500_arm5e", "--cases",
               "ideal", "--output", str(out), "--quiet"]
    assert main(command) == 0
    assert "| ideal:" in capsys.readouterr().out
    cell = json.loads((out / "benchmark.json").read_text("utf-8"))["cells"]["girona500_arm5e"][
        "ideal"][name]
    assert cell["runs"] == 1 and cell["peak"]["worst"] == 0.0  # It never touches.
    assert (out / "benchmark_girona500_arm5e.png").is_file()
    assert (out / "benchmark.png").is_file()
    # The same command repeats no run.
    (run,) = (out / "runs").iterdir()
    written = run.stat().st_mtime_ns
    assert main(command) == 0
    assert run.stat().st_mtime_ns == written
    assert main([*command, "--seed", "2"]) == 2
    assert "a folder without runs of another seed" in capsys.readouterr().err


def test_a_file_without_the_function_and_unknown_names_are_refused(tmp_path, capsys):
    own = tmp_path / "my_law.py"
    own.write_text("make = 1\n", encoding="utf-8")
    for option, value, message in (
            ("--controllers", str(own), "a file with a function make_controller"),
            ("--controllers", "pid", "FILE.py:FUNCTION"), ("--robots", "otter", "of bluerov2"),
            ("--cases", "storm", "of ideal"), ("--runs", "0", "at least 1")):
        assert main(["benchmark", option, value, "--output", str(tmp_path / "out")]) == 2
        assert message in capsys.readouterr().err


def test_finished_runs_alone_are_shown(tmp_path, capsys):
    out, (run, _) = tmp_path / "out", runs_of(["impedance"], ["girona500_arm5e"],
                                              ["thrusters", "soft"], 1, 1)
    command = ["benchmark", "--finished", "--quiet", "--output", str(out)]
    assert main(command) == 2
    assert "none of these runs" in capsys.readouterr().err
    (out / "runs").mkdir(parents=True, exist_ok=True)
    (out / "runs" / run.file).write_text(json.dumps(result(
        "impedance", 0, 0.25)), encoding="utf-8")
    assert main(command) == 0
    text = capsys.readouterr().out
    assert "1 runs" in text and "0.25 / 21 / 0.25" in text


def test_a_controller_is_found_by_its_file(tmp_path):
    own = tmp_path / "my_law.py"
    own.write_text(OWN, encoding="utf-8")
    assert isinstance(controller_named(str(own))(None, type("Model", (), {"size": 10})), LeafSystem)
    assert controller_named("impedance") is CONTROLLERS["impedance"]


def test_a_file_with_postponed_annotations_and_a_dataclass_is_loaded(tmp_path):
    own = tmp_path / "law_with_data.py"
    own.write_text("from __future__ import annotations\n\nfrom dataclasses import dataclass\n\n\n"
                   "@dataclass\nclass Gains:\n    k: float = 2.0\n\n\n"
                   "def make_controller(scenario, model):\n    return Gains().k\n", "utf-8")
    assert controller_named(str(own))(None, None) == 2.0


def result(controller: str, index: int, rms: float | None, **other) -> dict:
    return {"controller": controller, "robot": "girona500_arm5e", "case": "thrusters", "seed": 1,
            "index": index, "versions": versions_of(controller), "error": None,
            "ended": None if rms is not None else "force",
            "force_rms": rms, "peak": 21.0, "settling": rms, "touch": 4.0, "lateral": 0.001,
            "lost": 0, "limits": {"q": 0.1 * index}, "saturated": 0.0, "chatter": 1.0,
            "energy": 5.0, "step_ms": 0.2, "worst_step_ms": 0.3, **other}


def test_medians_worst_and_lost_rows_are_those_of_the_runs():
    summary = summarise([
        *(result("impedance", i, rms) for i, rms in enumerate((0.1, 0.2, 0.9))),
        *(result("tube_mpc", i, rms, peak=20.5) for i, rms in enumerate((0.3, 0.4, None)))])
    cells = summary["cells"]["girona500_arm5e"]["thrusters"]
    assert cells["impedance"]["force_rms"] == pytest.approx({"median": 0.2, "worst": 0.9})
    assert cells["tube_mpc"]["force_rms"] == {"median": 0.4, "worst": np.inf}
    assert cells["impedance"]["limits"] == pytest.approx({"q": 0.2})
    assert cells["tube_mpc"]["failed"] == 1
    assert [(row["metric"], row["by"], row["why"]) for row in summary["better_than_tube"]] == [
        ("force_rms", "impedance", NAVIGATION), ("settling", "impedance", STEPS)]
    text = format_benchmark(summary)
    assert "| runs that broke a limit | 3 of 3 | 3 of 3 |" in text
    assert "| of those on walls of the declared class | 3 of 3 | 3 of 3 |" in text
    assert WHY[NAVIGATION] in text and WHY[STEPS] in text
    assert "0.2 (0.9) / 21 / 0.2 (0.9)" in text and "0.4 (–) / 20.5 / 0.4 (–)" in text


def test_a_stiff_wall_is_not_of_the_class():
    text = format_benchmark(summarise([
        result("tube_mpc", 0, 0.3, limits={}), result("tube_mpc", 0, 0.3, case="stiff")]))
    assert "| runs that broke a limit | 1 of 2 |" in text
    assert "| of those on walls of the declared class | 0 of 1 |" in text


def test_the_first_draw_of_every_case_comes_before_the_second_of_any():
    runs = runs_of(["impedance"], ["girona500_arm5e"], ["soft", "stiff"], 2, 1)
    assert [(run.case, run.index) for run in runs] == [
        ("soft", 0), ("stiff", 0), ("soft", 1), ("stiff", 1)]
    assert len({run.file for run in runs}) == 4


def test_the_overview_has_the_medians_over_the_desired_force():
    summary = summarise([
        *(result("impedance", i, rms, desired=20.0) for i, rms in enumerate((0.1, 0.2, 0.9))),
        result("tube_mpc", 0, None, desired=20.0, limits={})])
    errors = relative_errors(summary, "girona500_arm5e", ["tube_mpc", "impedance"])
    assert errors.ravel() == pytest.approx([np.inf, 1.0])
    (axis, _) = draw_overview(summary).axes
    assert [label.get_text() for label in axis.get_yticklabels()] == ["tube mpc", "impedance"]
    assert [text.get_text() for text in axis.texts] == ["–", "1.0"]
    assert len(axis.patches) == 1  # The impedance breaks a limit by 0.2.


def test_of_unfinished_runs_the_whole_draws_are_shown(tmp_path):
    runs = runs_of(["impedance", "admittance"], ["girona500_arm5e"], ["thrusters"], 3, 1)
    (tmp_path / "runs").mkdir()

    def finish(*which: Run) -> list[int]:
        for run in which:
            (tmp_path / "runs" / run.file).write_text(json.dumps(
                result(run.controller, run.index, 0.2)), encoding="utf-8")
        found = completed(runs, tmp_path, Pool(None), lambda text, done: None, finished=True)
        return [each["index"] for each in found]

    assert finish(runs[0]) == [0]  # No draw is whole: all that there is.
    assert finish(runs[2], runs[3]) == [1, 1]
    assert finish(runs[1], runs[4]) == [0, 0, 1, 1]


def test_a_recorded_benchmark_has_the_same_tables(tmp_path, capsys):
    runs = [result("tube_mpc", 0, 0.3, exits=3), result("tube_mpc", 1, 0.3, error="Bad: a, b"),
            *(result("impedance", i, rms, desired=20.0) for i, rms in enumerate((0.1, 0.2, None)))]
    write_runs(runs, tmp_path / "benchmark.csv")
    read = read_runs(tmp_path / "benchmark.csv")
    assert summarise(read) == summarise(runs)
    assert read[0] == {key: value for key, value in runs[0].items() if key != "ended"}
    command = ["benchmark", "--output", str(tmp_path / "out"), "--quiet"]
    recorded = ["--recorded", str(tmp_path / "benchmark.csv")]
    assert main([*command, *recorded, "--controllers", "impedance"]) == 0
    assert "| tube_mpc" not in capsys.readouterr().out
    again = read_runs(tmp_path / "out" / "benchmark.csv")
    assert [run["controller"] for run in again] == ["impedance"] * 3


def test_the_published_page_has_the_tables_and_the_counts_of_its_runs(monkeypatch):
    monkeypatch.syspath_prepend(RESULTS)
    import make_all
    runs = read_runs(RESULTS / "benchmark.csv")
    page = (RESULTS / "benchmark.md").read_text(encoding="utf-8")
    assert format_benchmark(summarise(runs)) in page
    assert make_all.reading(runs) in page
    assert {(run["controller"], run["case"], run["index"]) for run in runs} == set(
        product(make_all.COMPARED, make_all.TRIED, range(make_all.DRAWS)))


def test_a_file_that_records_no_benchmark_is_refused(tmp_path, capsys):
    (tmp_path / "log.csv").write_text("time,force\n0.0,1.0\n", encoding="utf-8")
    write_runs([result("impedance", 0, 0.1)], tmp_path / "benchmark.csv")
    for file, case in (("log.csv", "soft"), ("none.csv", "soft"), ("benchmark.csv", "soft")):
        command = ["benchmark", "--recorded", str(tmp_path / file), "--cases", case]
        assert main([*command, "--output", str(tmp_path / "out")]) == 2
        assert f"--recorded = {tmp_path / file}" in capsys.readouterr().err.replace("'", "")
    assert not (tmp_path / "out").exists()


def test_a_damaged_file_of_a_run_is_repeated(tmp_path):
    (run,) = runs_of(["impedance"], ["girona500_arm5e"], ["soft"], 1, 1)
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / run.file).write_text('{"controller": ', encoding="utf-8")
    pool, computed = computing({**result("impedance", 0, 0.1), "case": "soft"})
    (found,) = completed([run], tmp_path, pool, lambda text, done: None)
    assert computed == [run] and found["case"] == "soft"
    assert completed([run], tmp_path, pool, lambda text, done: None) == [found]
    assert computed == [run]


def test_an_error_another_version_and_a_changed_file_are_computed_again(tmp_path, monkeypatch):
    own = tmp_path / "my_law.py"
    own.write_text(OWN, encoding="utf-8")
    (run,) = runs_of([str(own)], ["girona500_arm5e"], ["soft"], 1, 1)

    def go_on(pool: Pool, finished: bool = False):
        return completed([run], tmp_path, pool, lambda text, done: None, finished=finished)

    failed = {**result(str(own), 0, None), "error": "RuntimeError: broken"}
    pool, computed = computing(failed)
    assert go_on(pool) == go_on(pool) == [failed]
    assert len(computed) == 2
    pool, computed = computing(result(str(own), 0, 0.1))
    (found,) = go_on(pool)
    assert go_on(pool) == [found] and len(computed) == 1
    own.write_text(OWN.replace("No force", "Still no force"), encoding="utf-8")
    with pytest.raises(InvalidParameter, match="none of these runs"):
        go_on(pool, finished=True)
    pool, computed = computing(result(str(own), 0, 0.2))
    assert go_on(pool)[0]["force_rms"] == 0.2 and len(computed) == 1
    monkeypatch.setattr("uvms_drake.benchmark.controllers.source_digest", lambda *_: "later")
    with pytest.raises(RunFailed, match="of a worker are not those"):
        go_on(pool)
    pool, computed = computing(result(str(own), 0, 0.3))
    assert go_on(pool)[0]["force_rms"] == 0.3 and len(computed) == 1


def test_files_of_ones_own_controllers_do_not_collide():
    names = ("a/b.py", "a_b.py", "a_b.py:make", "a_b.py_make", "é.py", "è.py", f"{'a' * 300}.py")
    files = [Run(name, "girona500_arm5e", "soft", 1, 0).file for name in names]
    assert len(set(files)) == len(names)
    assert all("/" not in file and len(file.encode()) < 200 for file in files)
    assert Run("impedance", "girona500_arm5e", "soft", 1, 0).file == (
        "girona500_arm5e.soft.impedance.0.json")


def computing(found: dict) -> tuple[Pool, list[Run]]:
    """Returns workers that find a result for every run, and the list of runs that they compute."""
    computed = []

    class Now:
        def __enter__(self):
            return self

        def __exit__(self, *_):
            return None

        def submit(self, function, which):
            future = Future()
            computed.append(which)
            future.set_result(found)
            return future

    return Pool(Now, 1), computed
