"""Tests of what is shown of a wall: where it begins, its class, bands of the force, metrics."""

from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import aimed_at, synthetic_record, synthetic_sensed_record

import uvms_drake as uv
from uvms_drake.campaign.run import outcome
from uvms_drake.certificate.run_verdict import broken
from uvms_drake.control.limits.radii import HoldRadii
from uvms_drake.model.surface.contact_laws import Linear
from uvms_drake.model.surface.geometry import Cylinder, Plane
from uvms_drake.model.surface.unknown_contact import HoldForces, UnknownContact
from uvms_drake.report.contact_check import departures, force_bands, has_stood, summarise_bands
from uvms_drake.report.metrics import wall_metrics
from uvms_drake.report.signals import surface_slope
from uvms_drake.report.summary import format_summary
from uvms_drake.station.true_wall import surface_depth
from uvms_drake.tube.contact.sensor_error import ripple
from uvms_drake.tube.ultimate_bounds import hold_band, tip_errors

HOLD = HoldRadii(time=0.5, depth=3e-4, position=4e-4, advance=0.01, standing=0.0025, reading=1.5,
                 age=0.03)
STANDS = 2.0  # s, from when on the plan does


@pytest.fixture(scope="module")
def record():
    """A plan that stands from 2 s on, in contact from 1 s on, 1 mm short by 800 N/m."""
    base = synthetic_sensed_record(4.0)
    time, nominal = base.time, base.nominal_state.copy()
    nominal[:, 10:] = np.where(time[:, None] < STANDS, 0.05, 0.0)
    nominal[:, 10] += np.where(np.isclose(time, 3.0), 0.05, 0.0)  # It moves once more.
    force = np.zeros((len(time), 6))
    force[:, 0] = 20.0 + np.where(time < STANDS, 6.0, 0.4)
    target = base.chi_nominal[:, :3] + [0.001, 0.0, 0.0]
    return replace(
        base, nominal_state=nominal, force=force, certified=np.array(True),
        scenario=replace(base.scenario, tube=replace(base.scenario.tube, hold=HOLD)),
        signals=base.signals | aimed_at(target) | {
            "touched": (time >= 1.0)[:, None].astype(float),
            "stiffness_used": np.full((len(time), 1), 800.0)})


def test_a_plan_has_stood_once_all_of_its_speeds_were_small_for_the_time(record):
    stood, time = has_stood(record), record.time
    expected = ((time > STANDS + 0.49) & (time < 2.99)) | (time > 3.49)
    assert np.count_nonzero(stood != expected) <= 2
    without = replace(record, scenario=replace(
        record.scenario, tube=replace(record.scenario.tube, hold=None)))
    assert not np.any(has_stood(without))


def test_each_instant_in_contact_has_its_band(record):
    found, contact = force_bands(record), record.scenario.contact
    assert np.all(np.isnan(found.bound[record.time < 0.99]))
    assert found.bound[found.holds] == pytest.approx(hold_band(contact, 20.0, HOLD, 0.0008))
    moving = (record.time >= 1.0) & ~found.holds
    assert found.bound[moving] == pytest.approx(
        contact.band(20.0, tip_errors(record.scenario.tube), 0.0, 0.0008))
    assert found.error[found.holds] == pytest.approx(0.4)


def test_the_summary_has_both_phases_and_a_band_that_is_left_breaks_the_guarantee(record):
    bands = summarise_bands(record)["force_bands"]
    least = hold_band(record.scenario.contact, 20.0, HOLD, 0.0008)
    assert bands["hold"]["worst_ratio"] == pytest.approx(0.4 / least)
    assert bands["motion"]["worst_error"] == pytest.approx(6.0)
    assert bands["hold"]["exits"] == bands["motion"]["exits"] == 0
    (line,) = (line for line in format_summary(uv.summarise(record), full=True).splitlines()
               if " in a hold (" in line)
    assert f"from {bands['hold']['after_touch_s']:.2g} s after the touch" in line
    assert f"0.4 of {least:.3g} N at {bands['hold']['at']['time_s']:.2f} s" in line
    assert bands["hold"]["after_touch_s"] == pytest.approx(STANDS + HOLD.time - 1.0, abs=0.021)
    outside = record.force.copy()
    outside[-1, 0] = 20.0 + 1.01 * least
    left = uv.summarise(replace(record, force=outside))
    assert left["contact"]["force_bands"]["hold"]["exits"] == 1
    assert "the force band in a hold" in broken(left)


