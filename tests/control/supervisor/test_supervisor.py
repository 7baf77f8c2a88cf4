"""Supervisor: detections and retreat as functions, and runs that leave their class."""

import dataclasses

import numpy as np
import pytest
from support.refusals import refusals
from support.runs import simulated

import uvms_drake as uv
from uvms_drake.control.feedback.ancillary import AncillaryFeedback
from uvms_drake.control.laws.tip_first import TipFirst
from uvms_drake.control.supervisor.detections import (
    CAUSES,
    Seen,
    Thresholds,
    force_excess,
    ratios,
    stiffness_of_touch,
)
from uvms_drake.control.supervisor.retreat import (
    LEASH,
    MARGIN,
    RETREATING,
    STANDING,
    RetreatSettings,
    allowed_acceleration,
    begun,
    filtered_torque,
    moved,
    stands,
)
from uvms_drake.control.supervisor.supervisor import initial_watch, updated
from uvms_drake.mission.law import REASONS, RETREATED, Measured, advance, begin
from uvms_drake.mission.steps import Approach, Hold, Mission, Retreat
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.station.problem import load_model
from uvms_drake.station.safety import retreat_sentence
from uvms_drake.station.supervision import thresholds_of

LIMITS = Thresholds(
    force=40.0, slope=8.0, walls=SurfaceClass(stiffness=1000.0), touch=3.0, depth_error=0.002,
    off=np.array([0.01, 0.1, 0.05]), fix=0.5, drift=np.array([0.05, 0.06]), cut=0.3, plan=2.6,
    lost=1.0, begin=4.0)
QUIET = Seen(time=9.0, tip=np.array([0.01, 0.0, 0.0]), force=10.0, saturated=False,
             off=np.zeros(3), drift=np.zeros(6), fix_age=0.1, raised=False, cut_time=0.0,
             plan_age=0.2, lost_time=0.0)
NOTHING = np.zeros((0, 5))
REAL, ON = "girona500_real_loop", "supervisor={}"
NEAR = "start.eta.0=-1.10"
"""The tip 0.09 m off the wall: it touches 12 s after the start."""


@pytest.mark.parametrize(("cause", "changes"), [
    ("force", {"force": 40.1}), ("force", {"saturated": True, "force": np.nan}),
    ("tip", {"off": np.array([0.011, 0.0, 0.0])}), ("joints", {"off": np.array([0.0, 0.11, 0.0])}),
    ("vehicle", {"off": np.array([0.0, 0.0, 0.051])}), ("fix", {"fix_age": 0.51}),
    ("drift", {"drift": np.array([0.04, 0.04, 0, 0, 0, 0])}),
    ("drift", {"drift": np.array([0, 0, 0, 0, 0, 0.061])}), ("raised", {"raised": True}),
    ("cut", {"cut_time": 0.31}), ("plan", {"plan_age": 2.61}), ("force_lost", {"lost_time": 1.01})])
def test_each_detection_is_above_one_for_its_own_cause_alone(cause, changes):
    assert (ratios(QUIET, NOTHING, LIMITS) <= 1.0).all()
    found = ratios(QUIET._replace(**changes), NOTHING, LIMITS)
    assert [name for name, ratio in zip(CAUSES, found, strict=True) if ratio > 1.0] == [cause]


def test_while_the_robot_hovers_no_plan_is_followed():
    hovering = QUIET._replace(time=3.9, off=np.ones(3), plan_age=3.9)
    assert (ratios(hovering, NOTHING, LIMITS) <= 1.0).all()


@pytest.mark.parametrize(("stiffness", "trips"), [(900.0, False), (1050.0, False), (4000.0, True)])
def test_only_a_wall_that_is_stiffer_than_declared_has_an_excess(stiffness, trips):
    """The tip goes 20 mm deep, back and deeper; readings are off by 1.5 N and 1 mm."""
    rng = np.random.default_rng(3)
    depth = np.concatenate([np.linspace(0, 0.02, 40), np.linspace(0.02, 0.01, 20),
                            np.linspace(0.01, 0.024, 30)])
    force = stiffness * depth + rng.uniform(-1.5, 1.5, 90)
    seen = depth + rng.uniform(-0.001, 0.001, 90)
    tips = np.outer(seen, [1.0, 0.0, 0.0])
    rows = np.column_stack([np.arange(90) * 0.02, tips, force])
    excess = max(force_excess(rows[max(i - 50, 0):i], tips[i], force[i], LIMITS)
                 for i in range(1, 90))
    assert (excess > LIMITS.slope) is trips


