"""Bound of the probability of failure: closed form, tables, exact arithmetic, simulated runs."""

from fractions import Fraction
from math import comb

import numpy as np
import pytest

from uvms_drake.certificate.in_probability import binomial_tail, failure_bound, percent_above
from uvms_drake.common.errors import InvalidParameter


@pytest.mark.parametrize(("runs", "confidence", "bound"), [
    (60, 0.95, 0.0487), (300, 0.95, 0.00994), (59, 0.95, 0.0495), (1, 0.95, 0.95),
    (459, 0.99, 0.00998)])
def test_without_a_failure_it_is_the_closed_form(runs, confidence, bound):
    """59 runs for 5 % at 95 % and 459 for 1 % at 99 % are Wilks's numbers."""
    found = failure_bound(runs, 0, confidence)
    assert found == pytest.approx(1.0 - (1.0 - confidence)**(1.0 / runs), rel=1e-12)
    assert found == pytest.approx(bound, rel=2e-3)


@pytest.mark.parametrize(("failures", "runs", "bound"), [
    (1, 10, 0.3942), (2, 20, 0.2826), (5, 100, 0.1023), (1, 60, 0.0766), (9, 10, 0.9949)])
def test_with_failures_it_is_that_of_clopper_and_pearson(failures, runs, bound):
    """Tables of the one-sided limit at 95 %."""
    assert failure_bound(runs, failures, 0.95) == pytest.approx(bound, abs=6e-5)


@pytest.mark.parametrize(("failures", "runs"), [(1, 7), (3, 60), (40, 60), (299, 300), (12, 5000)])
@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.999])
def test_as_few_failures_have_the_remaining_probability(failures, runs, confidence):
    """The tail in exact arithmetic, at the bound and just below it."""
    p = failure_bound(runs, failures, confidence)
    tails = []
    for exact in (Fraction(p), Fraction(p * (1.0 - 1e-9))):
        small = exact.limit_denominator(10**12)
        tails.append(float(sum(comb(runs, i) * small**i * (1 - small)**(runs - i)
                               for i in range(failures + 1))) if runs < 100 else
                     binomial_tail(runs, failures, float(exact)))
    assert tails[0] == pytest.approx(1.0 - confidence, rel=1e-6)
    assert tails[1] > tails[0]


def test_it_grows_with_failures_and_confidence_and_falls_with_runs():
    bounds = [failure_bound(60, k, 0.95) for k in range(61)]
    assert np.all(np.diff(bounds) > 0.0)
    assert bounds[-1] == 1.0
    assert failure_bound(60, 2, 0.99) > failure_bound(60, 2, 0.95) > failure_bound(61, 2, 0.95)


@pytest.mark.parametrize("true", [0.01, 0.1, 0.4])
def test_the_bound_of_simulated_runs_is_right_as_often_as_its_confidence(true):
    rng = np.random.Generator(np.random.Philox(4))
    counts = rng.binomial(40, true, 20_000)
    bounds = np.array([failure_bound(40, k, 0.9) for k in range(41)])
    right = np.mean(bounds[counts] >= true)
    assert right >= 0.9 - 3.0 * np.sqrt(0.9 * 0.1 / len(counts))
    assert right < 1.0 or failure_bound(40, 0, 0.9) > true


@pytest.mark.parametrize(("args", "key"), [
    ((0, 0, 0.95), "runs"), ((5, 6, 0.95), "failures"), ((5, -1, 0.95), "failures"),
    ((5, 0, 1.0), "confidence"), ((5, 0, 0.0), "confidence")])
def test_an_argument_out_of_its_range_is_refused(args, key):
    with pytest.raises(InvalidParameter, match=f"^{key} = "):
        failure_bound(*args)


@pytest.mark.parametrize(("p", "text"), [
    (0.0487029, "4.88 %"), (0.0099361, "0.994 %"), (0.05, "5 %"), (0.63161, "63.2 %"),
    (1.0, "100 %"), (0.99999, "100 %"), (1.234e-4, "0.0124 %")])
def test_a_percentage_is_rounded_up(p, text):
    assert percent_above(p) == text
    assert float(text[:-2]) >= 100.0 * p - 1e-12
