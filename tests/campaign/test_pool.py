"""Tests of `uvms_drake.campaign.pool`: no worker, order or accident changes a campaign."""

import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from pathlib import Path

import pytest
from support.campaigns import RUNS, SHORT, indices_in, refusal, result_bytes
from support.workers import process_id

from uvms_drake.campaign.pool import ONE_THREAD, RUNS_PER_WORKER, Pool, local_pool, run_all
from uvms_drake.campaign.store import RUNS_FILE
from uvms_drake.command.main import main
from uvms_drake.common.errors import RunFailed

pytestmark = pytest.mark.long


def start(folder: Path, runs: int) -> subprocess.Popen:
    """Starts a campaign with two workers and returns it when the first run is done."""
    process = subprocess.Popen(
        [sys.executable, "-m", "uvms_drake", *SHORT, "--runs", str(runs), "--workers", "2",
         "--output", str(folder)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    wait_for(lambda: (folder / RUNS_FILE).is_file() and (folder / RUNS_FILE).stat().st_size > 0)
    return process


def wait_for(condition, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def workers_of(process: subprocess.Popen) -> list[int]:
    """Returns the process ids of a campaign's workers, by Linux."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return [int(child) for child in children
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


linux = pytest.mark.skipif(sys.platform != "linux", reason="looks for the workers in /proc")


def test_the_workers_take_one_core_each_and_the_parent_is_left_as_it_was(monkeypatch):
    monkeypatch.setenv(ONE_THREAD[0], "7")
    with local_pool(1).open() as executor:
        assert executor.submit(os.getenv, ONE_THREAD[0]).result() == "1"
    assert os.environ[ONE_THREAD[0]] == "7"


def test_a_worker_is_replaced_before_it_keeps_too_much_memory(monkeypatch):
    monkeypatch.setattr("uvms_drake.campaign.pool.RUNS_PER_WORKER", 2)
    runs = dict(run_all(process_id, range(3), local_pool(1)))
    assert list(runs) == list(range(3))
    first, second, third = (runs[index]["process"] for index in range(3))
    assert first == second != third
    assert RUNS_PER_WORKER * 8 < 300  # MB: a run leaves 8 MB behind.


@linux
def test_killed_half_way_it_goes_on_and_leaves_no_worker(reference, tmp_path):
    process = start(tmp_path, RUNS)
    workers = workers_of(process)
    assert workers
    process.kill()
    process.communicate()
    wait_for(lambda: not any(Path(f"/proc/{worker}").exists() for worker in workers))
    assert main([*SHORT, "--runs", str(RUNS), "--workers", "2", "--output", str(tmp_path)]) == 0
    assert result_bytes(tmp_path) == result_bytes(reference)
    assert sorted(indices_in(tmp_path)) == list(range(RUNS))


@linux
def test_a_killed_worker_is_replaced_and_two_give_the_bytes_of_one(reference, tmp_path):
    process = start(tmp_path, RUNS)
    os.kill(workers_of(process)[0], signal.SIGKILL)
    _, errors = process.communicate(timeout=90)
    assert process.returncode == 0, errors
    assert result_bytes(tmp_path) == result_bytes(reference)
    assert sorted(indices_in(tmp_path)) == list(range(RUNS))


@linux
def test_an_interrupt_is_one_line_and_keeps_what_is_done(tmp_path):
    process = start(tmp_path, 50)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in errors
    assert "goes on with the others" in errors.splitlines()[-1]
    assert not (tmp_path / "campaign.json").exists()
    assert indices_in(tmp_path)


def test_workers_that_always_die_are_given_up():
    class Dying(Executor):
        def submit(self, fn, /, *args, **kwargs):
            future: Future = Future()
            future.set_exception(OSError("gone"))
            return future

    @contextmanager
    def pool():
        yield Dying()

    with pytest.raises(RunFailed, match=r"die before any run comes back \(of 2 runs: 0, 1\): gone"):
        list(run_all(process_id, [0, 1], Pool(pool)))


@pytest.mark.parametrize("runs", [None, 2])
def test_a_run_that_takes_its_worker_with_it_comes_last_and_is_named(runs):
    """The others are done, although it is the first."""
    class Poisoned(Executor):
        def __init__(self):
            self.dead = False

        def submit(self, fn, /, *args, **kwargs):
            future: Future = Future()
            self.dead = self.dead or args[0] == 0
            if self.dead:
                future.set_exception(OSError("gone"))
            else:
                future.set_result(args[0])
            return future

    @contextmanager
    def pool():
        yield Poisoned()

    runs = run_all(process_id, range(5), Pool(pool, runs))
    assert {next(runs)[0] for _ in range(4)} == {1, 2, 3, 4}
    with pytest.raises(RunFailed, match=r"of 1 runs: 0\)"):
        next(runs)


def test_a_cluster_gives_the_same_bytes(reference, tmp_path):
    """A scheduler and two workers, each a process of its own."""
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True,
                                  dashboard_address=None) as cluster:
        assert main([*SHORT, "--runs", str(RUNS), "--scheduler", cluster.scheduler_address,
                     "--output", str(tmp_path)]) == 0
    assert result_bytes(tmp_path) == result_bytes(reference)


def test_a_killed_worker_of_a_cluster_is_replaced(reference, tmp_path):
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True,
                                  dashboard_address=None) as cluster:
        process = subprocess.Popen(
            [sys.executable, "-m", "uvms_drake", *SHORT, "--runs", str(RUNS), "--scheduler",
             cluster.scheduler_address, "--output", str(tmp_path)], stdout=subprocess.DEVNULL)
        wait_for(lambda: (tmp_path / RUNS_FILE).is_file())
        os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
        assert process.wait(90) == 0
    assert result_bytes(tmp_path) == result_bytes(reference)
    assert sorted(indices_in(tmp_path)) == list(range(RUNS))


def test_without_a_cluster_it_is_one_line(capsys, tmp_path, monkeypatch):
    output = tmp_path / "result"
    if "distributed" in sys.modules:
        monkeypatch.setattr("uvms_drake.campaign.pool.CONNECT_SECONDS", 0.5)
    err = refusal(capsys, "--scheduler", "tcp://127.0.0.1:1", "--output", str(output))
    assert "--scheduler" in err
    assert not output.exists()
