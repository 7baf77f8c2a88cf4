"""Supervisor: detections and retreat as functions, and runs that leave their class."""

import dataclasses
import shutil

import numpy as np
import pytest
from pydrake.common.yaml import yaml_load_data
from support.refusals import refusals
from support.robots import without_an_arm
from support.runs import simulated

import uvms_drake as uv
from uvms_drake.actuation.thruster_systems import PowerCut
from uvms_drake.control.feedback.ancillary import AncillaryFeedback
from uvms_drake.control.laws.tip_first import TipFirst
from uvms_drake.control.mpc.solver_faults import SolverFailure
from uvms_drake.control.supervisor.detections import (
    Seen,
    Thresholds,
    largest_force,
    ratios,
    stiffness_of_touch,
)
from uvms_drake.control.supervisor.isolation import faulty_thruster, wrench_of
from uvms_drake.control.supervisor.retreat import (
    LEASH,
    MARGIN,
    RETREATING,
    STANDING,
    WATCHING,
    RetreatSettings,
    allowed_acceleration,
    begun,
    filtered_torque,
    moved,
    stands,
)
from uvms_drake.control.supervisor.supervisor import initial_watch, updated
from uvms_drake.mission.law import (
    DONE,
    REASONS,
    RETREATED,
    RUNNING,
    SKIPPED,
    Measured,
    advance,
    begin,
)
from uvms_drake.mission.steps import Approach, Hold, Mission, Retreat
from uvms_drake.model.description.robot_files import model_dir
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.signals.sensor_actuator import CAUSES
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.model.uvms_model import configuration_rate_matrix
from uvms_drake.plant.waves import Wave
from uvms_drake.station.contact.bounds import fastest_advance, sensed_contact
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import dump_scenario, typed_scenario
from uvms_drake.station.supervision import (
    norms,
    supervisor_of,
    thresholds_of,
    wave_accelerations,
)

LIMITS = Thresholds(
    force=40.0, error=1.5, constant=0.5, share=0.0, delay=0.0, walls=SurfaceClass(stiffness=1000.0),
    faster=0.0, touch=3.0, depth_error=0.002, off=np.array([0.01, 0.1, 0.05]), fix=0.5,
    drift=np.array([0.05, 0.06]), cut=0.3, plan=2.6, lost=1.0, begin=4.0)
QUIET = Seen(time=9.0, tip=np.array([0.01, 0.0, 0.0]), advance=0.0, force=10.0, saturated=False,
             off=np.zeros(3), drift=np.zeros(6), fix_age=0.1, raised=False, cut_time=0.0,
             plan_age=0.2, lost_time=0.0)
NOTHING = np.array([[9.0, 0.01, 0.0, 0.0, 10.0, 0.0]])
"""The reading of now alone."""
REAL, OFF = "girona500_real_loop", "supervisor=null"
HOVERS = "mpc.hover=4.0"
NEAR = ("start.eta.0=-1.15", HOVERS)
"""The tip 0.09 m off the wall, half of the hover: it touches 12 s after the start."""


@pytest.mark.parametrize(("cause", "changes"), [
    ("force", {"force": 40.1}), ("force", {"saturated": True, "force": np.nan}),
    ("tip", {"off": np.array([0.011, 0.0, 0.0])}), ("tool", {"off": np.array([0.0, 0.11, 0.0])}),
    ("joints", {"off": np.array([0.0, 0.0, 0.051])}),
    ("fix", {"fix_age": 0.51}),
    ("drift", {"drift": np.array([0.04, 0.04, 0, 0, 0, 0])}),
    ("drift", {"drift": np.array([0, 0, 0, 0, 0, 0.061])}), ("raised", {"raised": True}),
    ("cut", {"cut_time": 0.31}), ("plan", {"plan_age": 2.61}), ("force_lost", {"lost_time": 1.01})])
def test_each_detection_is_above_one_for_its_own_cause_alone(cause, changes):
    assert (ratios(QUIET, NOTHING, LIMITS) <= 1.0).all()
    seen = QUIET._replace(**changes)
    now = np.array([[9.0, 0.01, 0.0, 0.0, seen.force, 0.0]])
    found = ratios(seen, now, LIMITS)
    assert [name for name, ratio in zip(CAUSES, found, strict=True) if ratio > 1.0] == [cause]


def test_while_the_robot_hovers_no_plan_is_followed():
    hovering = QUIET._replace(time=3.9, off=np.ones(3), plan_age=3.9)
    assert (ratios(hovering, NOTHING, LIMITS) <= 1.0).all()


@pytest.mark.parametrize(("stiffness", "trips"), [(900.0, False), (1000.0, False), (4000.0, True)])
def test_only_a_wall_that_is_stiffer_than_declared_is_beyond_the_class(stiffness, trips):
    """The tip goes 20 mm deep, back and deeper, by 10 mm/s; readings are off by 2 N."""
    rng = np.random.default_rng(3)
    depth = np.concatenate([np.linspace(0, 0.02, 100), np.linspace(0.02, 0.01, 50),
                            np.linspace(0.01, 0.024, 70)])
    force = stiffness * depth + 0.5 + rng.uniform(-1.5, 1.5, 220)
    rows = np.column_stack([np.arange(220) * 0.02, depth, np.zeros((220, 2)), force,
                            np.full(220, 0.01)])
    ratio = max(force[i] / largest_force(rows[max(i - 50, 0): i + 1], LIMITS)
                for i in range(1, 220))
    assert bool(ratio > 1.0) is trips


@pytest.mark.parametrize(("declared", "trips"), [(5.0, False), (0.0, True)])
def test_a_tip_that_slides_on_a_tilted_wall_of_the_class_is_none(declared, trips):
    """20 mm along a wall of 50 kN/m at 5°, at a constant depth n·𝔭: by tan 5° into it."""
    limits = LIMITS._replace(walls=SurfaceClass(stiffness=5e4, angle=np.deg2rad(declared)))
    tips = np.column_stack([np.zeros(30), np.linspace(0.0, 0.02, 30), np.zeros(30)])
    force = 20.0 + 5e4 * (tips @ [np.cos(np.deg2rad(5)), np.sin(np.deg2rad(5)), 0.0]) * np.cos(
        np.deg2rad(5))
    rows = np.column_stack([np.arange(30) * 0.02, tips, force, np.zeros(30)])
    assert bool(force[-1] > largest_force(rows, limits)) is trips


