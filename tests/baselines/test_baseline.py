"""Parts of every baseline: approach, integrals, gains and limit."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from support.baseline_press import ROBOT, run, task

import uvms_drake as uv
from uvms_drake.baselines.baseline import (
    BACK,
    BACK_SPEED,
    BASELINES,
    ApproachGains,
    Baseline,
    moved_reference,
    next_approach,
    read_gains,
    robots_with_gains,
)
from uvms_drake.baselines.law import PERIOD, Law, Measured, PressTask, Reference, integrated
from uvms_drake.baselines.prescribed_performance import (
    PrescribedPerformance,
    funnel,
    transformed,
)
from uvms_drake.baselines.shared_laws import ForceFeedforward, VehicleHold

X = np.array([1.0, 0.0, 0.0])


def test_the_reference_waits_advances_and_follows_the_touched_tip():
    gains, tip = ApproachGains(speed=0.03, wait=1.0, follow=4.0), np.array([0.2, 0.0, 0.0])
    assert moved_reference(gains, X, np.zeros(3), tip, np.zeros(3), False, 0.5)[1] == (
        pytest.approx(0.0))
    assert moved_reference(gains, X, np.zeros(3), tip, np.zeros(3), False, 2.0)[1] == (
        pytest.approx(0.03 * X))
    x, v = moved_reference(gains, X, np.zeros(3), tip, np.zeros(3), True, 2.0)
    assert v == pytest.approx(0.2 / 4.0 * X)
    assert x == pytest.approx(PERIOD * v)


AT_REST = np.array([0.0] * 9 + [np.inf])
"""A reference in free water, without a stop."""


@pytest.mark.parametrize(("largest", "read", "across", "stops"), [
    (30.0, 31.0, 0.0, True), (30.0, 29.0, 0.14, False), (30.0, 0.0, 0.16, True),
    (np.inf, 1e6, 1.0, False)])
def test_a_press_stops_above_its_largest_force_or_far_across(largest, read, across, stops):
    pressed = PressTask(X, np.zeros(3), np.zeros(3), task().posture, 20.0, largest)
    state = next_approach(ApproachGains(wait=0.0), pressed, AT_REST, np.array([0.2, across, 0.0]),
                          read, np.zeros(3), 5.0)
    assert np.isfinite(state[9]) == stops
    assert bool(state[7]) == (not stops and read > 1.0)


def test_a_stopped_press_goes_back_from_the_tip_stands_and_never_presses_again():
    pressed = PressTask(X, np.zeros(3), np.zeros(3), task().posture, 20.0, 30.0)
    gains, tip = ApproachGains(wait=0.0, speed=0.05), np.array([0.2, 0.1, 0.0])
    state = next_approach(gains, pressed, AT_REST, tip, 31.0, np.zeros(3), 5.0)
    assert state[:6] == pytest.approx([0.2 - BACK_SPEED * PERIOD, 0.1, 0.0, -BACK_SPEED, 0.0, 0.0])
    for _ in range(1000):
        state = next_approach(gains, pressed, state, tip, 25.0, np.zeros(3), 6.0)
    assert state[:3] == pytest.approx([-0.1, 0.1, 0.0], abs=BACK_SPEED * PERIOD)
    assert state[3:6] == pytest.approx(0.0) and state[7] == 0.0


@pytest.mark.parametrize("scenario", ["girona500_real_loop", "bluerov2_real_loop"])
def test_a_stop_goes_as_far_and_as_fast_as_the_retreat_of_the_supervisor(scenario):
    supervisor = uv.load_scenario(scenario).supervisor
    assert (supervisor.distance, supervisor.speed) == (BACK, BACK_SPEED)


@pytest.mark.parametrize("name", BASELINES)
def test_every_baseline_can_stop_before_a_touch_is_seen(name):
    gains = read_gains(ROBOT)
    baseline, simulator, context = pressing(BASELINES[name](gains), gains, largest=30.0)
    port = baseline.GetInputPort("force_measured")
    port.FixValue(context, np.zeros(6))
    simulator.AdvanceTo(3.0 * PERIOD)
    port.FixValue(context, np.concatenate([31.0 * X, np.zeros(3)]))
    simulator.AdvanceTo(9.0 * PERIOD)
    assert np.isfinite(context.get_discrete_state_vector().value()[9])
    assert baseline.GetOutputPort("reference").Eval(context)[7] == 0.0


def test_a_stop_clears_what_laws_remember_but_the_place_of_the_vehicle():
    class Counting(Constant):
        def updated(self, now, memory, limited):
            return memory + 1.0

    gains = read_gains(ROBOT)
    gains.approach = ApproachGains(wait=0.0, touch=1.0)
    laws = {"law": Counting(np.zeros(10)), "other": Counting(np.zeros(10))}
    baseline, simulator, context = pressing(laws, gains, largest=30.0)
    simulator.AdvanceTo(5.0 * PERIOD)
    force = baseline.GetInputPort("force_measured")
    force.FixValue(context, np.concatenate([31.0 * X, np.zeros(3)]))
    simulator.AdvanceTo(6.0 * PERIOD)
    assert list(context.get_discrete_state_vector().value()[-2:]) == [0.0, 0.0]
    kept = np.arange(6.0)
    np.testing.assert_array_equal(VehicleHold(gains.hold).stopped(kept), kept)
    np.testing.assert_array_equal(ForceFeedforward().stopped(np.array([20.0])), [0.0])
    assert baseline.GetOutputPort("memory").Eval(context) == 0.0


class Constant(Law):
    """The same command always; its memory is whether a limit cuts the sum."""

    memory = 1

    def __init__(self, command):
        self._command = np.array(command, dtype=float)

    def tau(self, now, memory):
        return self._command

    def updated(self, now, memory, limited):
        return np.array([float(limited)])


def pressing(laws, gains, largest=np.inf):
    """A baseline with its tip a decimetre in front of the place, touched by 5 N; its simulator."""
    model, pressed = uv.UvmsModel(uv.read_uvms(ROBOT)), replace(task(), largest=largest)
    baseline = Baseline(model, pressed, laws, gains)
    simulator = Simulator(baseline)
    context = simulator.get_mutable_context()
    config = model.configuration(np.concatenate([[0.1], np.zeros(5), pressed.posture]))
    baseline.GetInputPort("state").FixValue(
        context, np.concatenate([config, np.zeros(model.size)]))
    baseline.GetInputPort("force_measured").FixValue(
        context, np.concatenate([5.0 * X, np.zeros(3)]))
    simulator.Initialize()
    return baseline, simulator, context


def test_a_clone_of_a_context_keeps_its_touch():
    gains = read_gains(ROBOT)
    gains.approach = ApproachGains(wait=0.0, touch=1.0)
    baseline, simulator, context = pressing({"law": Constant(np.zeros(10))}, gains)
    port = baseline.GetOutputPort("reference")
    assert port.Eval(context) == pytest.approx(
        [0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 20.0, 0.0, 0.0], abs=1e-9)
    simulator.AdvanceTo(0.5)
    reference = port.Eval(context)
    assert reference[7] == 1.0
    again = Simulator(baseline, context.Clone())
    again.Initialize()
    assert np.array_equal(port.Eval(again.get_context()), reference)


def test_the_limit_cuts_tells_the_laws_and_leaves_an_undriven_axis_alone():
    gains, one, nothing = read_gains(ROBOT), np.zeros(10), np.zeros(10)
    gains.largest[:3] = [2.0, 0.0, 5.0]
    one[:2], nothing[1] = [1.5, 9.0], 1.0
    for laws, cut, limited in (
            ({"law": Constant(one), "other": Constant(nothing)}, 1.5, 0.0),
            ({"law": Constant(one), "other": Constant(one)}, 2.0, 1.0)):
        baseline, simulator, context = pressing(laws, gains)
        assert baseline.GetOutputPort("tau").Eval(context)[:2] == pytest.approx([cut, 0.0])
        assert baseline.GetOutputPort("input_limited").Eval(context) == limited
        simulator.AdvanceTo(0.1)
        assert baseline.GetOutputPort("memory").Eval(context) == limited


def test_a_place_that_jumps_is_reached_at_the_speed_across_and_not_passed():
    gains, place = ApproachGains(across=0.1, wait=0.0, speed=0.0), np.array([7.0, 0.0, 0.0015])
    x = np.zeros(3)
    x, v = moved_reference(gains, X, x, x, place, False, 1.0)
    assert v == pytest.approx([0.0, 0.0, 0.1])
    x, _ = moved_reference(gains, X, x, x, place, False, 1.0)
    assert x == pytest.approx([0.0, 0.0, 0.0015])  # Its depth is not used.


def test_an_integral_is_clamped_and_does_not_wind_up():
    assert integrated(np.array([0.0]), np.array([1.0]), 5.0, False) == pytest.approx(PERIOD)
    assert integrated(np.array([0.5]), np.array([1e3]), 0.6, False) == 0.6
    assert integrated(np.array([0.5]), np.array([1.0]), 0.6, True) == 0.5
    assert integrated(np.array([0.5]), np.array([-1.0]), 0.6, True) < 0.5


@pytest.mark.parametrize("robot", ["girona500_arm5e", "bluerov2_alpha5"])
def test_every_law_holds_either_robot_at_rest(robot):
    """Without contact and at its reference, τ is that of rest; told nothing, it is zero."""
    gains, model = read_gains(robot), uv.UvmsModel(uv.read_uvms(robot))
    posture = 0.5 * (model.q_lower + model.q_upper)
    at = PressTask(X, np.zeros(3), np.zeros(3), posture, 5.0)
    config = model.configuration(np.concatenate([np.zeros(6), posture]))
    still = np.zeros(model.size)
    rest = model.inverse_dynamics(model.kinematics(config), still, still, np.zeros(6))
    driven = gains.largest > 0.0
    for name, laws in BASELINES.items():
        baseline = Baseline(model, at, laws(gains), gains)
        simulator = Simulator(baseline)
        context = simulator.get_mutable_context()
        baseline.GetInputPort("state").FixValue(context, np.concatenate([config, still]))
        baseline.GetInputPort("force_measured").FixValue(context, np.zeros(6))
        simulator.Initialize()
        tau = baseline.GetOutputPort("tau").Eval(context)
        due = 0.0 * rest if name == "prescribed_performance" else np.clip(
            rest, -gains.largest, gains.largest)
        assert tau[driven] == pytest.approx(due[driven], abs=1e-9), name


def test_a_robot_without_gains_and_a_direction_of_no_unit_length_are_refused():
    assert set(robots_with_gains()) == {ROBOT, "bluerov2_alpha5"}
    with pytest.raises(uv.InvalidParameter, match="one with gains of the baselines"):
        read_gains("box_uvms")
    with pytest.raises(uv.InvalidParameter, match="a unit vector"):
        PressTask(2.0 * X, np.zeros(3), np.zeros(3), task().posture, 5.0)


# The impedance of the tip is the one that was asked for.


def test_the_tip_yields_as_the_stiffness_says_and_as_damped_as_stated():
    """A pull F moves the tip by F/K_d, along the step response of Λ ẍ + D ẋ + K x = F."""
    gains, pull = read_gains(ROBOT), 1.0  # N; the posture hardly changes.
    gains.approach.wait = 100.0  # The reference stands still, and so does the vehicle.
    gains.hold.k = gains.hold.sigma = 10.0
    press = run(BASELINES["impedance"](gains), gains, seconds=2.5, pull=pull)
    moved = np.array([now.x - press.now[0].x for now in press.now])
    due = pull / gains.impedance.stiffness
    assert moved[-1] == pytest.approx([due, 0.0, 0.0], abs=0.05 * due)
    first = press.now[0]
    J, M = first.J[:, 6:], first.M[6:, 6:]
    inverse = J @ np.linalg.solve(M, J.T)  # Λ⁻¹ of the arm.
    D = np.diag([gains.impedance.damping, *[gains.impedance.damping_across] * 2])
    x, v, step, due_step = np.zeros(3), np.zeros(3), 1e-3, []
    for _ in range(round(press.time[-1] / step) + 1):
        due_step.append(x)
        v = v + step * inverse @ (
            [pull, 0.0, 0.0] - gains.impedance.stiffness * x - D @ v)
        x = x + step * v
    due_step = np.array(due_step)[::20]
    assert moved[:, 0] == pytest.approx(due_step[: len(moved), 0], abs=0.05 * due)


@pytest.mark.long
@pytest.mark.parametrize("name", ["impedance", "admittance"])
def test_the_force_has_no_steady_error(name):
    gains = read_gains(ROBOT)
    press = run(BASELINES[name](gains), gains, seconds=6.0, depth=0.005)
    assert press.now[-1].force == pytest.approx(20.0, rel=0.02)


# Funnels are kept in the loop of the theory, whatever the gains; elsewhere exits are counted.


def of_theory(scale: float):
    """Returns gains for a wrench without limit on all axes, those of the law scaled."""
    gains = read_gains(ROBOT)
    gains.largest = np.full(10, 1e6)
    performance = gains.performance
    performance.velocity_gain[3] = performance.velocity_gain[5]
    for name in ("force_gain", "position_gain", "velocity_gain"):
        setattr(performance, name, scale * getattr(performance, name))
    return gains


@pytest.mark.long
@pytest.mark.parametrize(("scale", "gravity"), [(1.0, False), (3.0, False), (0.3, True)])
def test_no_funnel_is_left_in_continuous_time_without_limits(scale, gravity):
    """From contact, with f_d − f within ρ₀. Gains of 0.3 alone need a ξ beyond its clamp."""
    gains = of_theory(scale)
    laws = BASELINES["prescribed_performance_gravity"](gains) if gravity else {
        "law": PrescribedPerformance(gains.performance, 10)}
    press = run(laws, gains, seconds=1.2, depth=0.016, step=0.001)
    assert press.memory[-1, 0] == 0.0
    assert min(now.force for now in press.now) > 0.0


def test_an_exit_is_counted_once_and_the_command_stays_finite():
    law, model = PrescribedPerformance(read_gains(ROBOT).performance, 10), uv.UvmsModel(
        uv.read_uvms(ROBOT))
    pressed = task()
    config = model.configuration(np.concatenate([[0.01, 0.5, 0.0], np.zeros(3), pressed.posture]))
    now = Measured(model, pressed, 1.0, config, np.zeros(10), np.array([90.0, 0, 0, 0, 0, 0]),
                   Reference(np.zeros(3), np.zeros(3), 20.0, True, 0.0))
    first = law.updated(now, np.zeros(law.memory), False)
    assert first[0] >= 2.0 and first[1] == 1.0  # Of the force, and of the position.
    assert law.updated(now, first, False)[0] == first[0]
    assert np.all(np.isfinite(law.tau(now, first)))


def test_a_funnel_narrows_and_the_transformed_error_rises_without_bound_inside():
    assert funnel(3.0, 1.0, 2.0, 0.0) == 3.0
    assert funnel(3.0, 1.0, 2.0, 50.0) == pytest.approx(1.0)
    xi = np.array([0.0, 0.5, 0.9])
    assert transformed(xi, np.ones(3)) == pytest.approx(np.log((1 + xi) / (1 - xi)))
    assert np.all(np.isfinite(transformed(np.array([5.0, -5.0]), np.ones(2))))


# Sliding is reached, and the parallel composition has no steady error of the force.


@pytest.mark.long
@pytest.mark.parametrize(("name", "stiffness"), [
    ("sliding_decoupled", 1000.0), ("sliding_decoupled", 5000.0), ("sliding_coupled", 1000.0)])
def test_sliding_is_reached_and_the_force_is_exact(name, stiffness):
    gains = read_gains(ROBOT)
    if name == "sliding_coupled":  # Here no thruster lags: the gains of the decoupled law.
        gains.coupled.integral, gains.coupled.rate = gains.decoupled.integral, gains.decoupled.rate
    laws = BASELINES[name](gains)
    press = run(laws, gains, seconds=12.0, stiffness=stiffness, depth=15.0 / stiffness,
                step=0.01)
    law = laws["law"]
    reached = [np.max(np.abs(law.surface(now, memory))) <= law.gains.layer
               for now, memory in zip(press.now, press.memory, strict=True)]
    assert all(reached[-100:])
    assert press.now[-1].force == pytest.approx(20.0, rel=0.02)
