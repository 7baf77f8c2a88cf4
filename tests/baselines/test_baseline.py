"""Parts of every baseline: approach, integrals, gains and limit."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from support.baseline_press import ROBOT, task

from uvms_drake.baselines.baseline import (
    BASELINES,
    ApproachGains,
    Baseline,
    moved_reference,
    read_gains,
    robots_with_gains,
)
from uvms_drake.baselines.law import PERIOD, Law, PressTask, integrated
from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.uvms_model import UvmsModel, read_uvms

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


class Constant(Law):
    """The same command always; its memory is whether a limit cuts the sum."""

    memory = 1

    def __init__(self, command):
        self._command = np.array(command, dtype=float)

    def tau(self, now, memory):
        return self._command

    def updated(self, now, memory, limited):
        return np.array([float(limited)])


def pressing(laws, gains):
    """A baseline with its tip a decimetre in front of the place, touched by 5 N; its simulator."""
    model, pressed = UvmsModel(read_uvms(ROBOT)), task()
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
    gains, model = read_gains(robot), UvmsModel(read_uvms(robot))
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
    with pytest.raises(InvalidParameter, match="one with gains of the baselines"):
        read_gains("box_uvms")
    with pytest.raises(InvalidParameter, match="a unit vector"):
        PressTask(2.0 * X, np.zeros(3), np.zeros(3), task().posture, 5.0)
