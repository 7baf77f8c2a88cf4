"""Tests of `uvms_drake.station.contact.bounds`: numbers that margins and conditions are made of."""

from contextlib import nullcontext

import numpy as np
import pytest

import uvms_drake as uv
from uvms_drake.certificate.certify import declared_set
from uvms_drake.control.limits import TubeRadii, resolved_radii
from uvms_drake.model.frames.euler import rate_matrix
from uvms_drake.model.frames.spatial import times
from uvms_drake.station.contact import tube_in_contact
from uvms_drake.station.contact.bounds import (
    between_knots,
    largest_reading_error,
)
from uvms_drake.station.contact.tube_in_contact import force_bounds
from uvms_drake.station.problem import limits_of
from uvms_drake.tube.contact.tip_motion import TipAcceleration
from uvms_drake.tube.law_tube import LawTube


def test_the_error_of_a_reading_grows_with_the_time_between_two():
    """What the tip does in between, no reading shows; and a force that has turned is another."""
    scenario = uv.load_scenario("girona500_contact")
    slow = uv.load_scenario("girona500_contact", ["contact.period=0.1"])
    still = uv.load_scenario("girona500_contact", ["limits.qdot=0.001", "limits.nu2=0.001"])
    known, late, calm = (largest_reading_error(each, force_bounds(each), 3.0)
                         for each in (scenario, slow, still))
    change = 3.0 / 4.0 * np.diff([h * (45.0 + 500.0 * h) for h in (0.01, 0.1)])[0]
    assert late - known == pytest.approx(change)
    assert known - calm > 0.5


def test_no_angle_of_a_plan_goes_further_between_its_knots_and_some_as_far():
    """Joints that keep a limit at both ends; and an angle that turns there and back."""
    base = uv.load_scenario("girona500_contact")
    planned = declared_set(base.limits, uv.load_model(base))
    step, rng = 0.2, np.random.default_rng(0)
    most = between_knots(planned, step)
    before, after = rng.uniform(-planned.qdot, planned.qdot, (2, 20_000))
    before[0], after[0] = planned.qdot, -planned.qdot
    t = np.linspace(0.0, step, 201)[:, None]
    way = before * t + 0.5 * (after - before) / step * t**2
    between_knots_margin = np.max(way - np.maximum(way[0], way[-1]), axis=0)
    assert np.max(between_knots_margin) == pytest.approx(most["joints_between"])
    attitude = rng.uniform(-1.0, 1.0, (20_000, 3)) * [3.0, planned.pitch, 3.0]
    omega = rng.normal(size=(20_000, 3))
    omega *= planned.nu2 / np.linalg.norm(omega, axis=1, keepdims=True)
    rates = np.abs(times(rate_matrix(attitude), omega))[:, :2]
    assert 0.95 < np.max(rates) * 0.5 * step / most["attitude_between"] <= 1.0
    turning = planned.nu2 + planned.qdot * np.sqrt(4.0)
    assert most["tool_between"] == pytest.approx(0.5 * step * turning)


def test_limits_of_angles_leave_room_for_plans_between_their_knots():
    base = uv.load_scenario("girona500_contact")
    limits = limits_of(base, uv.load_model(base))
    tube = resolved_radii(TubeRadii(joints_between=0.01, attitude_between=0.02, tool_between=0.03))
    left = {name: limits[name].half - limits[name].tightened(tube).half
            for name in ("q", "roll", "pitch", "tip_pitch", "tool_angle", "nu1")}
    tool = 0.03 * np.sin(base.contact.tool_angle)
    for name, taken in zip(left, (0.01, 0.02, 0.02, 0.03, tool, 0.0), strict=True):
        np.testing.assert_allclose(left[name], taken, atol=1e-12)
        assert limits[name].tightened(tube).between_knots_margin == pytest.approx(taken)
        assert all(radius == pytest.approx(taken) for _, radius, _ in limits[name].margins(tube))


def test_a_reading_between_two_instants_of_the_estimator_is_refused():
    tube = LawTube(TubeRadii(), (), {}, along=TipAcceleration((0.2, 0.3), (0.2, 0.3), 0.7, 0.2))
    for period, refused in ((0.01, False), (0.005, False), (0.004, True)):
        scenario = uv.load_scenario("girona500_contact", [f"contact.period={period}"])
        with pytest.raises(uv.InvalidParameter, match=r"^contact\.period = 0\.004: must be the "
                           "period of the force sensor, 0.01 s") if refused else nullcontext():
            assert tube_in_contact._unevenness(scenario, tube, force_bounds(scenario), 1.0) > 0.4
