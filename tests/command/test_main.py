"""Tests of the command line, as users meet it: files, exit status, one line for an error."""

import json
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pydrake.common.yaml import yaml_load_data
from support.outputs import DATA, DATA_ONLY, written
from support.snapshot import check_snapshot
from support.sockets import LOCAL, listening_addresses

import uvms_drake as uv
from uvms_drake.command.files import MAIN_SCENARIO
from uvms_drake.command.main import main
from uvms_drake.command.progress import LINES
from uvms_drake.report.figures import figures_of
from uvms_drake.station.scenario.scenario import dump_scenario
from uvms_drake.station.scenario.scenario_file import shipped_scenarios

pytestmark = pytest.mark.slow

QUICK = [*DATA_ONLY, "--uncertified"]


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
        "replay.html", "report.html", *figures_of(uv.load_scenario("girona500_ideal"))}
    check_snapshot("run", f"{done.stdout}\n--- stderr\n{done.stderr.splitlines()[0]}", output)
    _, *lines = done.stderr.splitlines()
    times = [float(line.split()[1]) for line in lines]
    assert times == sorted(times)
    assert 1 <= len(times) <= LINES
    with np.load(output / "log.npz") as log:
        assert not any(np.any(np.isnan(log[name])) for name in log.files)


def test_the_written_files_belong_together(smoke):
    output, _ = smoke
    record = uv.load_record(output)
    summary = json.loads((output / "summary.json").read_text(encoding="utf-8"))
    assert uv.summarise(record) == summary
    assert (summary["seed"], summary["duration_s"]) == (3, 0.5)
    expected = uv.with_step(uv.load_scenario("girona500_ideal", ["seed=3", "duration=0.5"]))
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
    scenario = yaml_load_data(dump_scenario(uv.load_scenario(MAIN_SCENARIO)))
    for key in keys:
        value = scenario
        for part in key.split("."):
            value = value[part]
        uv.load_scenario(MAIN_SCENARIO, [f"{key}={json.dumps(value)}"])


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


def test_ctrl_c_ends_a_run_with_one_line_and_keeps_what_was_done(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-m", "uvms_drake", "run", "girona500_ideal", "--duration", "20",
         "--output", str(tmp_path / "out"), *QUICK], stderr=subprocess.PIPE, text=True)
    assert process.stderr.readline() == "simulating: first plan\n"
    assert process.stderr.readline().startswith("simulating: ")  # A fifth of it.
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=600)
    assert process.returncode == 130
    assert err.splitlines()[-1].startswith(
        f"uvms-drake: error: interrupted, saved in {tmp_path / 'out'}: log.csv, log.npz, ")
    assert "Traceback" not in err
    assert written(tmp_path / "out") == DATA
    record = uv.load_record(tmp_path / "out")
    assert 3.9 < record.time[-1] <= record.scenario.duration < 20.0


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
