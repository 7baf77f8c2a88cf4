"""Tests of the command line, as users meet it: files, exit status, one line for an error."""

import json
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from uvms_drake import simulation
from uvms_drake.cli import main
from uvms_drake.errors import RunFailed
from uvms_drake.figures import FIGURES
from uvms_drake.model.description import models_dir
from uvms_drake.record import load_record
from uvms_drake.scenario import dump_scenario, load_scenario
from uvms_drake.summary import summarise

DATA = {"scenario.yaml", "summary.json", "log.npz", "timing.npz"}
QUICK = ["--no-figures", "--no-replay"]


def refusal(capsys, tmp_path, *args):
    """Runs with bad input and returns the only line on stderr; nothing may have been written."""
    output = tmp_path / "result"
    status = main(["run", "--duration", "0.2", "--output", str(output), *QUICK, *args])
    out, err = capsys.readouterr()
    assert (status, out) == (2, "")
    assert err.startswith("uvms-drake: error: ")
    assert err.count("\n") == 1
    assert not output.exists()
    return err


def broken_robot(tmp_path, old, new):
    """Returns a copy of the shipped robot with one text in its hydrodynamics file replaced."""
    folder = tmp_path / "girona500_arm5e"
    shutil.copytree(models_dir() / folder.name, folder)
    file = folder / "hydrodynamics.yaml"
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def smoke(tmp_path_factory):
    """Runs half a second of the main scenario as users do, with all outputs."""
    output = tmp_path_factory.mktemp("smoke") / "out"
    done = subprocess.run(
        [sys.executable, "-m", "uvms_drake", "run", "--duration", "0.5", "--seed", "3",
         "--output", str(output)], capture_output=True, text=True, check=False)
    return output, done


def test_a_short_run_writes_every_file(smoke):
    output, done = smoke
    assert done.returncode == 0, done.stderr
    assert {path.name for path in output.iterdir()} == DATA | {"replay.html", *FIGURES}


def test_a_run_prints_the_summary_and_where_the_files_are(smoke):
    output, done = smoke
    assert "girona500_contact, seed 3: 0.5 s" in done.stdout
    assert "certified     no (declared tube)" in done.stdout
    assert f"written to {output}: " in done.stdout


def test_progress_is_a_few_lines_on_stderr(smoke):
    lines = smoke[1].stderr.splitlines()
    assert 1 <= len(lines) <= 6
    assert all(line.startswith("simulating: ") for line in lines)


def test_the_written_files_belong_together(smoke):
    output, _ = smoke
    record = load_record(output)
    summary = json.loads((output / "summary.json").read_text(encoding="utf-8"))
    assert summarise(record) == summary
    assert (summary["seed"], summary["duration_s"]) == (3, 0.5)
    expected = load_scenario("girona500_contact", ["seed=3", "duration=0.5"])
    assert (output / "scenario.yaml").read_text(encoding="utf-8") == dump_scenario(expected)


def test_the_written_scenario_runs_again_to_the_same_log(smoke, tmp_path, capsys):
    output, _ = smoke
    again = tmp_path / "again"
    assert main(["run", str(output / "scenario.yaml"), "--output", str(again), *QUICK]) == 0
    capsys.readouterr()
    assert {path.name for path in again.iterdir()} == DATA
    assert (again / "log.npz").read_bytes() == (output / "log.npz").read_bytes()


def test_the_output_defaults_to_a_folder_named_after_the_scenario(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["run", "girona500_bilateral", "--duration", "0.1", *QUICK]) == 0
    assert "written to out/girona500_bilateral" in capsys.readouterr().out
    assert (tmp_path / "out" / "girona500_bilateral" / "log.npz").is_file()