def readings_of_the_class(rng, limits):
    """A second of readings of a wall at the corners of the class, 100 Hz, as the supervisor's rows.

    Friction and tilt turn at random, the tip oscillates along n and slides, and every reading is of
    the least or the largest force of the last W, with the worst errors at random.
    """
    walls, h, k = limits.walls, 0.01, 140
    t = np.arange(k) * h
    rate = rng.uniform(2.0, 12.0)
    depth = 0.012 + rng.uniform(0.0, 0.012) * np.sin(rate * t + rng.uniform(0, 6))
    slide = rng.uniform(0.0, 0.05) * np.sin(rng.uniform(1.0, 6.0) * t)
    tips = np.column_stack([depth, slide, np.zeros(k)])
    normal = np.array([np.cos(walls.angle), rng.choice([-1, 1]) * np.sin(walls.angle), 0.0])
    speed, into = np.gradient(tips, h, axis=0), tips @ normal
    static = walls.stiffness * np.maximum(into, 0.0)
    damping = walls.dissipation * rng.uniform() * (speed @ normal)
    share = np.where(rng.random(k) < 0.5, walls.share - limits.share,
                     walls.largest_share + limits.share)
    force = static * (1.0 + damping) * share
    window = int(limits.delay / h)
    of = [rng.choice([np.min, np.max])(force[max(i - window, 0): i + 1]) for i in range(k)]
    constant = rng.choice([-1, 1]) * limits.constant
    read = np.array(of) + constant + limits.error * rng.choice([-1, 1], k)
    moves = np.maximum(walls.advance(speed), walls.advance(-speed))
    rows = np.column_stack([t, tips, read, moves - limits.faster])
    return rows[rng.integers(2)::2]


def test_no_reading_of_a_wall_of_the_class_is_beyond_what_is_derived_and_some_are_near():
    """An attack on control/theory.md#silence-of-the-supervisor: corners of the class at random."""
    rng = np.random.default_rng(0)
    limits = LIMITS._replace(delay=0.05, error=0.3, constant=0.2, share=0.02, faster=0.02,
                             walls=SurfaceClass(
        stiffness=900.0, angle=0.09, dissipation=1.0, friction=0.5))
    worst = 0.0
    for _ in range(300):
        rows = readings_of_the_class(rng, limits)
        worst = max(worst, *(rows[i, 4] / largest_force(rows[max(i - 50, 0): i + 1], limits)
                             for i in range(20, len(rows))))
    assert 0.8 < worst <= 1.0


def test_the_stiffness_of_a_touch_has_no_bias_by_the_error_of_the_depth():
    """Least squares in the force alone finds a quarter less."""
    rng = np.random.default_rng(0)
    found, ordinary = [], []
    for _ in range(200):
        depth = np.linspace(0.0, 0.004, 25)
        x, F = depth + rng.normal(0, 7e-4, 25), 3700.0 * depth + rng.normal(0, 2.6, 25)
        found.append(stiffness_of_touch(x, F, 7e-4, 2.6))
        ordinary.append(np.polyfit(x, F, 1)[0])
    assert np.median(found) == pytest.approx(3700.0, rel=0.06)
    assert np.median(ordinary) < 0.85 * 3700.0


@pytest.fixture(scope="module")
def model():
    return load_model(uv.load_scenario(REAL))


@pytest.fixture
def settings(model):
    return RetreatSettings(np.array([1.0, 0.0, 0.0]), 0.3, 0.1, 0.04, 0.15, model.q_lower,
                           model.q_upper, model.joint_speed)


START = np.array([-1.1, -0.1, -0.1, 0.0, 0.0, 0.05, 0.05, 1.1, 0.4, 0.1])


def test_the_retreat_takes_vehicle_and_tip_back_and_stands(model, settings):
    """With the joints within their speeds: the tip at once by 40 mm, by joints that can."""
    now, last = begun(settings, model, START, touched=True), None
    depth = model.task_pose(START)[0]
    for k in range(400):
        last, now = now, moved(settings, model, now, now.config, 0.01, None)
        assert np.all(np.abs(now.rate[6:]) <= 0.8 * model.joint_speed + 1e-9)
        np.testing.assert_allclose(now.config, last.config + 0.01 * now.rate, atol=1e-12)
        assert k < 25 or model.task_pose(now.config)[0] < depth - 0.039
    np.testing.assert_allclose(now.config[:3] - START[:3], [-0.3, 0.0, 0.0], atol=1e-9)
    assert not now.rate.any()
    untouched = begun(settings, model, START, touched=False)
    np.testing.assert_array_equal(moved(settings, model, untouched, START, 0.01, None).config[6:],
                                  START[6:])


def test_a_vehicle_without_an_arm_retreats_from_a_touch_by_itself(tmp_path):
    model = uv.UvmsModel(uv.read_uvms(str(without_an_arm(tmp_path))))
    settings = RetreatSettings(np.array([1.0, 0.0, 0.0]), 0.3, 0.1, 0.04, 0.15, model.q_lower,
                               model.q_upper, model.joint_speed)
    now = begun(settings, model, START[:6], touched=True)
    for _ in range(400):
        now = moved(settings, model, now, now.config, 0.01, None)
    np.testing.assert_allclose(now.config[:3] - START[:3], [-0.3, 0.0, 0.0], atol=1e-9)


def test_the_tip_is_drawn_off_a_wall_to_which_the_vehicle_goes_by_joints_before_their_stops(
        model, settings):
    """The shoulder, at its stop after a while, is left to the elbow."""
    now, depth = begun(settings, model, START, touched=True), model.task_pose(START)[0]
    upper, elbow = model.q_upper[1] - 0.02, 0.0
    for k in range(160):
        config = np.append(START[:6] + [0.0005 * k, 0.0, 0.0, 0.0, 0.0, 0.0], now.config[6:])
        now = moved(settings, model, now, config, 0.01, None)
        assert now.config[7] <= upper + 1e-9
        if now.config[7] > upper - 1e-9:
            elbow = max(elbow, now.rate[8])
    assert elbow > 0.2
    assert model.task_pose(config)[0] < depth + 0.08 - 0.08


