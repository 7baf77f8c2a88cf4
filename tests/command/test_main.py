"""Tests of the command line, as users meet it: files, exit status, one line for an error."""

import json
import os
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


def test_a_short_run_writes_every_file(smoke):
    output, done = smoke
    assert done.returncode == 0, done.stderr
    assert written(output) == DATA | {
        "replay.html", "report.html", *figures_of(load_scenario("girona500_ideal"))}


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


def test_a_folder_that_is_no_run_is_not_drawn(tmp_path, capsys):
    for folder in (tmp_path, tmp_path / "nowhere"):
        assert main(["plot", str(folder)]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert err.startswith(f"uvms-drake: error: DIR = '{folder}': must be a folder that 'run'")
        assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["log.npz", "timing.npz"])
def test_a_damaged_log_is_called_one(name, smoke, tmp_path, capsys):
    folder = tmp_path / "run"
    shutil.copytree(smoke[0], folder)
    for content in (b"", b"garbage" * 99, (folder / name).read_bytes()[:-99]):
        (folder / name).write_bytes(content)
        assert main(["plot", str(folder)]) == 2
        assert capsys.readouterr().err.endswith("(its log.npz or timing.npz is damaged)\n")


def test_a_run_prints_the_summary_and_where_the_files_are(smoke):
    output, done = smoke
    assert "girona500_ideal, seed 3: 0.5 s" in done.stdout
    assert "certified     no (declared tube)" in done.stdout
    assert f"written to {output}: " in done.stdout


def test_progress_is_a_few_lines_on_stderr(smoke):
    first, *lines = smoke[1].stderr.splitlines()
    assert first == "simulating: first plan"
    times = [float(line.split()[1]) for line in lines]
    assert times == sorted(times)
    assert 1 <= len(times) <= LINES


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


def test_the_scenarios_are_listed_with_their_law(capsys):
    assert main(["scenarios"]) == 0
    header, *lines = capsys.readouterr().out.splitlines()
    assert header.split() == ["scenario", "law", "description"]
    assert [line.split()[:2] for line in lines] == [
        ["bluerov2_ceiling", "resolved"],
        ["bluerov2_contact", "resolved"],
        ["bluerov2_cp_probe", "resolved"],
        ["bluerov2_ideal", "resolved"],
        ["bluerov2_real_loop", "tip-first"],
        ["girona500_bilateral", "resolved"],
        ["girona500_contact", "resolved"],
        ["girona500_contact_uncertain", "resolved"],
        ["girona500_floor", "resolved"],
        ["girona500_ideal", "resolved"],
        ["girona500_inspection", "resolved"],
        ["girona500_real_loop", "tip-first"],
        ["girona500_slope", "resolved"],
        ["girona500_stiff", "resolved"],
        ["girona500_tip_first", "tip-first"],
        ["girona500_unknown_floor", "resolved"],
        ["jacket_inspection", "resolved"],
        ["jacket_inspection_real", "tip-first"],
        ["paper_dynamic", "transpose"],
        ["paper_dynamic_resolved", "resolved"],
        ["paper_kinematic", "transpose"],
        ["paper_kinematic_certified", "resolved"]]
    assert all(len(line.split()) > 6 for line in lines)
    starts = {line.index(line.split(maxsplit=2)[2]) for line in (header, *lines)}
    assert len(starts) == 1


def test_the_keys_are_listed_with_default_and_meaning(capsys):
    assert main(["keys", "mpc.time"]) == 0
    assert capsys.readouterr().out == (
        "mpc.time_step = 0.2  # Length h of an interval and sampling period [s]; T = N h.\n")
    assert main(["keys"]) == 0
    lines = capsys.readouterr().out.splitlines()
    keys = {line.split()[0] for line in lines}
    assert {"seed", "limits.u", "surface!BilateralSpring.stiffness", "ancillary!Resolved.k",
            "simulator.max_step_size"} <= keys
    assert main(["keys", "surface.stiff"]) == 0
    plane, spring = capsys.readouterr().out.splitlines()
    assert plane.startswith("surface!UnilateralPlane.stiffness")
    assert spring.startswith("surface!BilateralSpring.stiffness")
    assert main(["keys", "nothing"]) == 2


