"""Tests of `uvms_drake.model.propulsion.thrusters`: curves, their inverse, voltages and errors."""


import numpy as np
import pytest
from support.thrusters import T200, eight_thrusters, t200

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.description.thruster_file import CurveData, ThrusterKind
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


def test_the_model_of_a_file_has_its_numbers():
    known = ThrusterModel.of(eight_thrusters())
    assert known.size == 8 and known.names[:2] == ("across0", "up0") and known.dead_time == 0.11
    np.testing.assert_array_equal(known.lower, np.full(8, -39.91))
    np.testing.assert_array_equal(known.upper, np.full(8, 51.48))
    np.testing.assert_array_equal(known.driven, np.arange(6))
    assert known.undriven.size == 0
    forces = np.linspace(-30.0, 40.0, 8)
    np.testing.assert_allclose(known.forces_of(known.commands_of(forces)), forces)


def test_an_error_is_one_for_all_or_one_each():
    known = ThrusterModel.of(eight_thrusters())
    command = known.commands_of(np.full(8, 20.0))
    np.testing.assert_allclose(known.off_by(0.1).forces_of(command), 22.0)
    np.testing.assert_allclose(known.off_by([0.1]).forces_of(command), 22.0)
    each = np.linspace(-0.2, 0.2, 8)
    np.testing.assert_allclose(known.off_by(each).forces_of(command), 20.0 * (1.0 + each))
    for error in (np.zeros(3), np.full(8, -1.0)):
        with pytest.raises(InvalidParameter, match=r"^error = "):
            known.off_by(error)