def test_the_reference_stays_on_the_leash_of_a_vehicle_that_drifts(model, settings):
    now = begun(settings, model, START, touched=False)
    drifted = START + np.append([0.6, 0.8, 0.0], np.zeros(7))
    after = moved(settings, model, now, drifted, 0.01, None)
    np.testing.assert_allclose(after.config[:3] - drifted[:3], [-LEASH, -LEASH, 0.0])
    held = moved(settings, model, now, START + np.append([0.6, 0.2], np.zeros(8)), 0.01, None)
    assert held.config[1] == START[1]  # An axis that is held is where it was.


def test_a_vehicle_that_does_not_move_has_not_retreated_and_one_pushed_back_does_so_again(
        model, settings):
    """The goal stays 0.3 m back from the trip; the reference leads by the leash at most."""
    def for_seconds(now, config, seconds):
        for _ in range(int(seconds / 0.02)):
            now = moved(settings, model, now, config, 0.02, None)
        return now

    def at(x):
        return START + np.append(x, np.zeros(9))

    still = for_seconds(begun(settings, model, START, touched=False), START, 5.0)
    np.testing.assert_allclose(still.left, [0.3, np.inf])
    assert not stands(settings, False, still.left)
    assert still.config[0] - START[0] == pytest.approx(-LEASH)
    pushed = for_seconds(still, at(0.5), 5.0)
    assert pushed.left[0] == pytest.approx(0.8)
    assert pushed.config[0] == pytest.approx(START[0] + 0.5 - LEASH)  # On its way to the goal.
    there = for_seconds(pushed, at(-0.29), 5.0)
    assert there.config[0] == pytest.approx(START[0] - 0.3, abs=1e-8)
    assert stands(settings, False, there.left)
    for x, stays in ((-0.2, True), (-0.1, False)):
        again = for_seconds(there, at(x), 1.0)
        assert stands(settings, True, again.left) is stays
        assert again.config[0] == pytest.approx(START[0] - 0.3, abs=1e-8)


def tripped(settings, model):
    """Memory 1 s after a trip at START, with the reference on its way."""
    first = begun(settings, model, START, touched=True)
    return initial_watch(10)._replace(
        safety=np.array([RETREATING, 1.0, 8.0, np.nan, 0.0]), **first._replace(
            rate=np.full(10, 0.01), left=np.array([0.2, np.inf]))._asdict(),
        clocks=np.array([8.98, -np.inf, 8.98, 8.98, 0.0, 0.0, 0.0, 0.0, np.nan]))


def test_while_the_state_is_lost_the_retreat_rests_and_nothing_counts_as_distance(model, settings):
    before = tripped(settings, model)
    lost = updated(before, QUIET._replace(tip=np.full(3, np.nan)), before.config, LIMITS,
                   settings, model)
    assert not lost.rate.any() and lost.safety[0] == RETREATING
    np.testing.assert_array_equal(lost.config, before.config)
    np.testing.assert_array_equal(lost.left, before.left)
    after = updated(lost, QUIET._replace(time=9.02), START, LIMITS, settings, model)
    assert after.left[0] == pytest.approx(0.3) and after.rate[0] == pytest.approx(-0.1)
    back = START - np.append(0.28, np.zeros(9))
    assert updated(lost, QUIET._replace(time=9.02), back, LIMITS, settings,
                   model).safety[0] == STANDING


def feedback_of(model, settings, retreat, state, force):
    """A Drake context's τ of the law of the scenario, with a supervisor's retreat."""
    law = uv.load_scenario(REAL).ancillary
    system = AncillaryFeedback(model, law, safety=settings)
    context = system.CreateDefaultContext()
    nominal = np.append(START, np.zeros(10))
    for name, value in (("state", state), ("nominal_state", nominal),
                        ("nominal_acceleration", np.zeros(10)), ("nominal_input", np.zeros(10)),
                        ("force_measured", force), ("retreat", retreat)):
        system.GetInputPort(name).FixValue(context, value)
    return {name: system.GetOutputPort(name).Eval(context) for name in ("tau", "filtered")}


def test_after_a_trip_a_lost_state_gives_the_forces_of_an_equilibrium(model, settings):
    """The plan is at the wall, the reference 0.3 m off it and under way: neither is fed back."""
    away = START - np.append(0.3, np.zeros(9))
    retreat = np.concatenate([[RETREATING, 0.0], away, np.full(10, 0.05)])
    tau = feedback_of(model, settings, retreat, np.full(20, np.nan), np.full(6, 9.0))["tau"]
    still = np.zeros(10)
    rest = model.inverse_dynamics(model.kinematics(away), still, still, np.zeros(6))
    rest[3] = 0.0  # Roll has no thruster: its small moment of buoyancy accelerates the rest.
    np.testing.assert_allclose(tau, rest, atol=0.1)


def test_the_filter_of_the_joints_acts_after_a_trip_only(model, settings):
    """A plan and a reference far off ask for more than the filter lets through."""
    state = np.append(START, np.zeros(10))
    state[9] = -2.0
    watching, retreating = (feedback_of(model, settings, np.concatenate(
        [[mode, 0.0], START + np.append(np.zeros(9), 3.0), np.zeros(10)]), state, np.zeros(6))
        for mode in (0, RETREATING))
    alone = feedback_of(model, None, np.zeros(22), state, np.zeros(6))
    np.testing.assert_array_equal(watching["tau"], alone["tau"])
    assert not watching["filtered"] and retreating["filtered"]
    at, still = model.kinematics(state[:10]), np.zeros(10)
    assert filtered_torque(settings, model.mass_matrix(at), model.inverse_dynamics(
        at, still, still, np.zeros(6)), alone["tau"], alone["tau"][:6], state[6:10], still[6:])[1]