def test_a_run_without_a_certificate_has_no_bands(record):
    assert summarise_bands(replace(record, certified=np.array(False))) == {}


# The class of the wall.

SPECIFIED = UnknownContact(direction=np.array([1.0, 0.0, 0.0]), stiffness=1000.0, angle=0.1,
                     dissipation=1.0, friction=0.4, force_rate=40.0, force_ripple=2.0,
                     clearance=0.05)
TIME = np.arange(0.0, 10.0, 0.02)
PLACE = 0.08


def motion(back=0.0):
    """A tip that goes in, maybe to and fro, and slides to and fro while it presses."""
    x = 0.1 * (1.0 - np.exp(-TIME)) + back * np.sin(2.0 * TIME) * (np.pi < TIME)
    tip = np.stack([x, 0.02 * np.sin(TIME), 0.01 * np.cos(TIME)], axis=1)
    return tip, np.gradient(tip, TIME, axis=0)


def observed(specified=SPECIFIED, *, kappa=1000.0, angle=0.1, mu=0.4, damping=1.0, place=PLACE,
             pull=0.0, back=0.0, hidden=None, stood=None):
    """Departures of a plane at an angle, with friction against the motion of the tip."""
    into = np.array([np.cos(angle), np.sin(angle), 0.0])
    tip, v = motion(back)

    def static(places):
        return kappa * np.maximum((places - place * np.eye(3)[0]) @ into, 0.0)

    along = v - (v @ into)[:, None] * into
    rubbed = along / np.maximum(np.linalg.norm(along, axis=1), 0.02)[:, None]
    rate = v @ into
    hidden = damping if hidden is None else hidden  # Of a tip that goes back.
    normal = static(tip) * np.maximum(1.0 + np.where(rate > 0.0, damping, hidden) * rate, 0.0)
    force = normal[:, None] * (into + mu * rubbed)
    return departures(specified, TIME, tip, v, force - pull * into, static, stood)


def test_a_wall_at_all_bounds_of_its_class_is_of_it():
    assert observed() == {}


@pytest.mark.parametrize(("key", "changed"), [
    ("stiffness", {"kappa": 1100.0}), ("angle and friction", {"mu": 0.6}),
    ("angle and friction", {"angle": 0.3}), ("clearance", {"place": 0.03}),
    ("dissipation", {"damping": 4.0, "mu": 0.4}), ("angle and friction", {"pull": 30.0})])
def test_what_is_not_of_the_class_is_named(key, changed):
    found = observed(replace(SPECIFIED, force_rate=1e6), **changed)
    assert key in found
    if key == "stiffness":
        assert found == {"stiffness": (1000.0, pytest.approx(1100.0, rel=0.05))}
    if key == "clearance":
        assert found[key].observed == pytest.approx(0.03, abs=1e-3)


def test_friction_that_is_too_fast_for_a_hold_is_named_where_the_plan_stands():
    slow = replace(SPECIFIED, hold=HoldForces(force_rate=0.5, force_ripple=0.01))
    never, always = np.zeros(len(TIME), dtype=bool), np.ones(len(TIME), dtype=bool)
    assert observed(slow) == observed(slow, stood=never) == {}
    assert set(observed(slow, stood=always)) == {"hold.force_ripple"}
    assert observed(SPECIFIED, stood=always) == {}


def test_damping_that_hides_the_force_from_a_tip_that_goes_back_is_named():
    specified = replace(SPECIFIED, friction=0.0, force_rate=1e6)
    assert observed(specified, mu=0.0, back=0.005) == {}
    assert observed(specified, mu=0.0, back=0.005, hidden=5.0)["dissipation"].observed > 4.0


