"""Tests of the early end of a command: signals, closed pipes, full disks, foreign files."""

import os
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from uvms_drake.command.main import main
from uvms_drake.common.output import MANIFEST_FILE

pytestmark = pytest.mark.long

SHORT = ["run", "girona500_ideal", "--uncertified", "--no-figures", "--duration", "0.1"]
DATA = {"scenario.yaml", "summary.json", "log.csv", "log.npz", "timing.npz", MANIFEST_FILE}


def command(*args, **options):
    return subprocess.Popen([sys.executable, "-m", "uvms_drake", *args], text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options)


def catches(pid):
    """Returns whether a process has its handlers; Python itself has none of SIGTERM."""
    status = Path(f"/proc/{pid}/status").read_text()
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt:"))
    return bool(int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1)


@pytest.mark.parametrize(("number", "status", "seconds"), [
    (signal.SIGINT, 130, 0.0), (signal.SIGTERM, 143, 0.5), (signal.SIGINT, 130, 4.0)])
def test_a_signal_ends_certify_with_one_line_at_any_time(number, status, seconds, tmp_path):
    """An interrupt during imports, the search of constants, or inside of SNOPT."""
    process = command("certify", "girona500_ideal", "--output", str(tmp_path / "out"),
                      env={**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")})
    while not catches(process.pid):
        time.sleep(0.01)
    time.sleep(seconds)
    process.send_signal(number)
    out, err = process.communicate(timeout=600)
    assert (process.returncode, out) == (status, "")
    *announced, last = err.splitlines()
    assert last == "uvms-drake: error: interrupted, nothing written"
    assert [line for line in announced if not line.startswith("certifying (")] == []
    assert not (tmp_path / "out").exists()


def test_a_closed_pipe_is_no_error_to_talk_about():
    process = command("scenarios")
    process.stdout.close()
    assert process.stderr.read() == ""
    assert process.wait() == 141


def test_a_terminal_without_greek_letters_gets_escapes():
    done = subprocess.run(
        [sys.executable, "-c", "from uvms_drake.command.interrupt import run_interruptible\n"
         "run_interruptible(lambda: lambda: print('σ'))"], capture_output=True, text=True,
        check=False, env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert (done.stdout, done.stderr) == ("\\u03c3\n", "")


def test_an_interrupt_inside_of_code_that_c_runs_has_the_same_status(tmp_path):
    (tmp_path / "evaluates.py").write_text(
        "import os, signal, sys, time\n"
        "from uvms_drake.command.interrupt import run_interruptible\n"
        "def wait():\n"
        "    os.kill(os.getpid(), signal.SIGINT)\n"
        "    time.sleep(60.0)\n"
        "sys.exit(run_interruptible(lambda: lambda: eval('wait()')))\n")
    done = subprocess.run(
        [sys.executable, "-m", "evaluates"], capture_output=True, text=True, check=False,
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))})
    assert done.stderr == "uvms-drake: error: interrupted, nothing written\n"
    assert done.returncode == 130


def test_data_are_kept_if_a_picture_does_not_fit_on_the_disk(tmp_path):
    def limit():  # Of a file, which is refused as a full disk is, in the middle of writing it.
        resource.setrlimit(resource.RLIMIT_FSIZE, (500_000, 500_000))

    process = command(*SHORT, "--output", str(tmp_path), preexec_fn=limit)
    out, err = process.communicate()
    assert (process.returncode, out) == (1, "")
    assert err.splitlines()[-1] == (
        "uvms-drake: error: the files cannot be written: File too large; "
        f"saved in {tmp_path}: log.csv, log.npz, scenario.yaml, summary.json, timing.npz")
    assert {path.name for path in tmp_path.iterdir()} == DATA