def test_the_bow_turns_the_short_way(model, settings):
    now = begun(settings, model, START, touched=False)
    assert moved(settings, model, now, START, 0.01, -3.0).rate[5] == pytest.approx(-0.1)
    assert moved(settings, model, now, START, 0.01, 3.0).rate[5] == pytest.approx(0.1)
    assert moved(settings, model, now, START, 0.01, 3.3).rate[5] == pytest.approx(-0.1)


def test_the_filter_stops_a_joint_before_its_stop_and_leaves_others_to_the_bit(model, settings):
    """Under the largest torque towards the stop, sampled as the law: within speed and stop."""
    M = model.mass_matrix(model.kinematics(START))
    tau = np.arange(10.0)
    same, cut = filtered_torque(settings, M, np.zeros(10), 0.01 * tau, np.zeros(6), START[6:],
                                np.zeros(4))
    assert not cut and np.array_equal(same, 0.01 * tau[6:])
    q, rates, h = START[6:].copy(), np.zeros(4), 0.02
    for _ in range(1000):
        torque, _ = filtered_torque(settings, M, np.zeros(10), np.full(10, 40.0), np.zeros(6), q,
                                    rates)
        step = np.linalg.solve(M, np.append(np.zeros(6), torque))[6:]
        low, high = allowed_acceleration(settings, q, rates)
        assert np.all(step <= high + 1e-9) and np.all(step >= low - 1e-9)
        q += h * rates + 0.5 * h**2 * step
        rates += h * step
        assert np.all(rates <= 1.1 * model.joint_speed)
        assert np.all(q < model.q_upper)
    np.testing.assert_allclose(q, model.q_upper - MARGIN, atol=0.01)


def test_no_threshold_is_below_the_noise_of_the_sensor(model):
    """Whatever error is declared: two readings differ by twice the noise."""
    small = thresholds_of(uv.load_scenario(REAL, ["contact.force_error=0.1"]), model)
    assert small.error >= 3.0 * 0.1 and small.force > 47.0 + 0.3
    assert small.error == thresholds_of(uv.load_scenario(REAL), model).error


def test_thresholds_follow_the_declared_numbers(model):
    """A larger declared error, gap, flow and tube allow for more."""
    base, contact = thresholds_of(uv.load_scenario(REAL), model), uv.load_scenario(REAL).contact
    a, faster = np.cos(0.0873) + 0.5 * np.sin(0.0873), 1.12 * (
        contact.speed + np.tan(0.0873) * np.sqrt(2) * contact.speed_across)
    assert base.force == pytest.approx(a * 47.0 * (1.0 + faster) + 5.5)
    for change, name in (("contact.force_error=6.0", "force"), ("sensing.0.dvl.gap=0.6", "fix"),
                         ("tube.depth_speed=0.04", "faster"), ("contact.delay=0.12", "delay"),
                         ("faults=[!SolverFailure {duration: 2}]", "plan"),
                         ("current=[0.2,0,0]", "drift"), ("tube.position=0.009", "off"),
                         ("mpc.horizon=17", "plan"), ("disturbance.bound=0.05", "drift")):
        other = thresholds_of(uv.load_scenario(REAL, [change]), model)
        larger = [field for field in Thresholds._fields if field != "walls" and np.any(
            np.asarray(getattr(other, field)) > np.asarray(getattr(base, field)) + 1e-9)]
        assert name in larger


def test_thresholds_of_a_drawn_run_are_those_of_the_scenario_it_is_drawn_from(model):
    """Whatever is drawn of it: less of payload and time, and faults without an end."""
    base = uv.load_scenario(REAL, ["model_error.payload.mass=0.5"])
    limits = thresholds_of(base, model)
    pinned = dataclasses.replace(base, supervisor=supervisor_of(base, model))

    def drawn(scenario):
        error = dataclasses.replace(base.model_error, payload=dataclasses.replace(
            base.model_error.payload, mass=0.1))
        return dataclasses.replace(scenario, duration=30.0, model_error=error, faults=[
            SolverFailure(probability=0.05)])

    assert thresholds_of(drawn(base), model).error < limits.error
    for name, value in thresholds_of(drawn(pinned), model)._asdict().items():
        if name != "walls":
            np.testing.assert_allclose(value, getattr(limits, name), rtol=1e-12, err_msg=name)
    assert np.isfinite(limits.plan)
    kept = typed_scenario(yaml_load_data(dump_scenario(pinned))).supervisor
    np.testing.assert_array_equal(kept.reading, pinned.supervisor.reading)


@pytest.mark.parametrize(("period", "spacing"), [
    (0.02, 0.02), (0.01, 0.02), (0.015625, 0.03125), (0.05, 0.05)])
def test_the_time_between_kept_readings_counts_for_how_fast_a_plan_changes(
        model, settings, period, spacing):
    """The supervisor keeps the reading of the first tick after 20 ms."""
    now, kept = initial_watch(10), []
    for k in range(40):
        now = updated(now, QUIET._replace(time=k * period), START, LIMITS, settings, model)
    kept = np.diff(now.readings.reshape(-1, 6)[:, 0])
    assert np.nanmax(kept) == pytest.approx(spacing)
    base, other = (thresholds_of(uv.load_scenario(REAL, [f"actuation.0.period={each}"]), model)
                   for each in (0.02, period))
    fastest = fastest_advance(sensed_contact(uv.load_scenario(REAL)))
    assert other.faster - base.faster == pytest.approx(
        2.0 * fastest * (spacing - 0.02) / 0.2, abs=1e-12)


test_bad_input = refusals(REAL, {
    "supervisor={distance: 0}": r"supervisor\.distance = 0.*positive",
    "supervisor={draw: -1}": r"supervisor\.draw",
    "supervisor={speed: .nan}": r"supervisor\.speed",
    "faults=[!UnknownFlow {velocity: [1]}]": r"faults\[0\]\.velocity",
    "faults=[!LostFixes {duration: 0}]": r"faults\[0\]\.duration",
}, uv.make_station)


# Runs ---------------------------------------------------------------------------------------------


def peak_of(record):
    return float(np.max(record.force[:, 0]))


def safety_of(record):
    return record.summary()["safety"]


