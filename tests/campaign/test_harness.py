"""Tests of `campaign.harness` and its workers: no worker, order or accident changes a result."""

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path

import pytest
from support.workers import process_of, square

import uvms_drake as uv
from uvms_drake.campaign.harness import RUNS_FILE, runs, stored
from uvms_drake.campaign.pool import (
    ONE_THREAD,
    RUNS_PER_WORKER,
    Pool,
    local_pool,
    make_pool,
    run_all,
)

TESTS = Path(__file__).parents[1]
SQUARES = [{"square": cell**2} for cell in range(8)]
linux = pytest.mark.skipif(sys.platform != "linux", reason="looks for the workers in /proc")


class Here(Executor):
    """Computes at once, and keeps the cells."""

    def __init__(self):
        self.cells = []

    def submit(self, fn, /, *args, **kwargs):
        self.cells.append(args[0])
        future: Future = Future()
        try:
            future.set_result(fn(*args))
        except OSError as error:
            future.set_exception(error)
        return future


def pool_of(executor: Executor, number: int | None = None) -> Pool:
    @contextmanager
    def pool():
        yield executor

    return Pool(pool, number)


def wait_for(condition, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def start(folder: Path, pool: str = "local_pool(2)") -> subprocess.Popen:
    """Starts eight runs in a process of its own, and returns it when the first one is done."""
    process = subprocess.Popen([sys.executable, "-c", "\n".join((
        "from pathlib import Path", "from support.workers import square",
        "from uvms_drake.campaign.harness import runs",
        "from uvms_drake.campaign.pool import cluster_pool, local_pool",
        f"runs(range(8), square, Path({str(folder)!r}), {pool})"))],
        env=os.environ | {"PYTHONPATH": str(TESTS)})
    wait_for(lambda: stored(folder))
    return process


def workers_of(process: subprocess.Popen) -> list[int]:
    """Returns the process ids of the workers, by Linux."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return [int(child) for child in children
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


def test_only_missing_runs_are_computed_also_after_a_line_is_cut_or_damaged(tmp_path):
    here = Here()
    assert runs(range(4), square, tmp_path, pool_of(here)) == SQUARES[:4]
    file = tmp_path / RUNS_FILE
    first, second, *rest = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b'{"cell": {}, "result": 7}\n' + second + b"".join(rest)
                     + first[: len(first) // 2])
    said = []
    assert runs(range(5), square, tmp_path, pool_of(here),
                progress=lambda text, done: said.append(text)) == SQUARES[:5]
    assert here.cells == [0, 1, 2, 3, json.loads(first)["cell"], 4]
    assert said[0] == "3 of 5 runs are there already"
    assert stored(tmp_path) == dict(enumerate(SQUARES[:5]))


def test_cells_may_be_tuples_and_a_result_may_be_repeated(tmp_path):
    here, cells = Here(), [("a", 0), ("b", 0)]

    def run(cell):
        return {"error": "bad" if cell[0] == "b" and len(here.cells) < 4 else None}

    for error in ("bad", "bad", None):
        results = runs(cells, run, tmp_path, pool_of(here),
                       again=lambda result: result["error"] is not None)
        assert [result["error"] for result in results] == [None, error]
    assert here.cells == [("a", 0), *[("b", 0)] * 3]


def test_a_folder_in_use_or_that_cannot_be_written_to_is_refused(tmp_path):
    def again(text, done):
        with pytest.raises(uv.InvalidParameter, match="no other process"):
            runs([1], square, tmp_path, pool_of(Here()))

    assert runs([0], square, tmp_path, pool_of(Here()), progress=again)
    (tmp_path / "file").touch()
    with pytest.raises(uv.InvalidParameter, match="can be written to"):
        runs([0], square, tmp_path / "file", pool_of(Here()))


def test_an_interrupt_keeps_and_tells_what_is_done(tmp_path):
    def interrupt(text, done):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as interrupted:
        runs(range(3), square, tmp_path, pool_of(Here()), progress=interrupt)
    assert interrupted.value.__notes__ == [
        f"1 runs are in {tmp_path}; the same command goes on with the others"]
    assert len(stored(tmp_path)) == 1


def test_workers_take_a_core_each_and_are_replaced_before_they_keep_too_much(monkeypatch):
    monkeypatch.setenv(ONE_THREAD[0], "7")
    with local_pool(1).open() as executor:
        assert executor.submit(os.getenv, ONE_THREAD[0]).result() == "1"
    assert os.environ[ONE_THREAD[0]] == "7"
    monkeypatch.setattr("uvms_drake.campaign.pool.RUNS_PER_WORKER", 2)
    found = dict(run_all(process_of, range(3), local_pool(1)))
    assert list(found) == list(range(3))
    first, second, third = (found[index]["process"] for index in range(3))
    assert first == second != third
    assert RUNS_PER_WORKER * 8 < 300  # MB: a run leaves 8 MB behind.


def test_runs_that_nobody_takes_are_not_computed_to_their_end():
    with pytest.raises(KeyboardInterrupt), local_pool(1).open() as executor:
        future = executor.submit(time.sleep, 15.0)
        raise KeyboardInterrupt
    assert future.cancelled() or isinstance(future.exception(), BrokenProcessPool)


@linux
@pytest.mark.slow
def test_killed_half_way_it_goes_on_and_leaves_no_worker(tmp_path):
    process = start(tmp_path)
    workers = workers_of(process)
    assert workers
    process.kill()
    process.communicate()
    wait_for(lambda: not any(Path(f"/proc/{worker}").exists() for worker in workers))
    assert len(stored(tmp_path)) < 8
    assert runs(range(8), square, tmp_path, local_pool(2)) == SQUARES


@linux
@pytest.mark.slow
def test_a_killed_worker_is_replaced(tmp_path):
    process = start(tmp_path)
    os.kill(workers_of(process)[0], signal.SIGKILL)
    assert process.wait(90) == 0
    assert stored(tmp_path) == dict(enumerate(SQUARES))


def test_workers_that_always_die_are_given_up():
    def dies(cell):
        raise OSError("gone")

    with pytest.raises(uv.RunFailed, match=r"die before any run .* \(of 2 runs: 0, 1\): gone"):
        list(run_all(dies, [0, 1], pool_of(Here())))


@pytest.mark.parametrize("number", [None, 2])
def test_a_run_that_takes_its_worker_with_it_comes_last_and_is_named(number):
    """The others are done, although it is the first."""
    @contextmanager
    def pool():
        dead = False

        def poisoned(cell):
            nonlocal dead
            dead = dead or cell == 0
            if dead:
                raise OSError("gone")
            return cell

        executor = Here()
        submit = executor.submit
        executor.submit = lambda fn, cell: submit(poisoned, cell)
        yield executor

    found = run_all(square, range(5), Pool(pool, number))
    assert {next(found)[0] for _ in range(4)} == {1, 2, 3, 4}
    with pytest.raises(uv.RunFailed, match=r"of 1 runs: 0\)"):
        next(found)


@pytest.mark.slow
def test_a_cluster_gives_the_same_and_its_killed_worker_is_replaced(tmp_path):
    """A scheduler and two workers, each a process of its own."""
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True,
                                  dashboard_address=None) as cluster:
        process = start(tmp_path, f"cluster_pool({cluster.scheduler_address!r})")
        os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
        assert process.wait(90) == 0
    assert stored(tmp_path) == dict(enumerate(SQUARES))


def test_a_number_of_workers_that_cannot_be_and_no_scheduler_are_refused(monkeypatch):
    with pytest.raises(uv.InvalidParameter, match="at least 1"):
        make_pool(0, None)
    monkeypatch.setattr("uvms_drake.campaign.pool.CONNECT_SECONDS", 0.5)
    with pytest.raises(uv.InvalidParameter, match="--scheduler"):
        make_pool(None, "tcp://127.0.0.1:1")
