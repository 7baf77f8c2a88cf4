"""Workers that compute many runs: any `concurrent.futures.Executor`."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from typing import Any, NamedTuple, TypeVar

from uvms_drake.common.errors import InvalidParameter, RunFailed, require

Run = TypeVar("Run")
Result = TypeVar("Result")

ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that keep a worker to one core; BLAS reads them when it is loaded."""
NAMED = 8
"""Largest number of runs that an error names."""
RESTARTS = 3
"""Largest number of successive rounds in which the workers die without completing a run."""
CONNECT_SECONDS = 10
RUNS_PER_WORKER = 32
"""Runs after which a worker is replaced. Drake's Python bindings never free a LeafSystem that is
written in Python, so that a process keeps about 1 MB of each run."""


class Pool(NamedTuple):
    """Workers that can be replaced by new ones."""

    open: Callable[[], AbstractContextManager[Executor]]
    """Function that starts the workers."""
    runs: int | None = None
    """Number of runs after which all of them are replaced; never, if None."""


def run_all(compute: Callable[[Run], Result], runs: Iterable[Run], pool: Pool
            ) -> Iterator[tuple[Run, Result]]:
    """Yields (run, result) for each run once, in order of completion.

    `compute` returns errors of a run instead of raising them, so an exception here means that a
    worker died, or has other code. New workers then repeat the missing runs in another order: a
    run that kills its worker each time does not block the others.

    Args:
        compute: Function that a worker calls with a run; it is pickled, as are the runs.
        runs: The runs.
        pool: The workers.

    Raises:
        RunFailed: The workers die again and again.
    """
    jobs = list(runs)
    waiting, fruitless, first = set(range(len(jobs))), 0, 0
    while waiting:
        before, reason = len(waiting), ""
        with pool.open() as executor:
            futures: dict[Future, int] = {}
            # Submit, beginning after the run that was first in the round before.
            try:
                order = sorted(waiting, key=lambda job: (job < first, job))
                first = order[1] if len(order) > 1 else 0
                for job in order[: pool.runs]:
                    futures[executor.submit(compute, jobs[job])] = job
            except BrokenProcessPool as error:  # A worker has died already; collect the others.
                reason = str(error)
            # Collect the runs that came back.
            for future in as_completed(futures):
                try:
                    result = future.result()
                except Exception as error:
                    reason = str(error) or type(error).__name__
                    continue
                waiting.discard(futures[future])
                yield jobs[futures[future]], result
        # Give up after several rounds without any.
        fruitless = fruitless + 1 if len(waiting) == before else 0
        if fruitless > RESTARTS:
            named = ", ".join(str(jobs[job]) for job in sorted(waiting)[:NAMED])
            raise RunFailed(f"the workers die before any run comes back (of {len(waiting)} runs: "
                            f"{named}{', ...' if len(waiting) > NAMED else ''}): {reason}")


def make_pool(workers: int | None, scheduler: str | None) -> Pool:
    """Returns the workers at the address of a scheduler; without one, of this machine."""
    return local_pool(workers) if scheduler is None else cluster_pool(scheduler)


def local_pool(workers: int | None = None) -> Pool:
    """Returns a pool of processes of this machine, one a core, each with a fresh interpreter.

    They are replaced together: `ProcessPoolExecutor` has `max_tasks_per_child`, but waits forever
    for a worker that it has not replaced (python/cpython#115634, in all versions up to 3.14).
    """
    require(workers is None or workers >= 1, "--workers", workers, "at least 1")
    # On macOS the cores are those of the machine.
    count = workers or (len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity")
                        else os.cpu_count() or 1)

    @contextmanager
    def workers_here() -> Iterator[Executor]:
        """Starts the workers and ends them."""
        with _environment(dict.fromkeys(ONE_THREAD, "1")):
            executor = ProcessPoolExecutor(
                count, multiprocessing.get_context("spawn"), initializer=_start_worker)
            try:
                yield executor
            except BaseException:  # Nobody takes the runs that are being computed.
                for process in list(executor._processes.values()):
                    process.kill()
                raise
            finally:
                executor.shutdown(cancel_futures=True)

    return Pool(workers_here, RUNS_PER_WORKER * count)


def cluster_pool(address: str) -> Pool:
    """Returns the workers of a running Dask cluster, which have this package installed.

    Raises:
        InvalidParameter: Dask is not installed, or no scheduler answers at the address.
    """
    try:
        from distributed import Client  # type: ignore[import-not-found]
    except ImportError:
        raise InvalidParameter("--scheduler", address, "left out without the package "
                               "'distributed' (pip install 'uvms_drake[cluster]')") from None

    def connected() -> Any:
        """Returns a client of the scheduler."""
        try:
            return Client(address, timeout=CONNECT_SECONDS)
        except (OSError, ValueError, TypeError) as error:
            raise InvalidParameter("--scheduler", address, "the address of a Dask scheduler that "
                                   f"answers ({type(error).__name__})") from None

    @contextmanager
    def workers_there() -> Iterator[Executor]:
        with connected() as client, client.get_executor(pure=False) as executor:
            yield executor

    connected().close()
    return Pool(workers_there)


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Sets environment variables inside the block, for processes that are started there."""
    old = {key: os.environ.get(key) for key in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for key, value in old.items():
            if value is None:
                os.environ.pop(key, None)
            else:
                os.environ[key] = value


def _start_worker() -> None:
    """Leaves Ctrl-C to the parent, and lets the worker end when the parent is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)