@pytest.mark.slow
@pytest.mark.parametrize(("stiffness", "seen"), [
    pytest.param(3500.0, 3500.0, marks=pytest.mark.long), (14000.0, None)])
def test_a_wall_5_or_20_times_as_stiff_is_left_at_once(stiffness, seen):
    """Declared are 1 kN/m. Within half a second after the detection the tip is off."""
    record = simulated(REAL, 13.5, *NEAR, f"surface.law.stiffness={stiffness}")
    safety = safety_of(record)
    assert safety["cause"] == "slope" and safety["off_wall"] and safety["off_wall_s"] < 0.5
    assert safety["largest_force"] < 25.0 and safety["seconds_above_limit"] == 0.0
    if seen:
        assert safety["stiffness"] == pytest.approx(seen, rel=0.3)
    model = record.model
    q = record.config[:, 6:]
    assert np.all(q < model.q_upper) and np.all(q > model.q_lower)
    assert np.all(np.abs(record.zeta[:, 6:]) < 1.1 * model.joint_speed)
    assert "stiffer than declared" in safety["text"] and "asked are 20" in safety["text"]
    assert record.summary()["tube"]["exits"] == 0


@pytest.mark.slow
@pytest.mark.parametrize(("scenario", "seconds"), [
    (REAL, 5.0), pytest.param("girona500_contact", 7.5, marks=pytest.mark.long)])
def test_without_a_trip_a_run_is_the_same_to_the_bit(scenario, seconds):
    """Through hover and approach, and a touch with an ideal wrench."""
    one, other = (simulated(scenario, seconds, HOVERS, *more) for more in ((), (OFF,)))
    assert one.trip == np.inf and "safety" not in other.signals
    for field in dataclasses.fields(other):
        value = getattr(other, field.name)
        if isinstance(value, np.ndarray) and "seconds" not in field.name:
            np.testing.assert_array_equal(getattr(one, field.name), value, err_msg=field.name)


class Failure(Exception):
    """Of a law."""


@pytest.mark.slow
@pytest.mark.parametrize("fails", [
    "raises", pytest.param("is not finite", marks=pytest.mark.long)])
def test_a_law_that_fails_is_a_cause_and_not_the_end(monkeypatch, fails):
    """From 4.5 s on; it trips within two ticks of the clock, and nothing ends."""
    command = TipFirst.command
    calls = []

    def failing(self, model, now, *rest):
        if "q1" in self.rows:
            return command(self, model, now, *rest)
        calls.append(None)
        if len(calls) > 250:
            if fails == "raises":
                raise Failure
            return np.full(model.size, np.nan)
        return command(self, model, now, *rest)

    monkeypatch.setattr(TipFirst, "command", failing)
    record = uv.simulate(uv.load_scenario(REAL, ["duration=7", *NEAR]))
    safety = safety_of(record)
    assert safety["cause"] == "raised" and len(calls) <= 254
    assert safety["distance"] == pytest.approx(0.2, abs=0.15)
    assert np.all(np.isfinite(record.tau))


@pytest.mark.long
def test_a_planner_that_raises_for_ever_is_noticed_before_its_plan_is_too_old(monkeypatch):
    from uvms_drake.control.mpc.planner import Planner

    again = Planner.again

    def failing(self, sample, memory):
        if sample.time > 4.5:
            raise Failure
        return again(self, sample, memory)

    monkeypatch.setattr(Planner, "again", failing)
    record = uv.simulate(uv.load_scenario(REAL, ["duration=8", HOVERS]))
    assert safety_of(record)["cause"] == "plan"
    assert record.trip < 4.4 + 15 * 0.2


@pytest.mark.long
def test_a_lost_state_is_a_cause_after_which_nothing_pushes():
    """Half a second later the reference rests where the plan was, and so does the command."""
    record = simulated(REAL, 13.0, *NEAR, "faults=[!LostState {start: 5.0, duration: 99}]")
    assert safety_of(record)["cause"] == "fix" and 5.4 < record.trip < 5.7
    after = record.time > record.trip + 0.1
    assert np.max(np.abs(record.tau[after, 0])) < 20.0


@pytest.mark.long
def test_a_gap_of_the_fixes_is_a_cause_in_contact():
    record = simulated(REAL, 15.0, *NEAR, "faults=[!LostFixes {start: 13.0, duration: 5}]")
    safety = safety_of(record)
    assert safety["cause"] == "fix" and 13.4 < record.trip < 13.6
    assert safety["largest_force"] < 20.0 and safety["off_wall_s"] < 0.6


def test_a_mission_is_over_with_a_retreat():
    """Its step ends as retreated, and the others are left out."""
    steps = [Approach(), Hold(), Retreat()]
    mission = Mission(steps=steps).checked()
    state = begin(mission, np.zeros(3), 0.0)
    after, due = advance(mission, state, Measured(np.zeros(3), 0.0, touched=False, retreated=True),
                         1.0)
    assert after.outcome == RETREATED and REASONS[after.reason] == "retreated"
    assert due.force == 0.0 and after.failures == 1


def test_a_mission_goes_on_with_the_next_spot_when_the_robot_is_given_back():
    """The spot at which the supervisor retreats is left out, and the tip stays where it is."""
    steps = [Approach(), Hold(), Retreat(), Approach(timeout=20.0), Retreat()]
    mission = Mission(steps=steps, on_retreat="skip").checked()
    state = begin(mission, np.zeros(3), 0.0)
    away = Measured(np.array([-0.3, 0.0, 0.0]), 0.0, touched=False, retreated=True)
    for t in (1.0, 2.0):
        state, due = advance(mission, state, away, t)
        assert state.step == 3 and state.waits and due.force == 0.0
    assert state.failures == 1 and list(state.outcomes[:3]) == [SKIPPED] * 3
    late, _ = advance(mission, state, away, 21.0)
    assert late.outcome == RETREATED
    state, due = advance(mission, state, away._replace(retreated=False), 5.0)
    assert not state.waits and state.since == 5.0 and due.deepest == -0.3
    state, _ = advance(mission, state, away._replace(retreated=False), 5.1)
    assert state.searching