def test_the_scenarios_are_listed_with_a_line_each(capsys):
    assert main(["scenarios"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["girona500_bilateral", "girona500_contact"]
    assert all(len(line.split()) > 5 for line in lines)


@pytest.mark.parametrize("args", [
    [], ["fly"], ["run", "--fast"], ["run", "a", "b"], ["run", "--seed"], ["scenarios", "x"]])
def test_arguments_that_make_no_sense_are_one_line(args, capsys):
    assert main(args) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("uvms-drake: error: ")
    assert err.count("\n") == 1


@pytest.mark.parametrize(("args", "expected"), [
    (["girona500_contcat"], "did you mean 'girona500_contact'?"),
    (["--set", "surface.stifness=3"], "surface.stifness = 3: must be under one of the keys point"),
    (["--set", "surface.stiffness=hard"], "surface.stiffness = 'hard': must be a finite number"),
    (["--seed", "x"], "seed = 'x': must be a whole number"),
    (["--duration", "-1"], "duration = -1.0: must be positive"),
    (["--set", "model=girona501"], "model = 'girona501': must be one of girona500_arm5e"),
    (["--set", "surface.stiffness=-1"], "surface.stiffness = -1.0: must be positive"),
    (["girona500_bilateral", "--set", "surface.stiffness.0.1=99"], "it is not symmetric"),
    (["girona500_bilateral", "--set", "surface.stiffness.0.0=-9"], "its smallest eigenvalue is -"),
    (["--set", "disturbance.bound=-0.1"], "disturbance.bound = -0.1: must be zero or positive"),
    (["--set", "start.q.0=1.6"], "start.q = [1.6"),
    (["--set", "start.eta.4=0.7"], "start.eta = ["),
    (["--set", "start.q=[0, 0]"], "start.q = [0., 0.]: must be 4 finite numbers"),
    (["--set", "limits.nu1=0.001"], "limits.nu1 = 0.001: must be "),
    (["--set", "limits.u.0=-1"], "limits.u = [-1."),
    (["--set", "tube.e=-1"], "tube.e = -1.0: must be zero or positive"),
    (["--set", "mpc.horizon=0"], "mpc.horizon = 0: must be "),
    (["--set", "ancillary.k=0"], "ancillary.k = 0.0: must be positive"),
    (["--set", "task.force=[-5, 0, 0, 0, 0, 0]"], "task.force = [-5., 0., 0., 0., 0., 0.]: must"),
])
def test_bad_input_is_one_line_and_leaves_nothing(args, expected, capsys, tmp_path):
    assert expected in refusal(capsys, tmp_path, *args)


def test_bad_input_names_the_scenario_file(capsys, tmp_path):
    file = tmp_path / "mine.yaml"
    scenario = load_scenario("girona500_contact", ["disturbance.bound=-0.125"])
    file.write_text(dump_scenario(scenario), encoding="utf-8")
    assert main(["run", str(file), "--output", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err == (
        f"uvms-drake: error: {file}: disturbance.bound = -0.125: must be zero or positive\n")


@pytest.mark.parametrize(("old", "new", "expected"), [
    ("[48.13, 0.25,", "[48.13, 9.25,", "it is not symmetric"),
    ("[48.13, 0.25,", "[-48.13, 0.25,", "its smallest eigenvalue is -"),
    ("fluid_density:", "fluid_densty:", "fluid_densty"),
    ("fluid_density:", "fluid_density: [", "hydrodynamics.yaml"),
])
def test_a_broken_robot_is_refused(old, new, expected, capsys, tmp_path):
    robot = broken_robot(tmp_path, old, new)
    line = refusal(capsys, tmp_path, "--set", f"model={robot}")
    assert expected in line
    assert str(robot / "hydrodynamics.yaml") in line


def test_a_robot_that_is_no_sdformat_is_refused(capsys, tmp_path):
    robot = broken_robot(tmp_path, "", "")
    (robot / "girona500_arm5e.sdf").write_text("<broken", encoding="utf-8")
    line = refusal(capsys, tmp_path, "--set", f"model={robot}")
    assert str(robot / "girona500_arm5e.sdf") in line


def test_a_browser_can_watch(capsys, tmp_path):
    assert main(["run", "--duration", "0.1", "--meshcat", "--output", str(tmp_path), *QUICK]) == 0
    assert "watch at http://localhost:" in capsys.readouterr().err


def test_an_output_that_cannot_be_written_to_is_refused_before_the_run(
        capsys, tmp_path, monkeypatch):
    def simulate(*args, **kwargs):
        pytest.fail("the simulation was started")

    monkeypatch.setattr(simulation, "simulate", simulate)
    (tmp_path / "file").write_text("in the way")
    assert main(["run", "--output", str(tmp_path / "file" / "out")]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert f"--output = '{tmp_path / 'file' / 'out'}': must be a folder that can be" in line


def test_a_run_that_cannot_go_on_has_exit_status_1_and_leaves_nothing(
        capsys, tmp_path, monkeypatch):
    def simulate(*args, **kwargs):
        raise RunFailed("no plan")

    monkeypatch.setattr(simulation, "simulate", simulate)
    assert main(["run", "--output", str(tmp_path / "out")]) == 1
    assert capsys.readouterr().err == "uvms-drake: error: no plan\n"
    assert not (tmp_path / "out").exists()


def test_ctrl_c_ends_with_one_line_and_leaves_nothing(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-m", "uvms_drake", "run", "--duration", "500", "--output",
         str(tmp_path / "out"), *QUICK], stderr=subprocess.PIPE, text=True)
    assert process.stderr.readline().startswith("simulating: 0.0 of 500 s")
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert err.splitlines()[-1] == "uvms-drake: error: interrupted, nothing written"
    assert "Traceback" not in err
    assert not (tmp_path / "out").exists()


def test_the_log_holds_no_nan(smoke):
    with np.load(smoke[0] / "log.npz") as log:
        assert all(np.all(np.isfinite(log[name])) for name in log.files)
