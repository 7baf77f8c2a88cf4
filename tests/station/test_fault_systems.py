"""Tests of `uvms_drake.station.fault_systems`: each law and each system alone."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.nominal_mpc import DROPPED, FAILED, LATE, SOLVED
from uvms_drake.station.fault_systems import (
    FaultySensor,
    JointBrake,
    SolverFaults,
    brake_torque,
    sensed,
    solver_fault,
)
from uvms_drake.station.faults import (
    DroppedPeriod,
    FrozenState,
    LostState,
    SolverFailure,
    SolverTimeout,
    StuckJoint,
)

H = 0.2  # s


class Clock(LeafSystem):
    """Puts out (t, −t)."""

    def __init__(self):
        super().__init__()
        self.DeclareVectorOutputPort(
            "y", 2, lambda context, output: output.SetFromVector(
                [context.get_time(), -context.get_time()]))


def statuses(*faults, seed=0, count=20) -> list[int]:
    return [solver_fault(faults, seed, k, H) for k in range(count)]


@pytest.mark.parametrize(("kind", "status"), [
    (SolverFailure, FAILED), (SolverTimeout, LATE), (DroppedPeriod, DROPPED)])
def test_a_certain_fault_is_at_every_sample_of_its_time(kind, status):
    """[start, end), whatever the rounding of either."""
    assert statuses(kind()) == 20 * [status]
    assert statuses(kind(start=0.6, duration=1.0)) == (
        3 * [SOLVED] + 5 * [status] + 12 * [SOLVED])
    assert statuses(kind(start=3 * 0.1, duration=0.3)) == (  # 0.30000000000000004
        2 * [SOLVED] + [status] + 17 * [SOLVED])
    assert statuses(kind(probability=0.0)) == 20 * [SOLVED]


def test_a_random_fault_depends_on_seed_sample_and_kind_alone():
    failure = SolverFailure(probability=0.3)
    one = statuses(failure, count=2000)
    assert np.mean(one) == pytest.approx(0.3, abs=0.03)
    assert one[500:] == [solver_fault([failure], 0, k, H) for k in range(500, 2000)]
    assert statuses(failure, seed=1, count=100) != one[:100]
    timeout = statuses(SolverTimeout(probability=0.3), count=2000)
    both = np.mean((np.array(timeout) > 0) & (np.array(one) > 0))
    assert both == pytest.approx(0.09, abs=0.02), "independent of each other"


def test_of_two_faults_at_a_sample_the_one_that_comes_first_counts():
    assert statuses(SolverTimeout(), DroppedPeriod(), SolverFailure()) == 20 * [DROPPED]
    assert statuses(SolverTimeout(), SolverFailure()) == 20 * [FAILED]


def test_the_system_puts_out_the_fault_of_the_last_sample():
    system = SolverFaults([SolverFailure(start=0.4, duration=0.2), DroppedPeriod(start=1.0)], 0, H)
    context = system.CreateDefaultContext()
    assert context.num_total_states() == 0
    for time, expected in ((0.0, SOLVED), (2 * H, FAILED), (0.5, FAILED), (3 * H, SOLVED),
                           (5 * H, DROPPED), (49 * H, DROPPED)):
        context.SetTime(time)
        assert system.GetOutputPort("fault").Eval(context) == [expected]


@pytest.mark.parametrize(("seed", "period", "key"), [(-1, H, "seed"), (0, 0.0, "period")])
def test_seed_and_period_are_checked(seed, period, key):
    with pytest.raises(InvalidParameter, match=f"^{key} = "):
        SolverFaults([SolverFailure()], seed, period)


@pytest.mark.parametrize(("fault", "during"), [
    (LostState(1.0, 0.5), [np.nan, np.nan]), (FrozenState(1.0, 0.5), [7.0, 8.0])])
def test_a_sensor_measures_something_else_during_its_fault(fault, during):
    true, held = np.array([1.0, 2.0]), np.array([7.0, 8.0])
    for time in (0.0, 0.999, 1.5, 9.0):
        np.testing.assert_array_equal(sensed(fault, time, true, held), true)
    for time in (1.001, 1.499):
        np.testing.assert_array_equal(sensed(fault, time, true, held), during)


@pytest.mark.parametrize("start", [0.0, 1.0])
def test_a_frozen_sensor_holds_what_it_measured_at_the_start(start):
    """Also in a clone of the Context."""
    builder = DiagramBuilder()
    clock = builder.AddSystem(Clock())
    sensor = FaultySensor.AddToBuilder(
        builder, FrozenState(start, 0.5), true=clock.get_output_port())
    diagram = builder.Build()
    simulator = Simulator(diagram)

    def measured(context):
        return sensor.GetOutputPort("measured").Eval(sensor.GetMyContextFromRoot(context))

    for time in (start, start + 0.25, start + 0.49):
        simulator.AdvanceTo(time)
        np.testing.assert_allclose(measured(simulator.get_context()), [start, -start], atol=1e-12)
    other = Simulator(diagram, simulator.get_context().Clone())
    for each in (simulator, other):
        each.Initialize()
        np.testing.assert_allclose(measured(each.get_context()), [start, -start], atol=1e-12)
        each.AdvanceTo(start + 0.75)
        np.testing.assert_allclose(measured(each.get_context()), [start + 0.75, -start - 0.75])


def test_a_brake_is_critically_damped():
    """Both eigenvalues of q̈ = torque / inertia."""
    A = np.array([[0.0, 1.0], [brake_torque(1.0, 1.0, 0.0), brake_torque(1.0, 0.0, 1.0)]])
    np.testing.assert_allclose(np.linalg.eigvals(A), [-20.0, -20.0], atol=1e-4)
    assert brake_torque(3.0, 0.1, 0.2) == pytest.approx(3.0 * brake_torque(1.0, 0.1, 0.2))


def test_a_stuck_joint_gets_the_brakes_torque_and_the_others_the_commanded_one(model, states):
    state, tau = states["free"][0].copy(), np.arange(1.0, 11.0)
    builder = DiagramBuilder()
    commanded = builder.AddSystem(ConstantVectorSource(tau))
    true = builder.AddSystem(ConstantVectorSource(state))
    brake = JointBrake.AddToBuilder(
        builder, model, StuckJoint(joint=2, start=0.5), commanded=commanded.get_output_port(),
        state=true.get_output_port())
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()

    def put_out():
        return brake.GetOutputPort("tau").Eval(brake.GetMyContextFromRoot(context))

    simulator.AdvanceTo(0.4)
    np.testing.assert_array_equal(put_out(), tau)
    simulator.AdvanceTo(0.6)
    moved = state.copy()
    moved[8] += 0.01
    true.get_mutable_source_value(true.GetMyMutableContextFromRoot(context)).set_value(moved)
    inertia = model.mass_matrix(model.kinematics(moved[:10]))[8, 8]
    expected = tau.copy()
    expected[8] = brake_torque(inertia, 0.01, state[18])
    np.testing.assert_allclose(put_out(), expected, rtol=1e-9)


def test_a_joint_that_the_arm_has_not_cannot_be_stuck(model):
    with pytest.raises(InvalidParameter, match=r"^joint = 4: must be an index from 0 to 3$"):
        JointBrake(model, StuckJoint(joint=4))
