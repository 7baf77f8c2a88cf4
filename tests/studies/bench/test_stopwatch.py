"""What the stopwatch counts; never how long it takes."""

from dataclasses import asdict

import numpy as np
import pytest

from uvms_drake.common.errors import RunFailed
from uvms_drake.control.ocp import scp
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.studies.bench import stopwatch as stopwatch_module
from uvms_drake.studies.bench.stopwatch import Stopwatch, Timing, replaced, stopwatch, timings


@pytest.fixture
def clock(monkeypatch):
    """Replaces wall time: it goes on by one second whenever somebody looks at it."""
    now = [0.0]

    def look() -> float:
        now[0] += 1.0
        return now[0]

    monkeypatch.setattr(stopwatch_module.time, "perf_counter", look)
    return now



def test_statistics_of_known_times():
    timing = Timing.of(np.arange(101) * 1e-3)
    expected = Timing(min=0.0, mean=50.0, p50=50.0, p95=95.0, p99=99.0, max=100.0)
    assert asdict(timing) == pytest.approx(asdict(expected))



def test_a_part_is_timed_without_the_parts_that_it_calls(clock):
    watch = Stopwatch()
    inner = watch.timed("inner", lambda: None)
    outer = watch.timed("outer", lambda: (inner(), inner()))
    assert watch.measure(outer) == {"inner": 2.0, "outer": 3.0, "rest": 2.0}
    assert sum(watch.measure(outer).values()) == 7.0
    assert watch.lap() == {}



def test_a_part_that_calls_itself_is_counted_once(clock):
    watch = Stopwatch()

    def down(depth: int) -> None:
        if depth:
            timed(depth - 1)

    timed = watch.timed("down", down)
    started = clock[0]
    timed(3)
    assert watch.lap() == {"down": clock[0] - started - 1.0}



def test_a_part_that_raises_is_timed_and_does_not_spoil_the_next(clock):
    watch = Stopwatch()

    def fail():
        raise RunFailed("no")

    outer = watch.timed("outer", watch.timed("inner", fail))
    with pytest.raises(RunFailed):
        outer()
    assert watch.lap() == {"inner": 1.0, "outer": 2.0}
    watch.timed("outer", lambda: None)()
    assert watch.lap() == {"outer": 1.0}



def test_a_timed_function_takes_and_returns_the_same():
    assert Stopwatch().timed("divmod", divmod)(7, 2) == (3, 1)
    assert Stopwatch().timed("dict", dict)(a=1) == {"a": 1}



def test_what_is_replaced_comes_back_as_it_was():
    class Owner:
        def method(self):
            return "class"

    one, other = Owner(), Owner()
    other.method = lambda: "own"
    for owner in (one, other, Owner):
        before = dict(vars(owner))
        with pytest.raises(RunFailed), replaced(owner, "method", lambda *args: "new"):
            assert owner.method() == "new"
            raise RunFailed("no")
        assert dict(vars(owner)) == before
    assert (one.method(), other.method()) == ("class", "own")



def test_missing_parts_took_no_time():
    total, parts = timings([{"a": 1e-3, "b": 2e-3}, {"a": 3e-3}])
    assert (parts["a"].mean, parts["b"].mean, total.mean) == pytest.approx((2.0, 1.0, 3.0))
    assert (parts["b"].min, total.min, total.max) == pytest.approx((0.0, 3.0, 3.0))



def test_the_stopwatch_times_functions_of_objects_and_modules(start_plans, short_ocp):
    plan = start_plans["off"][0]
    parts = {"linearise": (short_ocp, "linearise"), "solve": (scp, "solve_staged")}
    with stopwatch(parts) as watch:
        seconds = watch.measure(lambda: SequentialConvexSolver(short_ocp).solve(plan, 1))
    assert set(seconds) == {"linearise", "solve", "rest"}
    assert "linearise" not in vars(short_ocp)