@pytest.mark.parametrize("args", [
    [], ["fly"], ["run", "--fast"], ["run", "a", "b"], ["run", "--seed"], ["scenarios", "x"],
    ["certify", "--uncertified"], ["certify", "a", "b"], ["certify", "--tune", "0"],
    ["run", "--host", "*"], ["certify", "--within", "1", "2"],
    ["run", "--meshcat", "--host", "192.0.2.1", "--uncertified"],
    ["certify", "--largest", "ancillary"], ["certify", "--largest", "current.0"],
    ["certify", "--largest", "current.0", "--within", "2", "1"],
    ["certify", "--largest", "contact.angle", "--within", "0", "7"]])
def test_arguments_that_make_no_sense_are_one_line(args, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(args) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("uvms-drake: error: ")
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


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


def test_quiet_says_nothing_but_the_result(tmp_path, capsys):
    assert main(["run", "girona500_ideal", "--quiet", "--duration", "0.1", "--output",
                 str(tmp_path), *QUICK]) == 0
    out, err = capsys.readouterr()
    assert "girona500_ideal, seed 0: 0.1 s" in out
    assert err == ""


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


@pytest.mark.parametrize(("args", "expected"), [
    (["girona500_contcat"], "did you mean 'girona500_contact'?"),
    (["--set", "surface.stifness=3"], "surface.stifness = 3: must be under one of the keys point"),
    (["--set", "surface.stiffness=hard"], "surface.stiffness = 'hard': must be a finite number"),
    (["--seed", "x"], "seed = 'x': must be a whole number"),
    (["--seed", "-1"], "seed = -1: must be zero or positive (girona500_ideal.yaml with "
     "--seed=-1 --duration=0.2)"),
    (["--seed", "1e30"], "must be at most 9223372036854775807"),
    (["--seed", "010"], "seed = '010': must be a YAML value"),
    (["--verbose"], "unrecognized arguments: --verbose (see uvms-drake run --help)"),
    (["nowhere/mine.yaml"], "scenario = 'nowhere/mine.yaml': must be a file that exists, or one"),
    (["mine.yml"], "scenario = 'mine.yml': must be a file that exists, or one"),
    (["/"], "scenario = '/': must be a file: this is a folder"),
    (["/dev/null"], "scenario = '/dev/null': must be a file: this is none"),
    (["--set", "task.pose=[0, 0, 0, 0, 1.5, 0]"],
     "task.pose = [0. , 0. , 0. , 0. , 1.5, 0. ]: must be such that vehicle pitch, 1.5,"),
    (["--set", "task.posture=[0, 1.2, 0.7, 0]"], "task.posture = [0. , 1.2, 0.7, 0. ]: must be "
     "such that vehicle pitch"),
    (["--set", f"limits.tau={[9] * 10}"], "limits.tau = [9., 9., 9., 9., 9., 9., 9., 9., 9., 9.]: "
     "must be left out, unless tube.tau has"),
    (["--set", "current=[0, 0]"], "current = [0., 0.]: must be 3 finite numbers"),
    (["--set", "task.force_tolerance=0"], "task.force_tolerance = 0.0: must be positive"),
    (["--set", "task.force=[1]"], "task.force = [1.]: must be 6 finite numbers"),
    (["--duration", "-1"], "duration = -1.0: must be positive"),
    (["--set", "model=girona501"], "model = 'girona501': must be one of bluerov2_alpha5, "),
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
    (["--set", "mpc.horizon=0"], "error: mpc.horizon = 0: must be a positive integer "
     "(girona500_ideal.yaml with --set mpc.horizon=0 --duration=0.2)"),
    (["--set", "surface.dissipation=1e9"], "surface.dissipation = 1000000000.0: must be at most"),
    (["--set", "ancillary.k=0"], "ancillary.k = 0.0: must be positive"),
    (["--set", "ancillary.k=1e9", "--set", "simulator.max_step_size=0.02"],
     "simulator.max_step_size = 0.02: must be at most 1.1e-09 s"),
    (["--set", "ancillary.k=1e9"], "simulator.max_step_size = 1.1"),
    (["--set", "current=[1e6, 0, 0]", "--set", "simulator.max_step_size=0.02"],
     "simulator.max_step_size = 0.02: must be at most "),
    (["--set", "disturbance.frequency=-1"],
     "disturbance.frequency = -1.0: must be zero or positive"),
    (["--set", "mpc.weight_y.0=1e40"], "must be 10 positive numbers, from 1e-06 to 1e+06"),
    (["--set", "task.force_tolerance=25"],
     "task.force_tolerance = 25.0: must be smaller than the desired force itself, 20 N"),
    (["--set", "mpc.horizon=100000"], "mpc.horizon = 100000: must be at most 1265: one plan would "
     "take 2.5e+04 GB of memory"),
    (["--set", "log_period=1e-8"], "log_period = 1e-08: must be at least 2e-07 s, or the duration "
     "shorter: 0.2 s would take about 80 GB of memory"),
    (["--set", "mpc.time_step=1e-9"], "mpc.time_step = 1e-09: must be at least "),
    (["--set", "simulator.max_step_size=1e-9"], "simulator.max_step_size = 1e-09: must be at "
     "least 6.9e-09 s, or the duration shorter: 0.2 s would take about 56 hours"),
    (["--set", f"name={'n' * 300}"], "of at most 100 bytes"),
    (["--set", 'name="a\\0b"'], "name = 'a\\x00b': must be usable as the name of a folder"),
    (["--set", "name="], "name = None: must be text (in quotes, if"),
    (["--set", 'name=""'], "name = '': must be usable as the name of a folder"),
    (["n" * 300], "must be one of bluerov2_ceiling, bluerov2_contact"),
    (["a\0b"], "must be one of bluerov2_ceiling, bluerov2_contact"),
    (["--set", "task.force=[-5, 0, 0, 0, 0, 0]"], "task.force = [-5., 0., 0., 0., 0., 0.]: must"),
])
def test_bad_input_is_one_line_and_leaves_nothing(args, expected, capsys, tmp_path):
    line = refusal(capsys, tmp_path, *args)
    assert expected in line
    assert len(line) < 800


@pytest.mark.parametrize("kernel", ["Haswell", "SkylakeX"])
def test_whether_a_stiff_loop_is_taken_does_not_hang_on_rounding(kernel, tmp_path):
    """Held for a step of 0.2 s, its drift would grow 309-fold; the loop itself decays."""
    done = subprocess.run(
        [sys.executable, "-m", "uvms_drake", "run", "girona500_ideal", *QUICK,
         "--set", "surface.dissipation=900", "--output", str(tmp_path / "out")],
        env={**os.environ, "OPENBLAS_CORETYPE": kernel},
        capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_bad_input_names_the_scenario_file(capsys, tmp_path):
    file = tmp_path / "mine.yaml"
    scenario = load_scenario("girona500_ideal", ["disturbance.bound=-0.125"])
    file.write_text(dump_scenario(scenario), encoding="utf-8")
    assert main(["run", str(file), "--output", str(tmp_path / "out"), "--uncertified"]) == 2
    assert capsys.readouterr().err == (
        "uvms-drake: error: disturbance.bound = -0.125: must be zero or positive (mine.yaml)\n")


@pytest.mark.parametrize(("old", "new", "expected"), [
    ("[48.13, 0.25,", "[48.13, 9.25,", "must be symmetric"),
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
    assert main(["run", "girona500_ideal", "--duration", "0.1", "--meshcat", "--no-wait",
                 "--output",
                 str(tmp_path), *QUICK]) == 0
    assert "watch at http://localhost:" in capsys.readouterr().err


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


def test_the_log_holds_no_nan(smoke):
    with np.load(smoke[0] / "log.npz") as log:
        assert not any(np.any(np.isnan(log[name])) for name in log.files)


# Measurements ------------------------------------------------------------------------------------
