"""Tests of `model.propulsion`: curves, voltages and errors of thrusters, and their allocation."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from support.thrusters import T200, eight_thrusters, t200

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.description.thruster_file import CurveData, ThrusterKind
from uvms_drake.model.propulsion.allocation import (
    Allocation,
    bias_against_dead_bands,
    bounded_least_squares,
)
from uvms_drake.model.propulsion.thrusters import ThrusterModel, curve_at

ONE_WAY = ThrusterKind(lag=0.1, curves=[
    CurveData(None, np.array([0.0, 0.2, 1.0]), np.array([0.0, 0.0, 10.0]))])
SMOOTH = ThrusterKind(lag=0.1, curves=[
    CurveData(None, np.array([-2.0, 1.0]), np.array([-10.0, 20.0]))])


@pytest.mark.parametrize(("kind", "voltage"), [
    (t200(), 16.0), (t200(), 13.3), (ONE_WAY, None), (SMOOTH, None)])
def test_a_force_comes_back_from_its_command_and_is_outside_of_the_dead_band(kind, voltage):
    curve = curve_at(kind, voltage)
    start, end = curve.dead_band
    for force in np.linspace(curve.force[0], curve.force[-1], 201):
        command = curve.command_of(force)
        assert curve.force_of(command) == pytest.approx(force, abs=1e-12)
        assert (command > end if force > 0.0 else command < start if force < 0.0
                else start <= command <= end)
    for command in np.linspace(start, end, 11):
        assert curve.force_of(command) == pytest.approx(0.0, abs=1e-12)


def test_no_command_gives_more_than_the_largest_force():
    curve = curve_at(t200(), 16.0)
    assert curve.command_of(100.0) == 1900.0 and curve.force_of(2500.0) == 51.48
    assert curve.command_of(-100.0) == 1100.0 and curve.force_of(0.0) == -39.91


def test_a_curve_without_points_of_no_force_has_a_dead_band_of_none():
    assert curve_at(SMOOTH, None).dead_band == (-1.0, -1.0)
    assert curve_at(SMOOTH, None).command_of(0.0) == -1.0


def test_between_two_voltages_the_force_is_linear_in_the_voltage():
    for command in np.linspace(1100.0, 1900.0, 41):
        low, high = (np.interp(command, curve.command, curve.force) for curve in T200)
        assert curve_at(t200(), 13.0).force_of(command) == pytest.approx(0.75 * low + 0.25 * high)


@pytest.mark.parametrize(("kind", "voltage", "message"), [
    (t200(), None, r"^voltage = None: must be given, for curves of \[12\.0, 16\.0\] V$"),
    (t200(), 20.0, r"^voltage = 20\.0: must be within those of the curves, \[12\.0, 16\.0\] V$"),
    (SMOOTH, 16.0, r"^voltage = 16\.0: must be within those of the curves, \[None\] V$"),
])
def test_a_voltage_that_no_curve_tells_of_is_refused(kind, voltage, message):
    with pytest.raises(InvalidParameter, match=message):
        curve_at(kind, voltage)


def test_an_error_is_one_for_all_or_one_each():
    known = ThrusterModel.of(eight_thrusters())
    command = known.commands_of(np.full(8, 20.0))
    np.testing.assert_allclose(known.off_by(0.1).forces_of(command), 22.0)
    np.testing.assert_allclose(known.off_by([0.1]).forces_of(command), 22.0)
    each = np.linspace(-0.2, 0.2, 8)
    np.testing.assert_allclose(known.off_by(each).forces_of(command), 20.0 * (1.0 + each))
    for error in (np.zeros(3), np.full(8, -1.1)):
        with pytest.raises(InvalidParameter, match=r"^error = "):
            known.off_by(error)


@pytest.fixture(scope="module")
def five(girona):
    """Of the Girona 500, without roll."""
    return Allocation.to(ThrusterModel.of(girona.thrusters))


@pytest.fixture(scope="module")
def eight():
    return Allocation.to(ThrusterModel.of(eight_thrusters(bias=3.0)))


def test_within_the_limits_it_is_the_pseudo_inverse_and_gives_the_wrench(eight):
    rng = np.random.default_rng(0)
    B = eight.thrusters.B
    for wrench in rng.uniform(-1.0, 1.0, (20, 6)) * [20.0, 20.0, 20.0, 3.0, 3.0, 3.0]:
        forces = eight.forces(wrench)
        np.testing.assert_allclose(forces - eight.bias, np.linalg.lstsq(B, wrench)[0], atol=1e-10)
        np.testing.assert_allclose(B @ forces, wrench, atol=1e-10)
        np.testing.assert_allclose(eight.shortfall(wrench), 0.0, atol=1e-10)


def test_an_axis_that_no_thruster_drives_is_all_that_falls_short(five):
    """The others are exact; the roll moment is that of the sway thruster's lever arm."""
    wrench = np.array([40.0, -30.0, 20.0, 5.0, 8.0, -4.0])
    short = five.shortfall(wrench)
    np.testing.assert_allclose(short[[0, 1, 2, 4, 5]], 0.0, atol=1e-12)
    assert short[3] == pytest.approx(5.0 - (-0.021 * 30.0))