def test_a_force_that_turns_faster_than_told_is_named():
    assert set(observed(replace(SPECIFIED, force_rate=1.0, force_ripple=0.5))) == {"force_ripple"}


STIFFNESS, TILT = 500.0, 0.05
LARGEST = 45.0
"""contact.force of the scenario [N]."""


def pressing(*stretches, stiffness=STIFFNESS, tilt=TILT):
    """A record of 20 s in which the tip is that deep in a plane from each of the times on."""
    scenario = uv.load_scenario("girona500_contact", ["duration=20", "log_period=0.02"])
    into = np.array([np.cos(tilt), 0.0, np.sin(tilt)])
    wall = uv.ShapedSurface(Plane(np.zeros(3), -into), Linear(stiffness, 0.001), 0.0, 0.0)
    scenario = replace(scenario, surface=wall, task=replace(scenario.task, pose=np.zeros(6)))
    begins, depths = map(np.array, zip((0.0, -0.1), *stretches, strict=True))
    depth = depths[np.searchsorted(begins, np.arange(1001) * 0.02 + 1e-9) - 1]
    chi = np.zeros((1001, 6))
    chi[:, :3] = depth[:, None] * into
    chi[0, :3] = [-0.2, 0.0, 0.0]
    force = np.zeros((1001, 6))
    force[:, :3] = stiffness * np.maximum(depth - 0.0005, 0.0)[:, None] * into
    return synthetic_record(scenario=scenario, chi=chi, force=force,
                            desired_force=np.tile(scenario.task.force, (1001, 1)),
                            penetration=np.maximum(depth, 0.0))


def deep(force, stiffness=STIFFNESS):
    """Depth at which the wall gives a force along its normal."""
    return force / stiffness + 0.0005


def test_times_and_forces_are_those_of_the_run():
    record = pressing((4.0, deep(10.0)), (7.0, deep(20.5)), (15.0, deep(20.2)))
    wall = wall_metrics(record)
    assert wall["static"] == pytest.approx(20.5 / LARGEST)
    fastest = 0.13 + np.tan(0.0873) * np.hypot(0.15, 0.15)  # Along and across n, in m/s.
    assert wall["peak"] == pytest.approx(20.5 / (LARGEST * (1.0 + 1.0 * fastest)))
    assert wall["first_touch_s"] == pytest.approx(4.0)
    assert wall["settled_s"] == pytest.approx(3.0)
    assert wall["error"] == pytest.approx(abs(20.2 * np.cos(TILT) - 20.0))
    assert wall["losses"] == 0 and wall["in_class"]
    assert wall["angle"] == pytest.approx(TILT)
    assert wall["stiffness"] == pytest.approx(STIFFNESS)
    # A campaign judges the run by them, not by the tilted wall's force across n.
    result = outcome(record)
    assert result["force_error"] == wall["final_error"]
    assert result["settling_time_s"] == pytest.approx(7.0)


def test_a_wall_that_is_left_is_told():
    wall = wall_metrics(pressing((3.0, deep(5.0)), (4.0, -0.01), (5.0, deep(20.0)), (8.0, -0.01),
                                 (9.0, deep(20.0)), (19.0, -0.01)))
    assert wall["losses"] == 2
    assert wall["settled_s"] is None
    never = wall_metrics(pressing((1.0, -0.1)))
    assert never["first_touch_s"] is never["settled_s"] is None
    assert never["static"] == never["losses"] == 0


@pytest.mark.parametrize("settings", [{"stiffness": 1100.0}, {"tilt": 0.1}, {"stiffness": 50.0}])
def test_a_wall_out_of_the_class_or_not_shown_to_be_of_it_is_told(settings):
    """Too stiff, too tilted, or touched outside of the proven ball, half a metre away."""
    stiffness = settings.get("stiffness", STIFFNESS)
    record = pressing((4.0, deep(20.0, stiffness)), **settings)
    if stiffness == 50.0:
        record.chi[500:, 1] += 2.0
    assert not wall_metrics(record)["in_class"]