def test_a_mission_tries_the_spot_again_but_not_at_a_wall_that_is_not_as_declared():
    """As often as `retries`, and never once its retreat is under way."""
    steps = [Approach(at=[0.1, 0.0]), Hold(), Retreat(), Approach(), Retreat()]
    mission = Mission(steps=steps, on_retreat="retry", retries=1).checked()
    near = Measured(np.array([-0.3, 0.1, 0.0]), 0.0, touched=False)
    pressing = near._replace(tip=np.array([0.01, 0.1, 0.0]), touched=True)

    def after(state, t, stiffer=False):
        """The state when the robot is given back after a retreat."""
        state, due = advance(mission, state, near._replace(retreated=True, stiffer=stiffer), t)
        assert state.waits and due.force == 0.0
        return advance(mission, state, near, t + 5.0)[0]

    begun, _ = advance(mission, begin(mission, near.tip, 0.0), pressing, 1.0)
    held = advance(mission, begun, pressing, 1.5)[0]._replace(
        step=1, outcomes=(DONE, *[RUNNING] * 4))
    again = after(held, 2.0)
    assert (again.step, again.tries, again.failures) == (0, 1, 1) and not again.waits
    assert list(again.outcomes) == [RUNNING] * 5 and list(again.place) == [0.1, 0.0]
    second = after(again, 10.0)
    assert second.step == 3 and list(second.outcomes) == [SKIPPED] * 3 + [RUNNING] * 2
    stiff = after(held, 2.0, stiffer=True)
    assert stiff.step == 3 and list(stiff.outcomes) == [DONE, SKIPPED, SKIPPED, RUNNING, RUNNING]
    leaving = after(held._replace(step=2, outcomes=(DONE, DONE, *[RUNNING] * 3)), 2.0)
    assert leaving.step == 3 and leaving.tries == 0


def supervised_on_the_last_spot():
    """A mission, and its state at the retreat of the supervisor, at a depth of 0.01 m."""
    mission = Mission(steps=[Approach(), Hold(), Retreat()], on_retreat="skip").checked()
    pressing = Measured(np.array([0.01, 0.0, 0.0]), 0.0, touched=True)
    state = begin(mission, np.array([-0.1, 0.0, 0.0]), 0.0)
    state, _ = advance(mission, state, pressing, 1.0)
    assert state.searching and state.deepest > 0.01
    return mission, state, pressing._replace(retreated=True)


def test_after_the_retreat_of_its_last_spot_a_mission_does_not_ask_for_the_robot():
    mission, state, retreating = supervised_on_the_last_spot()
    for t, depth in ((2.0, 0.01), (3.0, -0.3)):
        state, due = advance(mission, state, retreating._replace(
            tip=np.array([depth, 0.0, 0.0])), t)
        assert state.outcome == SKIPPED and not state.waits
        assert due.force == 0.0 and due.deepest == 0.01
    assert list(state.outcomes) == [SKIPPED] * 3 and REASONS[state.reason] == "retreated"


def test_after_a_time_out_of_the_wait_a_mission_does_not_ask_for_the_robot():
    steps = [Approach(), Hold(), Retreat(), Approach(timeout=20.0), Retreat()]
    mission = Mission(steps=steps, on_retreat="skip").checked()
    away = Measured(np.array([-0.3, 0.0, 0.0]), 0.0, touched=False, retreated=True)
    state, _ = advance(mission, begin(mission, np.zeros(3), 0.0), away, 1.0)
    assert state.waits
    state, due = advance(mission, state, away, 21.0)
    assert state.outcome == RETREATED and not state.waits and due.deepest == -0.3


@pytest.mark.parametrize("pressed", [0.5, 1.0, 2.0, 3.0])
def test_a_stop_that_is_pressed_and_released_while_the_supervisor_retreats_is_the_end(pressed):
    """Before, at its trip, while the mission waits, and when the robot is given back at 3 s."""
    steps = [Approach(), Hold(), Retreat(), Approach(), Retreat()]
    mission = Mission(steps=steps, on_retreat="skip").checked()
    away = Measured(np.array([-0.3, 0.0, 0.0]), 0.0, touched=False)
    state = begin(mission, np.zeros(3), 0.0)
    for t in (*([pressed] if pressed < 1.0 else []), 1.0, 2.0, 3.0, 4.0, 5.0):
        tip = away.tip - [0.5 * (t > 3.0), 0.0, 0.0]  # The mission's own retreat is followed.
        state, due = advance(mission, state, away._replace(
            tip=tip, retreated=1.0 <= t < 3.0, stop=t == pressed), t)
        assert due.force == 0.0
    assert state.outcome == RETREATED and REASONS[state.reason] == "stopped" and not state.waits


def test_the_robot_is_given_back_only_after_it_has_stood_with_all_as_declared(model, settings):
    """Never after the law has failed."""
    def seconds(seen, cause, count):
        now = tripped(settings, model)
        now = now._replace(safety=np.array([STANDING, cause, 8.0, np.nan, 0.0]))
        for k in range(int(count / 0.02)):
            now = updated(now, seen._replace(time=9.0 + 0.02 * k), back, LIMITS, settings, model)
        return now.safety[0]

    back = START - np.append(0.28, np.zeros(9))
    asked, slope = QUIET._replace(resume=True, force=0.0), list(CAUSES).index("slope") + 1.0
    assert seconds(asked, slope, 3.2) == WATCHING
    assert seconds(asked, slope, 2.8) == STANDING == seconds(QUIET, slope, 3.2)
    assert seconds(asked._replace(drift=np.full(6, 0.06)), slope, 3.2) == STANDING
    assert seconds(asked, list(CAUSES).index("raised") + 1.0, 3.2) == STANDING


def test_the_time_for_which_all_is_well_begins_again_after_a_lost_state(model, settings):
    """Lost at each other update, it never stands for long enough."""
    back = START - np.append(0.28, np.zeros(9))
    for every, mode in ((2, STANDING), (10**6, WATCHING)):
        now = tripped(settings, model)._replace(safety=np.array([STANDING, 2.0, 8.0, np.nan, 0.0]))
        for k in range(1, 400):
            tip = np.full(3, np.nan) if k % every == 0 else QUIET.tip
            seen = QUIET._replace(time=9.0 + 0.02 * k, resume=True, force=0.0, tip=tip)
            now = updated(now, seen, back, LIMITS, settings, model)
            if now.safety[0] == WATCHING:
                break
        assert now.safety[0] == mode