def test_the_bias_gives_no_wrench_and_keeps_thrusters_out_of_their_dead_bands(eight):
    b = eight.bias
    np.testing.assert_allclose(eight.thrusters.B @ b, 0.0, atol=1e-12)
    assert np.min(np.abs(b)) == pytest.approx(3.0) and np.max(np.abs(b)) < 3.5
    rng = np.random.default_rng(1)
    smallest = eight.thrusters.smallest
    tried = 0
    for wrench in rng.uniform(-1.0, 1.0, (500, 6)) * [4.0, 4.0, 4.0, 0.5, 0.5, 0.5]:
        if np.all(np.abs(eight.matrix @ wrench) <= 3.0 - smallest):
            assert np.all(np.abs(eight.forces(wrench)) >= smallest)
            tried += 1
    assert tried > 100


def test_a_bias_is_for_thrusters_that_can_work_against_each_other(five):
    """Five thrusters of five axes cannot; nor can one that is alone on its axis beside two."""
    np.testing.assert_array_equal(
        Allocation.to(replace(five.thrusters, bias=5.0)).bias, np.zeros(5))
    b = bias_against_dead_bands(np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), 2.0)
    np.testing.assert_allclose(np.abs(b), [2.0, 2.0, 0.0], atol=1e-12)
    assert b[0] * b[1] < 0.0
    with pytest.raises(InvalidParameter, match=r"^bias = 40\.0: must be smaller: it takes forces"):
        Allocation.to(ThrusterModel.of(eight_thrusters(bias=40.0)))


def test_of_a_null_space_of_two_dimensions_the_smallest_entry_is_what_counts():
    """Three thrusters on one axis: f₁ + f₂ + f₃ = 0 with all |fᵢ| ≥ 1 has a largest of 2."""
    b = bias_against_dead_bands(np.ones((1, 3)), 1.0)
    np.testing.assert_allclose(np.sort(np.abs(b)), [1.0, 1.0, 2.0], atol=1e-12)


def enumerated(A, y, lower, upper):
    """The best of all ways to hold some variables at bounds and free the others."""
    best, smallest = None, np.inf
    for held in product((-1, 0, 1), repeat=len(lower)):
        held = np.array(held)
        x = np.where(held < 0, lower, upper)
        free = held == 0
        if np.any(free):
            x[free] = np.linalg.lstsq(A[:, free], y - A[:, ~free] @ x[~free])[0]
        size = np.linalg.norm(A @ x - y)
        if size < smallest and np.all((lower - 1e-12 <= x) & (x <= upper + 1e-12)):
            best, smallest = x, size
    return best


def test_bounded_least_squares_is_the_best_of_all_active_sets():
    rng = np.random.default_rng(2)
    for _ in range(30):
        A, y = rng.normal(size=(6, 4)), 3.0 * rng.normal(size=6)
        lower, upper = -rng.uniform(0.1, 1.0, 4), rng.uniform(0.1, 1.0, 4)
        np.testing.assert_allclose(
            bounded_least_squares(A, y, lower, upper), enumerated(A, y, lower, upper), atol=1e-9)


def test_beyond_the_limits_the_weighted_error_cannot_be_made_smaller(eight):
    """No direction that the limits allow lowers ‖W(Bf − τ)‖; those that are free leave it."""
    rng = np.random.default_rng(4)
    thrusters, W = eight.thrusters, eight.weights
    for wrench in rng.normal(size=(50, 6)) * [150.0, 150.0, 200.0, 40.0, 30.0, 40.0]:
        f = eight.forces(wrench)
        at_lower, at_upper = f == thrusters.lower, f == thrusters.upper
        assert np.all((thrusters.lower <= f) & (f <= thrusters.upper))
        slope = (W[:, None] * thrusters.B).T @ (W * (thrusters.B @ f - wrench))
        np.testing.assert_allclose(slope[~at_lower & ~at_upper], 0.0, atol=1e-6)
        assert np.all(slope[at_lower] >= -1e-6) and np.all(slope[at_upper] <= 1e-6)
        if np.any(at_lower | at_upper):
            assert np.linalg.norm(W * eight.shortfall(wrench)) > 1e-4


def test_from_within_the_limits_to_beyond_them_the_forces_do_not_jump(eight):
    direction = np.array([1.0, 0.3, 0.2, 0.0, 0.1, 0.05])
    along = [eight.forces(size * direction) for size in np.linspace(50.0, 250.0, 401)]
    assert np.max(np.abs(np.diff(along, axis=0))) < 0.6  # N, for steps of half a newton
    assert np.any(along[-1] == eight.thrusters.lower) and np.any(along[0] > eight.thrusters.lower)
