"""Tests of the command line, as users meet it: files, exit status, one line for an error."""

import json
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.yaml import yaml_load_data
from support.outputs import DATA, DATA_ONLY, broken_robot, written
from support.snapshot import check_snapshot
from support.sockets import LOCAL, listening_addresses

from uvms_drake.command.files import MAIN_SCENARIO
from uvms_drake.command.main import main
from uvms_drake.command.progress import LINES
from uvms_drake.common.errors import RunFailed
from uvms_drake.report.figures import figures_of
from uvms_drake.report.summary import summarise
from uvms_drake.station import simulation
from uvms_drake.station.record import load_record
from uvms_drake.station.scenario.scenario import dump_scenario, load_scenario
from uvms_drake.station.scenario.scenario_file import shipped_scenarios
from uvms_drake.station.step_size import with_step

pytestmark = pytest.mark.slow

QUICK = [*DATA_ONLY, "--uncertified"]


def refusal(capsys, tmp_path, *args):
    """Runs with bad input and returns the only line on stderr; nothing may have been written."""
    output = tmp_path / "result"
    named = bool(args) and not args[0].startswith("--")
    status = main(["run", *([] if named else ["girona500_ideal"]), "--duration", "0.2",
                   "--output", str(output), *QUICK, *args])
    out, err = capsys.readouterr()
    assert (status, out) == (2, "")
    assert err.startswith("uvms-drake: error: ")
    assert err.count("\n") == 1
    assert not output.exists()
    return err


@pytest.fixture(scope="module")
def smoke(tmp_path_factory):
    """Runs half a second of a scenario as users do, with all outputs."""
    output = tmp_path_factory.mktemp("smoke") / "out"
    done = subprocess.run(
        [sys.executable, "-m", "uvms_drake", "run", "girona500_ideal", "--duration", "0.5",
         "--seed", "3", "--output", str(output), "--uncertified"],
        capture_output=True, text=True, check=False)
    return output, done


@pytest.mark.long
def test_a_finished_run_is_drawn_again_from_its_data(smoke, tmp_path, capsys):
    folder = tmp_path / "run"
    shutil.copytree(smoke[0], folder)
    pictures = {path for path in folder.iterdir() if path.suffix in (".png", ".html")}
    for path in pictures:
        path.unlink()
    assert main(["plot", str(folder), "--replay"]) == 0
    assert {path for path in folder.iterdir() if path.suffix in (".png", ".html")} == pictures
    assert (folder / "report.html").read_text() == (smoke[0] / "report.html").read_text()
    assert "report.html" in capsys.readouterr().out


def test_a_short_run_writes_every_file_and_says_it(smoke):
    output, done = smoke
    assert done.returncode == 0, done.stderr
    assert written(output) == DATA | {
        "replay.html", "report.html", *figures_of(load_scenario("girona500_ideal"))}
    check_snapshot("run", f"{done.stdout}\n--- stderr\n{done.stderr.splitlines()[0]}", output)
    _, *lines = done.stderr.splitlines()
    times = [float(line.split()[1]) for line in lines]
    assert times == sorted(times)
    assert 1 <= len(times) <= LINES
    with np.load(output / "log.npz") as log:
        assert not any(np.any(np.isnan(log[name])) for name in log.files)


def test_the_written_files_belong_together(smoke):
    output, _ = smoke
    record = load_record(output)
    summary = json.loads((output / "summary.json").read_text(encoding="utf-8"))
    assert summarise(record) == summary
    assert (summary["seed"], summary["duration_s"]) == (3, 0.5)
    expected = with_step(load_scenario("girona500_ideal", ["seed=3", "duration=0.5"]))
    assert (output / "scenario.yaml").read_text(encoding="utf-8") == dump_scenario(expected)


def test_the_written_scenario_runs_again_to_the_same_log(smoke, tmp_path, capsys):
    output, _ = smoke
    again = tmp_path / "again"
    assert main(["run", str(output / "scenario.yaml"), "--output", str(again), *QUICK]) == 0
    capsys.readouterr()
    assert written(again) == DATA
    assert (again / "log.npz").read_bytes() == (output / "log.npz").read_bytes()


def test_the_output_defaults_to_a_folder_named_after_the_scenario(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["run", "girona500_bilateral", "--duration", "0.1", *QUICK]) == 0
    assert "written to out/girona500_bilateral" in capsys.readouterr().out
    assert (tmp_path / "out" / "girona500_bilateral" / "log.npz").is_file()


