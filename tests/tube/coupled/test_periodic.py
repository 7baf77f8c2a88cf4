"""Tests of `tube.coupled.periodic` and `gains` against loops of one row and by hand."""

from fractions import Fraction

import numpy as np
import pytest

from uvms_drake.model.signals.linear import ErrorChannel, LinearLoop, stacked
from uvms_drake.tube.coupled.gains import Responses, _over_dwells
from uvms_drake.tube.coupled.periodic import compiled
from uvms_drake.tube.coupled.simulated import simulated
from uvms_drake.tube.loops.row_loop import RowLoop

K, SIGMA = 6.0, 4.0  # 1/s


def row(period, delay):
    """Returns a row behind a clock, ë = held command + δ, and its entries."""
    loop = LinearLoop()
    e = loop.state("e", 2)
    delta, noise = loop.entry("delta", 1), loop.entry("noise", 1)
    measured = e + np.eye(2)[:, :1] @ noise
    command = np.array([[-K * SIGMA, -(K + SIGMA)]]) @ measured
    held = loop.sampled("command", command, period, delay)
    loop.flow(e, stacked([e[1:], held + delta]))
    return loop, compiled(loop, [e]), delta, noise


@pytest.mark.parametrize(("period", "delay"), [(0.02, 0.0), (0.02, 0.01), (0.02, 0.03)])
def test_a_row_has_the_gain_of_its_row_loop(period, delay):
    """Its largest value by any δ is that of `RowLoop`, whose bound is a little larger."""
    _, system, delta, _ = row(period, delay)
    known = RowLoop(K, SIGMA, period=period, dead_time=delay).gains["disturbance"]
    found = Responses(system).gain(ErrorChannel("δ", delta, np.ones(1), kind="flow")).worst
    np.testing.assert_allclose(found, [known.position, known.velocity], rtol=5e-3)


def test_a_late_command_makes_a_row_unstable_where_its_row_loop_is():
    for delay in (0.05, 0.1, 0.2, 0.3):
        stable = RowLoop(K, SIGMA, period=0.02, dead_time=delay).stable
        assert row(0.02, delay)[1].stable is stable


def test_the_worst_noise_reaches_its_gain():
    _, system, _, noise = row(0.02, 0.01)
    (block,) = noise.parts
    gain = Responses(system, (1,)).gain(ErrorChannel("ν", noise, np.ones(1))).worst[0]
    h = system.response(block, 1)[:, 0, 0]
    count = len(h) - 1
    sign = np.sign(h[count::-1])
    time, rows = simulated(
        [(0.0, system)], {block: lambda t: np.array([sign[min(round(t / 0.02), count)]])},
        (count + 1) * 0.02)
    last = np.flatnonzero(time <= count * 0.02 + float(
        system.steps[1].time) + system.steps[1].duration + 1e-9)[-1]
    assert rows[last, 0] == pytest.approx(gain, rel=1e-6)


def test_clocks_of_any_ratio_have_their_common_period():
    loop = LinearLoop()
    x = loop.state("x", 1)
    loop.flow(x, -1.0 * x)
    for name, period in (("a", 0.02), ("b", 0.03), ("c", 1.0 / 75.0)):
        loop.sampled(name, x, period)
    assert compiled(loop, [x]).period == Fraction(3, 25) / 1


def test_dwells_are_those_of_an_exhaustive_search():
    rng = np.random.default_rng(1)
    h, least, most = rng.normal(size=7), 2, 3

    def best(start, shortest):
        if start >= len(h):
            return 0.0
        ends = {min(start + m, len(h)) for m in range(shortest, most + 1)}
        return max(abs(h[start:end].sum()) + best(end, least) for end in ends)

    found = _over_dwells(h[:, None, None], least, most, lambda sums, _: np.abs(sums))
    assert found[0, 0] == pytest.approx(best(0, 1))


def test_a_slow_error_counts_by_its_delay():
    _, system, _, noise = row(0.02, 0.01)
    responses = Responses(system)
    constant = responses.gain(ErrorChannel("c", noise, np.ones(1), kind="constant")).worst
    slow = responses.gain(ErrorChannel(
        "s", noise, np.ones(1), kind="slow", rate=np.array([0.1]))).worst
    assert constant[0] == pytest.approx(1.0, rel=5e-3)
    # e follows it (K + Σ)/KΣ later, in the mean.
    assert slow[0] - constant[0] == pytest.approx(0.1 * (K + SIGMA) / (K * SIGMA), rel=0.05)
