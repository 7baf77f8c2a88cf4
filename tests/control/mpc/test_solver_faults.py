"""Tests of `uvms_drake.control.mpc.solver_faults`: the law and the system alone."""

import numpy as np
import pytest

from uvms_drake.control.mpc.planner import DROPPED, FAILED, SOLVED, TIMED_OUT
from uvms_drake.control.mpc.solver_faults import (
    DroppedPeriod,
    SolverFailure,
    SolverFaults,
    SolverTimeout,
    solver_fault,
)

H = 0.2  # s


def statuses(*faults, seed=0, count=20) -> list[int]:
    return [solver_fault(faults, seed, k, H) for k in range(count)]


@pytest.mark.parametrize(("kind", "status"), [
    (SolverFailure, FAILED), (SolverTimeout, TIMED_OUT), (DroppedPeriod, DROPPED)])
def test_a_certain_fault_is_at_every_sample_of_its_time(kind, status):
    """[start, end), whatever the rounding of either."""
    assert statuses(kind()) == 20 * [status]
    assert statuses(kind(start=0.6, duration=1.0)) == (
        3 * [SOLVED] + 5 * [status] + 12 * [SOLVED])
    assert statuses(kind(start=3 * 0.1, duration=0.3)) == (  # 0.30000000000000004
        2 * [SOLVED] + [status] + 17 * [SOLVED])
    assert statuses(kind(probability=0.0)) == 20 * [SOLVED]


def test_a_random_fault_depends_on_seed_sample_and_kind_alone():
    failure = SolverFailure(probability=0.3)
    one = statuses(failure, count=2000)
    assert np.mean(one) == pytest.approx(0.3, abs=0.03)
    assert one[500:] == [solver_fault([failure], 0, k, H) for k in range(500, 2000)]
    assert statuses(failure, seed=1, count=100) != one[:100]
    timeout = statuses(SolverTimeout(probability=0.3), count=2000)
    both = np.mean((np.array(timeout) > 0) & (np.array(one) > 0))
    assert both == pytest.approx(0.09, abs=0.02), "independent of each other"


def test_of_two_faults_at_a_sample_the_one_that_comes_first_counts():
    assert statuses(SolverTimeout(), DroppedPeriod(), SolverFailure()) == 20 * [DROPPED]
    assert statuses(SolverTimeout(), SolverFailure()) == 20 * [FAILED]


def test_the_system_puts_out_the_fault_of_the_last_sample():
    system = SolverFaults([SolverFailure(start=0.4, duration=0.2), DroppedPeriod(start=1.0)], 0, H)
    context = system.CreateDefaultContext()
    assert context.num_total_states() == 0
    for time, expected in ((0.0, SOLVED), (2 * H, FAILED), (0.5, FAILED), (3 * H, SOLVED),
                           (5 * H, DROPPED), (49 * H, DROPPED)):
        context.SetTime(time)
        assert system.GetOutputPort("fault").Eval(context) == [expected]