def test_the_help_of_run_names_the_scenarios_and_keys_that_there_are(capsys):
    with pytest.raises(SystemExit):
        main(["run", "--help"])
    said = capsys.readouterr().out
    assert all(name in said for name in shipped_scenarios())
    keys = re.search(r"changed most.*?:\n(.*?)\n\n", said, re.DOTALL)[1].replace(",", " ").split()
    assert len(keys) > 10
    # D8: each is a key of the default scenario, which takes it with the value that it has.
    scenario = yaml_load_data(dump_scenario(load_scenario(MAIN_SCENARIO)))
    for key in keys:
        value = scenario
        for part in key.split("."):
            value = value[part]
        load_scenario(MAIN_SCENARIO, [f"{key}={json.dumps(value)}"])


@pytest.mark.parametrize(("command", "where"), [
    ("run", "uvms_drake.station.simulation.simulate"),
    ("certify", "uvms_drake.certificate.certify.certified_once"),
    ("campaign", "uvms_drake.command.drawn_runs.certified_once")])
def test_what_has_no_effect_is_said_before_anything_takes_long(
        command, where, tmp_path, capsys, monkeypatch):
    def begin(*args, **kwargs):
        raise RunFailed("begun")

    monkeypatch.setattr(where, begin)
    args = [*(["--uncertified"] if command == "run" else []), "--output", str(tmp_path / "out")]
    assert main([command, "girona500_ideal", "--set", "simulator.max_step_size=0.05",
                 *args]) == 1
    first, last = capsys.readouterr().err.splitlines()
    assert first == "note: simulator.max_step_size = 0.05 s is cut to 0.02 s by the log or the MPC"
    assert last.startswith("uvms-drake: error: begun")


@pytest.mark.skipif(not Path("/proc/self/net/tcp").exists(), reason="needs Linux's /proc")
def test_a_run_in_a_browser_listens_on_this_machine_alone(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-m", "uvms_drake", "run", "girona500_ideal", "--duration", "30",
         "--meshcat", "--output", str(tmp_path), *QUICK], stderr=subprocess.PIPE, text=True)
    try:
        while "watch at" not in process.stderr.readline():  # It waits for a browser from then on.
            assert process.poll() is None
        found = listening_addresses(process.pid)
    finally:
        process.kill()
        process.wait()
    assert found
    assert set(found) <= LOCAL


def test_an_output_that_cannot_be_written_to_is_refused_before_the_run(
        capsys, tmp_path, monkeypatch):
    def simulate(*args, **kwargs):
        pytest.fail("the simulation was started")

    monkeypatch.setattr(simulation, "simulate", simulate)
    (tmp_path / "file").write_text("in the way")
    assert main(["run", "girona500_ideal", "--output", str(tmp_path / "file" / "out")]) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert f"--output = '{tmp_path / 'file' / 'out'}': must be a folder that can be" in line


def test_a_run_that_cannot_go_on_has_exit_status_1_and_leaves_nothing(
        capsys, tmp_path, monkeypatch):
    def simulate(*args, **kwargs):
        raise RunFailed("no plan")

    monkeypatch.setattr(simulation, "simulate", simulate)
    assert main(["run", "girona500_ideal", "--output", str(tmp_path / "out"), "--uncertified"]) == 1
    assert capsys.readouterr().err == "uvms-drake: error: no plan (girona500_ideal.yaml)\n"
    assert not (tmp_path / "out").exists()


def test_ctrl_c_ends_a_run_with_one_line_and_keeps_what_was_done(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-m", "uvms_drake", "run", "girona500_ideal", "--duration", "500",
         "--output",
         str(tmp_path / "out"), *QUICK], stderr=subprocess.PIPE, text=True)
    assert process.stderr.readline() == "simulating: first plan\n"
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=600)
    assert process.returncode == 130
    assert err.splitlines()[-1].startswith(
        f"uvms-drake: error: interrupted, saved in {tmp_path / 'out'}: log.csv, log.npz, ")
    assert "Traceback" not in err
    assert written(tmp_path / "out") == DATA
    record = load_record(tmp_path / "out")
    assert 0.0 < record.time[-1] <= record.scenario.duration < 500.0


# Measurements ------------------------------------------------------------------------------------


def test_scenarios_and_keys_are_listed(capsys):
    assert main(["scenarios"]) == 0
    header, *lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(shipped_scenarios())
    assert len({line.index(line.split(maxsplit=2)[2]) for line in (header, *lines)}) == 1
    assert main(["keys", "mpc.time"]) == 0
    assert capsys.readouterr().out == (
        "mpc.time_step = 0.2  # Length h of an interval and sampling period [s]; T = N h.\n")
    assert main(["keys"]) == 0
    keys = {line.split()[0] for line in capsys.readouterr().out.splitlines()}
    assert {"seed", "limits.u", "surface!BilateralSpring.stiffness", "ancillary!Resolved.k"} <= keys
    assert main(["keys", "surface.stiff"]) == 0  # A prefix may leave tags out.
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == sorted(
        (key for key in keys if re.fullmatch(r"surface!\w+\.stiffness", key)), reverse=True)
    assert main(["keys", "--signals"]) == 0
    assert "force" in capsys.readouterr().out
    assert main(["keys", "nothing"]) == 2


