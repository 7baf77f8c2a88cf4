"""Tests of the early end of a command: signals, closed pipes, full disks, foreign files."""

import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from uvms_drake.command.interrupt import postponed, run_interruptible
from uvms_drake.command.main import main
from uvms_drake.common.output import MANIFEST_FILE

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


@pytest.mark.long
def test_a_run_that_violates_a_limit_says_so_last_and_has_a_status_of_its_own(tmp_path, capsys):
    args = [*SHORT, "--no-replay", "--output", str(tmp_path)]
    assert main(args) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "all limits kept, without a certificate"
    assert main([*args, "--set", "current=[3, 0, 0]", "--duration", "1"]) == 3
    assert capsys.readouterr().out.splitlines()[-1].startswith("LIMITS VIOLATED: ")
    assert (tmp_path / "log.npz").is_file()


IDEAL = "run girona500_ideal --uncertified"


@pytest.mark.long
@pytest.mark.parametrize(("number", "line", "seconds"), [
    (signal.SIGINT, "certify girona500_ideal", 0.0),  # Imports.
    (signal.SIGTERM, "certify girona500_ideal", 0.5),
    (signal.SIGINT, "certify girona500_ideal", 4.0),  # Inside of the solver.
    (signal.SIGTERM, f"{IDEAL} --no-figures --duration 3", 3.0),
    (signal.SIGINT, f"{IDEAL} --duration 0.2", 6.0),  # Pictures.
    (signal.SIGTERM, "errata", 5.0),
    (signal.SIGINT, "campaign girona500_ideal --uncertified --runs 3 --set duration=1", 5.0)])
def test_a_signal_ends_a_command_in_one_line_at_any_time_or_comes_too_late(
        number, line, seconds, tmp_path):
    output = tmp_path / "out"
    process = command(*line.split(), "--output", str(output), cwd=tmp_path,
                      env={**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")})
    while process.poll() is None and not catches(process.pid):
        time.sleep(0.01)
    time.sleep(seconds)
    process.send_signal(number)
    err = process.communicate(timeout=600)[1]
    said = [line for line in err.splitlines() if "interrupted" in line]
    assert "Traceback" not in err
    if process.returncode in (0, 1, 3):
        assert not said
    else:
        assert (process.returncode, len(said)) == (128 + number, 1)
        if line.startswith(("certify", "run")) and "nothing written" in err:
            assert not output.exists()
    if output.exists():
        assert not list(output.glob(".run-*"))


@pytest.mark.long
@pytest.mark.parametrize("size", [1, 3_000, 500_000])
def test_a_full_disk_is_one_line_and_leaves_whole_files_and_those_of_others(size, tmp_path):
    """A file cannot grow beyond a size; 500 kB hold the data, and not the replay."""
    def limit():  # It is refused as a full disk is, in the middle of writing it.
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    (tmp_path / "mine.txt").write_text("mine")
    process = command(*SHORT, "--output", str(tmp_path), preexec_fn=limit)
    out, err = process.communicate(timeout=600)
    names = {path.name for path in tmp_path.iterdir()} - {"mine.txt"}
    assert (tmp_path / "mine.txt").read_text() == "mine"
    assert "Traceback" not in err
    assert (process.returncode in (1, 2), out) == (True, "")
    assert names == (DATA if size == 500_000 else set())
    (line,) = (line for line in err.splitlines() if "error: " in line)
    assert ("saved in" in line) == (names == DATA)


@pytest.fixture(autouse=True)
def interrupted():
    """Signals that a process in the background ignores interrupt here too."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_one_signal_waits_for_the_end_of_the_block(number, status, capsys):
    seen = []

    def command():
        with postponed() as asked:
            seen.append(asked())
            signal.raise_signal(number)
            seen.append(asked())
        seen.append("not here")
        return 0

    assert run_interruptible(lambda: command) == status
    assert seen == [False, True]
    assert capsys.readouterr().err == "uvms-drake: error: interrupted, nothing written\n"


def test_a_second_signal_does_not_wait():
    seen = []

    def command():
        with postponed():
            for number in range(3):
                seen.append(number)
                signal.raise_signal(signal.SIGINT)
        return 0

    assert run_interruptible(lambda: command) == 130
    assert seen == [0, 1]


def test_without_a_signal_the_handlers_are_those_of_before():
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    with postponed() as asked:
        assert signal.getsignal(signal.SIGINT) is not before[0]
        assert not asked()
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_what_fails_after_a_signal_says_why():
    with pytest.raises(ValueError, match="why"), postponed():
        signal.raise_signal(signal.SIGINT)
        raise ValueError("why")