@pytest.fixture(scope="module")
def thrusters(model):
    return ThrusterModel.of(model.thrusters)


def test_a_thruster_is_isolated_if_it_alone_explains_what_disturbs_the_vehicle(model, thrusters):
    """By the acceleration that it makes, which the observer sees; a current is none."""
    def seen(wrench):
        zeta = np.linalg.solve(model.mass_matrix(model.kinematics(START)),
                               np.append(wrench, np.zeros(4)))
        return wrench_of(model, START, (configuration_rate_matrix(START) @ zeta)[:6])

    for i, name in enumerate(thrusters.names):
        wrench = 30.0 * thrusters.B[:, i]
        np.testing.assert_allclose(seen(wrench), wrench, atol=1e-9)
        found = 0 if name == "sway" else i + 1  # No other one drives the sway.
        assert faulty_thruster(thrusters, seen(wrench)) == found
        assert faulty_thruster(thrusters, seen(-wrench)) == found
        assert faulty_thruster(thrusters, 0.2 * wrench) == 0
    for axis in range(3):
        assert faulty_thruster(thrusters, 60.0 * np.eye(6)[axis]) == 0


@pytest.mark.parametrize(("cause", "changes", "seconds", "isolated"), [
    ("drift", {}, 0.2, 1), ("drift", {}, 0.06, 0), ("joints", {}, 0.2, 1), ("slope", {}, 0.2, 0),
    ("drift", {"force": np.nan}, 0.2, 0), ("drift", {"saturated": True}, 0.2, 0),
    ("drift", {"lost_time": 0.02}, 0.2, 0)])
def test_a_thruster_is_isolated_after_a_drift_or_a_deviation_if_it_is_the_same_for_a_while(
        model, settings, thrusters, cause, changes, seconds, isolated):
    """While the force is read: one that is missed would be in the wrench."""
    wrench = np.append(30.0 * thrusters.B[:, 0], np.zeros(4))
    zeta = np.linalg.solve(model.mass_matrix(model.kinematics(START)), wrench)
    drift = (configuration_rate_matrix(START) @ zeta)[:6]
    settings = settings._replace(thrusters=thrusters)

    def after(of_drift):
        now = tripped(settings, model)._replace(
            safety=np.array([RETREATING, list(CAUSES).index(cause) + 1.0, 8.98, np.nan, 0.0]))
        for k in range(int(seconds / 0.02)):
            now = updated(now, QUIET._replace(time=9.0 + 0.02 * k, drift=of_drift(k), **changes),
                          START, LIMITS, settings, model)
        return now.safety[4]

    assert after(lambda k: drift) == isolated
    assert after(lambda k: drift * (k % 4 > 0)) == 0  # Found for 0.06 s at a time.
    assert after(lambda k: 0.5 * drift) == 0  # Not above the threshold of the drift.


@pytest.mark.parametrize(("changes", "rise", "mode", "isolated"), [
    ({}, 0.0, STANDING, 1), ({}, 2.0, STANDING, 0), ({}, 0.0, RETREATING, 0),
    ({"fix_age": 1.0}, 0.0, STANDING, 0), ({"force": 10.0}, 0.0, STANDING, 0)])
def test_a_thruster_that_sticks_long_after_the_trip_is_isolated_too(
        model, settings, thrusters, changes, rise, mode, isolated):
    """After a trip by a slope, while it stands: after a small drift, none that rises slowly."""
    wrench = np.append(30.0 * thrusters.B[:, 0], np.zeros(4))
    zeta = np.linalg.solve(model.mass_matrix(model.kinematics(START)), wrench)
    drift = (configuration_rate_matrix(START) @ zeta)[:6]
    drift *= 1.4 * LIMITS.drift[0] / np.linalg.norm(drift[:3])
    seen = QUIET._replace(**{"force": 0.0} | changes)
    now = tripped(settings, model)._replace(
        start=START[:3] + (mode == STANDING) * settings.distance * settings.direction,
        safety=np.array([mode, list(CAUSES).index("slope") + 1.0, 8.98, np.nan, 0.0]))
    for time in 20.0 + 0.02 * np.arange(200):
        share = 0.0 if time < 21.0 else 0.6 if time < 21.0 + rise else 1.0
        now = updated(now, seen._replace(time=time, drift=share * drift), START, LIMITS,
                      settings._replace(thrusters=thrusters), model)
    assert (now.safety[0], now.safety[4]) == (mode, isolated)


def test_a_thruster_that_explained_the_drift_before_the_trip_is_isolated_with_it(
        model, settings, thrusters):
    """A ratio of 0.9 for 0.1 s, then one above one; none for a current with that drift."""
    def safety(wrench, before=None):
        zeta = np.linalg.solve(model.mass_matrix(model.kinematics(START)),
                               np.append(wrench, np.zeros(4)))
        drift = (configuration_rate_matrix(START) @ zeta)[:6]
        drift *= 0.9 * LIMITS.drift[0] / np.linalg.norm(drift[:3])
        now = initial_watch(10)
        now = now if before is None else now._replace(safety=before)
        for k in range(8):
            now = updated(now, QUIET._replace(time=9.0 + 0.02 * k, drift=(1.0 + 0.4 * (k == 7)) * (
                drift)), START, LIMITS, settings._replace(thrusters=thrusters), model)
            assert (now.safety[0] == RETREATING) == (k == 7)
        return now.safety

    assert list(CAUSES)[int(safety(thrusters.B[:, 0])[1]) - 1] == "drift"
    assert safety(thrusters.B[:, 0])[4] == 1 and safety(np.eye(6)[0])[4] == 0
    # It watches again after a trip at 1 s, of which cause and instant are kept.
    resumed = np.array([WATCHING, 2.0, 1.0, np.nan, 0.0])
    assert safety(thrusters.B[:, 0], resumed)[4] == 1


