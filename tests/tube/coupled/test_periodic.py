"""Tests of `tube.coupled.periodic` and `gains` against loops of one row and by hand."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from uvms_drake.model.signals.linear import ErrorChannel, Fixes, LinearLoop, Signal, stacked
from uvms_drake.tube.coupled.gains import Responses, _over_dwells, _variance
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


FIXES = Fixes(per_tick=0.19, most=3, lost=0.3, growth=np.array([0.5, 0.8]))
SIGMA_OF_FIX, TICK = np.array([0.1, 0.2]), 0.02  # s


def mean_of_exponential(h, s, now):
    """Returns the largest E e^{sx} over signs of the growth, by all sequences of lost fixes."""
    tick = now - np.arange(len(h))
    fix = np.floor(tick * FIXES.per_tick + 1e-9).astype(int)
    first = fix[-1] // FIXES.most * FIXES.most
    may_be_lost = [j for j in range(first, fix[0] + 1) if j % FIXES.most]
    out = np.zeros(4)
    for lost in product((False, True), repeat=len(may_be_lost)):
        gone = {j for j, is_lost in zip(may_be_lost, lost, strict=True) if is_lost}
        last = {}
        for j in range(first, fix[0] + 1):
            last[j] = last[j - 1] if j in gone else j
        known = np.array([last[j] for j in fix])
        age = TICK * (tick - known / FIXES.per_tick)
        variance = sum(np.sum(h[known == j], axis=0)**2 @ SIGMA_OF_FIX**2 for j in set(known))
        chance = np.prod([FIXES.lost if is_lost else 1.0 - FIXES.lost for is_lost in lost])
        out += [chance * np.exp(0.5 * s**2 * variance + s * np.sum(
            h * age[:, None] @ (FIXES.growth * signs))) for signs in product((1.0, -1.0), repeat=2)]
    return max(out)


def test_the_variance_of_fixes_is_that_of_all_sequences_of_lost_ones():
    h = np.random.default_rng(3).normal(size=(40, 2)) * np.exp(-np.arange(40) / 12.0)[:, None]
    channel = ErrorChannel("fixes", Signal(2, {}), 3.0 * SIGMA_OF_FIX, SIGMA_OF_FIX, "fixes", FIXES)
    s = 6.0
    expected = 2.0 / s**2 * np.log(max(mean_of_exponential(h, s, now) for now in range(300)))
    found = _variance(channel, h[:, None, :], TICK, np.array([s]), 300)
    assert found[0] == pytest.approx(expected, rel=1e-9)
    # One axis at a time, without growth, it is no less than the mean of the sums' squares.
    assert _variance(channel, h[:, None, :], TICK, np.array([s]), 8)[0] <= found[0]


def test_without_lost_fixes_and_growth_a_fix_is_a_sample_that_is_held():
    fixes = Fixes(per_tick=0.25, most=1, lost=0.0, growth=np.zeros(1))
    channel = ErrorChannel("fixes", Signal(1, {}), np.ones(1), np.array([0.3]), "fixes", fixes)
    h = np.arange(1.0, 9.0)[:, None, None]
    found = _variance(channel, h, TICK, np.array([5.0]), 4)
    # Four ticks a fix; the worst time of the fixes.
    assert found[0] == pytest.approx(0.09 * max(
        np.sum([np.sum(h[max(a, 0): a + 4])**2 for a in range(-shift, 8, 4)])
        for shift in range(4)))