@pytest.mark.parametrize("name", ["force.png", "scenario.yaml", "report.html"])
def test_what_a_user_has_in_the_folder_is_left_alone(name, tmp_path, capsys):
    own = tmp_path / name
    own.mkdir() if name == "force.png" else own.write_text("mine")
    assert main([*SHORT, "--no-replay", "--output", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.endswith(f"without files of others: {name} in it would be replaced, and is not "
                        "as this program has written there\n")
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [own]
    assert own.is_dir() or own.read_text() == "mine"


@pytest.mark.parametrize("output", ["", "n" * 300, "a\0b"])
def test_an_output_that_is_no_folder_is_refused(output, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("run", "certify", "campaign", "errata"):
        assert main([name, "--output", output]) == 2
        err = capsys.readouterr().err
        assert "must be the name of a folder" in err
        assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_violates_a_limit_says_so_last_and_has_a_status_of_its_own(tmp_path, capsys):
    args = [*SHORT, "--no-replay", "--output", str(tmp_path)]
    assert main(args) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "all limits kept, without a certificate"
    assert main([*args, "--set", "current=[3, 0, 0]", "--duration", "1"]) == 3
    assert capsys.readouterr().out.splitlines()[-1].startswith("LIMITS VIOLATED: ")
    assert (tmp_path / "log.npz").is_file()


TRIES = int(os.environ.get("UVMS_DRAKE_INTERRUPTIONS", "3"))
FULL_DISKS = int(os.environ.get("UVMS_DRAKE_FULL_DISKS", "2"))
COMMANDS = {
    "run": ["run", "girona500_ideal", "--duration", "1"],
    "run without": [*SHORT, "--duration", "3"],
    "pictures": ["run", "girona500_ideal", "--uncertified", "--duration", "0.2"],
    "certify": ["certify", "girona500_ideal"], "errata": ["errata"],
    "campaign": ["campaign", "girona500_ideal", "--uncertified", "--runs", "3",
                 "--set", "duration=1"]}


@pytest.mark.parametrize("number", range(TRIES))
def test_a_signal_ends_any_command_in_one_line(number, tmp_path):
    """Or comes too late."""
    draw = random.Random(number)
    name = draw.choice(sorted(COMMANDS))
    signal_number = draw.choice((signal.SIGINT, signal.SIGTERM))
    output = tmp_path / "out"
    process = command(*COMMANDS[name], "--output", str(output), cwd=tmp_path,
                      env={**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")})
    while process.poll() is None and not catches(process.pid):
        time.sleep(0.01)
    time.sleep(draw.uniform(0.0, 12.0))
    process.send_signal(signal_number)
    err = process.communicate(timeout=600)[1]
    said = [line for line in err.splitlines() if "interrupted" in line]
    assert "Traceback" not in err, (name, err)
    if process.returncode in (0, 1, 3):
        assert not said, (name, err)
    else:
        assert process.returncode == 128 + signal_number, (name, err)
        assert len(said) == 1, (name, err)
        if "nothing written" in err and name != "campaign":
            assert not output.exists(), (name, err)
    if output.exists():
        assert not [item.name for item in output.iterdir() if item.name.startswith(".run-")]


@pytest.mark.parametrize("number", range(FULL_DISKS))
def test_a_full_disk_is_one_line_and_leaves_whole_files_and_those_of_others(number, tmp_path):
    """A file cannot grow beyond a random size."""
    size = int(10.0 ** random.Random(number).uniform(0.0, 6.5))

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    (tmp_path / "mine.txt").write_text("mine")
    process = command("run", "girona500_ideal", "--uncertified", "--duration", "0.1", "--output",
                      str(tmp_path),
                      preexec_fn=limit)
    err = process.communicate(timeout=600)[1]
    names = {path.name for path in tmp_path.iterdir()} - {"mine.txt"}
    assert "Traceback" not in err
    assert (tmp_path / "mine.txt").read_text() == "mine"
    assert names in (set(), DATA) or process.returncode == 0
    assert process.returncode in (0, 1, 2)
    if process.returncode:
        (line,) = (line for line in err.splitlines() if "error: " in line)
        assert ("saved in" in line) == (names == DATA)