def test_without_a_thruster_the_others_give_the_wrench_but_for_an_axis_that_they_do_not_drive(
        thrusters):
    allocation, wrench = Allocation.to(thrusters), np.array([20.0, 5.0, -10.0, 0.0, 3.0, 40.0])
    for isolated, given_up in ((0, 5), (2, 4)):
        others = allocation.others[isolated]
        assert list(others.thrusters.undriven) == [3, given_up]
        moved = thrusters.B @ allocation.forces_without(isolated + 1, wrench)
        np.testing.assert_allclose(np.delete(moved - wrench, [3, given_up]), 0.0, atol=1e-9)


def test_a_thruster_without_power_gets_no_command_whatever_its_fault(thrusters):
    system = PowerCut(thrusters)
    context = system.CreateDefaultContext()
    command = np.linspace(-0.5, 0.5, 5)
    system.GetInputPort("command").FixValue(context, command)
    for isolated in (0, 2):
        system.GetInputPort("safety").FixValue(context, [1.0, 1.0, 0.0, np.nan, isolated])
        powered = system.get_output_port().Eval(context)
        expected = command.copy()
        if isolated:
            expected[1] = thrusters.curves[1].command_of(0.0)
        np.testing.assert_allclose(powered, expected)


def test_what_is_declared_counts_for_the_threshold_of_drift(model):
    """A robot that is 2 % too light, or holds a payload, is not driven away by the water."""
    base = thresholds_of(uv.load_scenario(REAL), model).drift
    for change, index in (("model_error.buoyancy=1.02", 0), ("model_error.payload.mass=0.5", 0),
                          ("actuation.1.error=[0.1]", 0)):
        assert thresholds_of(uv.load_scenario(REAL, [change]), model).drift[index] > 1.05 * base[
            index]
    # Unknowns are of either sign: one does not take from what another one adds.
    heavy = "model_error.payload.mass=1.0"
    alone, both = (thresholds_of(uv.load_scenario(REAL, [heavy, *more]), model).drift
                   for more in ([], ["model_error.buoyancy_shift=[0.005, 0, 0]"]))
    assert both[1] > 1.5 * alone[1]
    known = thresholds_of(uv.load_scenario(REAL, ["supervisor.drift=[0.5, 0.6]"]), model)
    np.testing.assert_array_equal(known.drift, [0.5, 0.6])


@pytest.mark.parametrize("period", [3.0, 6.0])
def test_a_wave_accelerates_the_robot_by_no_more_than_its_part_of_the_drift(period, model):
    """The simulated one, at rest in the wave; most of it is the pressure of accelerating water."""
    wave = Wave(amplitude=0.2, period=period, direction=0.7)
    largest = wave_accelerations(model, START, wave)
    plant = uv.make_uvms_plant(
        "girona500_arm5e", surface=uv.UnilateralPlane(point=np.array([99.0, 0.0, 0.0])),
        disturbance=uv.disturbances.ConstantDisturbance(bound=0.0))
    context = plant.CreateDefaultContext()
    uv.set_state(plant, context, np.append(START, np.zeros(10)))
    found = []
    for motion in [2 * (np.zeros(3),), *map(wave.motion, np.linspace(0.0, period, 25))]:
        for name, value in zip(("current", "current_acceleration"), motion, strict=True):
            plant.GetInputPort(name).FixValue(context, value)
        found.append(plant.GetOutputPort("acceleration").Eval(context).copy())
    linear, angular = np.max([norms(each - found[0]) for each in found], axis=0)
    assert 0.9 * largest[0] < linear < 1.05 * largest[0]
    assert 0.5 * largest[1] < angular < 1.05 * largest[1]
    assert linear > 0.9 * wave.speed * wave.frequency


def test_a_command_that_a_limit_cuts_is_cut_to_the_thrusters_as_any_other(
        model, settings, thrusters):
    """After a trip far off the reference, and with a limit of one joint that cuts, too."""
    far = np.concatenate([[RETREATING, 0.0], START + np.append(5.0, np.zeros(9)), np.zeros(10)])
    allocation, forces = Allocation.to(thrusters), []
    for limits in (None, uv.limits.Limits(u=np.append(np.full(9, 1e3), 1e-6))):
        system = AncillaryFeedback(model, uv.load_scenario(REAL).ancillary, limits, settings,
                                   allocation)
        context, rest = system.CreateDefaultContext(), np.append(START, np.zeros(10))
        for name, value in (
                ("state", rest), ("nominal_state", rest), ("nominal_acceleration", np.zeros(10)),
                ("nominal_input", np.zeros(10)), ("force_measured", np.zeros(6)),
                ("vehicle_wrench", np.zeros(6)), ("retreat", far)):
            system.GetInputPort(name).FixValue(context, value)
        forces.append(system.GetOutputPort("tau").Eval(context)[:6].copy())
        assert system.GetOutputPort("limited").Eval(context)
    for force in forces:
        short = np.abs(allocation.shortfall(force)[thrusters.driven])
        assert np.all(short < 0.02 * allocation.largest)
    assert forces[0][0] > 100.0


@pytest.mark.long
def test_a_surge_thruster_that_sticks_is_cut_off_where_the_robot_can(tmp_path):
    """It pushes with 52 N from 13 s on, in contact."""
    robot = shutil.copytree(model_dir("girona500_arm5e"), tmp_path / "girona500_arm5e")
    (robot / "thrusters.yaml").write_text(
        "power_cut: true\n" + (robot / "thrusters.yaml").read_text("utf-8"), "utf-8")
    record = simulated(REAL, 20.0, *NEAR, f"model={robot}", "faults=[!StuckThruster "
                       "{thruster: surge_port, share: 0.5, start: 13.0}]")
    safety = safety_of(record)
    assert safety["isolated"] == "surge_port" and safety["held"] and safety["off_wall"]
    assert safety["largest_force"] < 25.0 and safety["speed"] < 0.05
    after = record.config[record.time >= record.trip, :3]
    assert np.max(np.abs(after[:, 1:] - after[0, 1:])) < 0.02
    assert np.max(after[:, 0]) - after[0, 0] < 0.05  # 0.06 m from where it was at 13 s.