def test_a_force_that_changes_too_fast_is_none_of_the_class():
    """A ramp of 40 N/s with a square wave of 2 N either way is; a faster one is not."""
    time = np.arange(200) * 0.02
    force = np.zeros((200, 3))
    for rate, size, slow in ((40.0, 2.0, True), (44.0, 2.0, False), (40.0, 2.6, False)):
        force[:, 1] = rate * time
        force[:, 2] = size * (-1.0) ** np.arange(200)
        assert (ripple(time, force, 41.0) <= 2.01) == slow
    sideways = pressing((4.0, deep(20.0)))
    sideways.force[500:, 1] += 5.0
    assert not wall_metrics(sideways)["in_class"]


def test_a_wall_that_is_pressed_too_hard_stays_in_the_class():
    """For any depth after that: membership is proven up to the largest force."""
    wall = wall_metrics(pressing((4.0, 1.0)))
    assert wall["in_class"] and wall["static"] > 10.0


def test_a_known_surface_has_none():
    assert wall_metrics(synthetic_record()) == {}


NORTH = np.array([1.0, 0.0, 0.0])
OFF = 0.2
ASLANT = np.array([-np.cos(OFF), 0.0, np.sin(OFF)])
"""Normal of a plane that is 0.2 rad off the direction."""


def tips(count=40):
    """Returns poses (count, 6) about the origin, on both sides of x = 0.05."""
    rng = np.random.default_rng(3)
    return rng.uniform(-0.2, 0.2, (count, 6))


def test_along_n_a_tilted_plane_begins_where_its_equation_says():
    chi, point = tips(), np.array([0.05, 0.3, 0.1])
    surface = uv.ShapedSurface(Plane(point, ASLANT)).checked()
    distance = (point - chi[:, :3]) @ ASLANT / (NORTH @ ASLANT)
    np.testing.assert_allclose(
        surface_depth(surface, chi, NORTH), chi[:, 0] + distance, atol=1e-8)


def test_along_n_a_hull_begins_where_the_ray_enters_it():
    hull = uv.ShapedSurface(Cylinder(
        point=np.array([0.1, 0.0, 0.0]), normal=-NORTH, radius=0.3)).checked()
    chi = tips()
    chi[:, 0] = np.minimum(chi[:, 0], 0.05)
    found = surface_depth(hull, chi, NORTH)
    inside = hull.penetration(np.column_stack([found + 1e-6, chi[:, 1:]]))
    outside = hull.penetration(np.column_stack([found - 1e-6, chi[:, 1:]]))
    assert np.all(inside > 0.0)
    assert np.all(outside == 0.0)


def test_a_surface_that_is_too_far_is_nowhere():
    far = uv.ShapedSurface(Plane(np.array([0.9, 0.0, 0.0]), -NORTH)).checked()
    assert np.all(np.isnan(surface_depth(far, tips(), NORTH)))
    behind = uv.ShapedSurface(Plane(np.array([-0.9, 0.0, 0.0]), -NORTH)).checked()
    assert np.all(np.isnan(surface_depth(behind, tips(), NORTH)))


def test_the_slope_along_n_is_that_of_the_law_times_the_cosine_of_the_tilt():
    surface = uv.ShapedSurface(Plane(np.array([0.05, 0.0, 0.0]), ASLANT),
                            Linear(stiffness=700.0, transition=0.002)).checked()
    chi = tips()
    slope, depth = surface_slope(surface, chi, NORTH), surface.penetration(chi)
    np.testing.assert_allclose(slope[depth > 0.003], 700.0 * np.cos(OFF), rtol=1e-6)
    assert np.all(np.isnan(slope[depth == 0.0]))
    assert np.count_nonzero(depth > 0.003) > 5 < np.count_nonzero(depth == 0.0)


@pytest.mark.parametrize("stiffness", [500.0, 1500.0])
def test_the_slope_of_a_plane_that_is_known_is_its_stiffness(stiffness):
    plane = uv.UnilateralPlane(stiffness=stiffness, transition=0.002).checked()
    chi = tips()
    chi[:, 0] = plane.anchor[0] + 0.02
    np.testing.assert_allclose(surface_slope(plane, chi, -plane.normal), stiffness, rtol=1e-6)