@pytest.mark.parametrize(("declared", "trips"), [(5.0, False), (0.0, True)])
def test_a_tip_that_slides_on_a_tilted_wall_of_the_class_is_none(declared, trips):
    """5 mm along a wall of 50 kN/m at 5°, at a constant depth n·𝔭: by tan 5° into it."""
    limits = LIMITS._replace(walls=SurfaceClass(stiffness=5e4, angle=np.deg2rad(declared)))
    tips = np.column_stack([np.zeros(30), np.linspace(0.0, 0.005, 30), np.zeros(30)])
    force = 20.0 + 5e4 * (tips @ [np.cos(np.deg2rad(5)), np.sin(np.deg2rad(5)), 0.0]) * np.cos(
        np.deg2rad(5))
    rows = np.column_stack([np.arange(30) * 0.02, tips, force])
    assert (force_excess(rows, tips[-1], force[-1], limits) > LIMITS.slope) is trips


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
    """With the joints within their speeds: the tip by 40 mm more than the vehicle."""
    now, last = begun(settings, START, touched=True), None
    for _ in range(400):
        last, now = now, moved(settings, model, now, now.config, 0.01, None)
        assert np.all(np.abs(now.rate[6:]) <= 0.8 * model.joint_speed + 1e-9)
        np.testing.assert_allclose(now.config, last.config + 0.01 * now.rate, atol=1e-12)
    np.testing.assert_allclose(now.config[:3] - START[:3], [-0.3, 0.0, 0.0], atol=1e-9)
    tip = model.task_pose(now.config)[:3] - model.task_pose(START)[:3]
    assert tip[0] == pytest.approx(-0.34, abs=0.006)
    assert not now.rate.any()
    untouched = begun(settings, START, touched=False)
    np.testing.assert_array_equal(moved(settings, model, untouched, START, 0.01, None).config[6:],
                                  START[6:])


def test_the_reference_stays_on_the_leash_of_a_vehicle_that_drifts(model, settings):
    now = begun(settings, START, touched=False)
    drifted = START + np.append([0.6, 0.8, 0.0], np.zeros(7))
    after = moved(settings, model, now, drifted, 0.01, None)
    assert np.linalg.norm(after.config[:3] - drifted[:3]) == pytest.approx(LEASH)


def test_a_vehicle_that_does_not_move_has_not_retreated_and_one_pushed_back_does_so_again(
        model, settings):
    """The goal stays 0.3 m back from the trip; the reference leads by the leash at most."""
    def for_seconds(now, config, seconds):
        for _ in range(int(seconds / 0.02)):
            now = moved(settings, model, now, config, 0.02, None)
        return now

    def at(x):
        return START + np.append(x, np.zeros(9))

    still = for_seconds(begun(settings, START, touched=False), START, 5.0)
    np.testing.assert_allclose(still.left, [0.3, 0.0])
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


def tripped(settings):
    """Memory 1 s after a trip at START, with the reference on its way."""
    first = begun(settings, START, touched=True)
    return initial_watch(10)._replace(
        safety=np.array([RETREATING, 1.0, 8.0, np.nan]), **first._replace(
            rate=np.full(10, 0.01), left=np.array([0.2, 0.01]))._asdict(),
        clocks=np.array([8.98, -np.inf, 8.98, 8.98, 0.0, 0.0, 0.0]))


def test_while_the_state_is_lost_the_retreat_rests_and_nothing_counts_as_distance(model, settings):
    before = tripped(settings)
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
    retreat = np.concatenate([[RETREATING], away, np.full(10, 0.05)])
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
        [[mode], START + np.append(np.zeros(9), 3.0), np.zeros(10)]), state, np.zeros(6))
        for mode in (0, RETREATING))
    alone = feedback_of(model, None, np.zeros(21), state, np.zeros(6))
    np.testing.assert_array_equal(watching["tau"], alone["tau"])
    assert not watching["filtered"] and retreating["filtered"]
    at, still = model.kinematics(state[:10]), np.zeros(10)
    assert filtered_torque(settings, model.mass_matrix(at), model.inverse_dynamics(
        at, still, still, np.zeros(6)), alone["tau"], alone["tau"][:6], state[6:10], still[6:])[1]