@pytest.mark.parametrize("args", [
    [], ["fly"], ["run", "--fast"], ["run", "a", "b"], ["run", "--seed"], ["scenarios", "x"],
    ["certify", "--uncertified"], ["certify", "a", "b"], ["run", "--host", "*"],
    ["run", "--meshcat", "--host", "192.0.2.1", "--uncertified"],
    ["certify", "girona500_tip_first", "--paper"], ["plot", "nowhere"], ["plot", "."],
    ["run", "nowhere/mine.yaml"], ["run", "mine.yml"], ["run", "/"], ["run", "/dev/null"],
    ["run", "girona500_contcat"], ["run", "n" * 300], ["run", "a\0b"]])
def test_arguments_that_make_no_sense_are_one_line(args, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(args) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("uvms-drake: error: ")
    assert err.count("\n") == 1
    assert len(err) < 800
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("args", "expected"), [
    (["girona500_contcat"], "did you mean 'girona500_contact'?"),
    (["mine.yml"], "scenario = 'mine.yml': must be a file that exists, or one"),
    (["/"], "scenario = '/': must be a file: this is a folder"),
    (["--verbose"], "unrecognized arguments: --verbose (see uvms-drake run --help)"),
    (["--seed", "x"], "seed = 'x': must be a whole number"),
    (["--seed", "-1"], "(girona500_ideal.yaml with --set duration=0.2 --set seed=-1)"),
    (["--duration", "-1"], "duration = -1.0: must be positive"),
    (["--set", "surface.stifness=3"], "surface.stifness = 3: must be under one of the keys point"),
    (["--set", "task.pose=[0, 0, 0, 0, 1.5, 0]"], "must be such that vehicle pitch, 1.5,"),
    (["--set", f"limits.tau={[9] * 10}"], "must be left out, unless tube.tau has"),
    (["--set", "model=girona501"], "model = 'girona501': must be one of bluerov2_alpha5, "),
    (["girona500_bilateral", "--set", "surface.stiffness.0.1=99"], "it is not symmetric"),
    (["girona500_bilateral", "--set", "surface.stiffness.0.0=-9"], "its smallest eigenvalue is -"),
    (["--set", "start.q.0=1.6"], "start.q = [1.6"),
    (["--set", "limits.nu1=0.001"], "limits.nu1 = 0.001: must be "),
    (["--set", "ancillary.k=1e9", "--set", "simulator.max_step_size=0.02"],
     "simulator.max_step_size = 0.02: must be at most 1.1e-09 s"),
    (["--set", "ancillary.k=1e9"], "simulator.max_step_size = 1.1"),
    (["--set", "current=[1e6, 0, 0]", "--set", "simulator.max_step_size=0.02"],
     "simulator.max_step_size = 0.02: must be at most "),
    (["--set", "task.force_tolerance=25"], "must be smaller than the desired force itself, 20 N"),
    (["--set", "mpc.horizon=100000"], "one plan would take 2.5e+04 GB of memory"),
    (["--set", "log_period=1e-8"], "0.2 s would take about 80 GB of memory"),
    (["--set", "simulator.max_step_size=1e-9"], "0.2 s would take about 56 hours"),
    (["--set", 'name="a\\0b"'], "name = 'a\\x00b': must be usable as the name of a folder"),
    (["--set", "task.force=[-5, 0, 0, 0, 0, 0]"], "task.force = [-5., 0., 0., 0., 0., 0.]: must"),
])
def test_bad_input_is_one_line_and_leaves_nothing(args, expected, capsys, tmp_path):
    assert expected in refusal(capsys, tmp_path, *args)


@pytest.mark.parametrize(("old", "new", "expected"), [
    ("[48.13, 0.25,", "[48.13, 9.25,", "must be symmetric"),
    ("fluid_density:", "fluid_density: [", "hydrodynamics.yaml")])
def test_a_broken_robot_is_refused(old, new, expected, capsys, tmp_path):
    robot = broken_robot(tmp_path, old, new)
    line = refusal(capsys, tmp_path, "--set", f"model={robot}")
    assert expected in line
    assert str(robot / "hydrodynamics.yaml") in line