def test_the_bow_turns_the_short_way(model, settings):
    now = begun(settings, START, touched=False)
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
    assert small.slope >= 2.0 * 3.0 * 0.1 and small.force < 47.0 - 0.3


def test_thresholds_follow_the_declared_numbers(model):
    """A larger declared error, gap, flow and tube allow for more."""
    base = thresholds_of(uv.load_scenario(REAL), model)
    assert base.force == pytest.approx(47.0 - 5.5)
    for change, name in (("contact.force_error=6.0", "slope"), ("sensing.0.dvl.gap=0.6", "fix"),
                         ("current=[0.2,0,0]", "drift"), ("tube.position=0.009", "off"),
                         ("mpc.horizon=17", "plan"), ("disturbance.bound=0.05", "drift")):
        other = thresholds_of(uv.load_scenario(REAL, [change]), model)
        larger = [field for field in Thresholds._fields if field != "walls" and np.any(
            np.asarray(getattr(other, field)) > np.asarray(getattr(base, field)) + 1e-9)]
        assert name in larger


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
@pytest.mark.parametrize(("stiffness", "seen"), [(3500.0, 3500.0), (14000.0, None)])
def test_a_wall_5_or_20_times_as_stiff_is_left_at_once(stiffness, seen):
    """Declared are 1 kN/m. Within half a second after the detection the tip is off."""
    record = simulated(REAL, 13.5, NEAR, ON, f"surface.law.stiffness={stiffness}")
    safety = safety_of(record)
    assert safety["cause"] == "slope" and safety["off_wall"] and safety["off_wall_s"] < 0.5
    assert safety["largest_force"] < 25.0 and safety["seconds_above_limit"] == 0.0
    if seen:
        assert safety["stiffness"] == pytest.approx(seen, rel=0.3)
    model = record.model
    q = record.config[:, 6:]
    assert np.all(q < model.q_upper) and np.all(q > model.q_lower)
    assert np.all(np.abs(record.zeta[:, 6:]) < 1.1 * model.joint_speed)
    assert "stiffer than declared" in retreat_sentence(safety)
    assert record.summary()["tube"]["exits"] == 0


@pytest.mark.slow
def test_without_a_trip_a_run_is_the_same_to_the_bit():
    """Through hover and approach; with the contact it was compared over the whole run by hand."""
    one, other = (simulated(REAL, 5.0, *more) for more in ((ON,), ()))
    assert one.trip == np.inf and "safety" not in other.signals
    for field in dataclasses.fields(other):
        value = getattr(other, field.name)
        if isinstance(value, np.ndarray) and "seconds" not in field.name:
            np.testing.assert_array_equal(getattr(one, field.name), value, err_msg=field.name)


class Failure(Exception):
    """Of a law."""


@pytest.mark.slow
@pytest.mark.parametrize("fails", ["raises", "is not finite"])
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
    record = uv.simulate(uv.load_scenario(REAL, ["duration=7", NEAR, ON]))
    safety = safety_of(record)
    assert safety["cause"] == "raised" and len(calls) <= 254
    assert safety["distance"] == pytest.approx(0.2, abs=0.15)
    assert np.all(np.isfinite(record.tau))


@pytest.mark.slow
def test_a_planner_that_raises_for_ever_is_noticed_before_its_plan_is_too_old(monkeypatch):
    from uvms_drake.control.mpc.planner import Planner

    again = Planner.again

    def failing(self, sample, memory):
        if sample.time > 4.5:
            raise Failure
        return again(self, sample, memory)

    monkeypatch.setattr(Planner, "again", failing)
    record = uv.simulate(uv.load_scenario(REAL, ["duration=8", ON]))
    assert safety_of(record)["cause"] == "plan"
    assert record.trip < 4.4 + 15 * 0.2


@pytest.mark.slow
def test_a_lost_state_is_a_cause_after_which_nothing_pushes():
    """Half a second later the reference rests where the plan was, and so does the command."""
    record = simulated(REAL, 13.0, NEAR, ON, "faults=[!LostState {start: 5.0, duration: 99}]")
    assert safety_of(record)["cause"] == "fix" and 5.4 < record.trip < 5.7
    after = record.time > record.trip + 0.1
    assert np.max(np.abs(record.tau[after, 0])) < 20.0


@pytest.mark.slow
def test_a_gap_of_the_fixes_is_a_cause_in_contact():
    record = simulated(REAL, 15.0, NEAR, ON, "faults=[!LostFixes {start: 13.0, duration: 5}]")
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
