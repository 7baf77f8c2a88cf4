"""Tests of `control.contact.desired_force` and `tangential_filter`."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from uvms_drake.control.contact.desired_force import DesiredForce
from uvms_drake.control.contact.tangential_filter import TangentialFilter, followed

N = np.array([0.0, 0.6, 0.8])


def outputs(wanted: np.ndarray | None) -> tuple[np.ndarray, float]:
    system = DesiredForce(N, 12.0, 30.0)
    context = system.CreateDefaultContext()
    if wanted is not None:
        system.GetInputPort("desired_force").FixValue(context, wanted)
    along = system.GetOutputPort("along").Eval(context)
    return system.GetOutputPort("accepted_force").Eval(context), float(along[0])


@pytest.mark.parametrize(("force", "accepted"), [(20.0, 20.0), (40.0, 30.0), (-5.0, 0.0)])
def test_the_part_along_the_direction_is_cut_to_what_can_be_given(force: float, accepted: float):
    wrench, along = outputs(np.append(force * N + [3.0, 0.0, 0.0], np.ones(3)))
    assert along == pytest.approx(accepted)
    assert wrench == pytest.approx(np.append(accepted * N, np.zeros(3)))


def test_without_a_wish_the_default_holds_and_one_that_is_not_finite_is_none():
    assert outputs(None)[1] == 12.0
    wrench, along = outputs(np.full(6, np.nan))
    assert along == 0.0
    assert not np.any(wrench)


def test_a_clipped_force_gives_one_warning_when_it_begins(caplog):
    builder = DiagramBuilder()
    forces = np.array([20.0, 45.0, 50.0, 20.0, np.nan, 20.0, -3.0])
    source = builder.AddSystem(TrajectorySource(PiecewisePolynomial.ZeroOrderHold(
        np.arange(8.0), np.outer(np.append(N, np.zeros(3)), np.append(forces, 20.0)))))
    system = DesiredForce.AddToBuilder(builder, N, 12.0, 30.0)
    builder.Connect(source.get_output_port(), system.GetInputPort("desired_force"))
    simulator = Simulator(builder.Build())
    for time in np.arange(0.25, 8.0, 0.25):
        simulator.AdvanceTo(time)
    cut, can = "the desired force is cut to", "along the direction from 0 to 30 N can be given"
    assert [record.message for record in caplog.records] == [
        f"t = 1 s: {cut} 30 N, {can}", "t = 4 s: the desired force is not finite: none is given",
        f"t = 6 s: {cut} 0 N, {can}"]


def test_a_desired_force_across_the_direction_gives_a_warning(caplog):
    system = DesiredForce(N, 12.0, 30.0)
    simulator = Simulator(system)
    system.GetInputPort("desired_force").FixValue(
        simulator.get_mutable_context(), [5.0, *(10.0 * N[1:]), 0.0, 0.0, 0.0])
    simulator.AdvanceTo(0.1)
    (record,) = caplog.records
    assert record.message == ("t = 0 s: of the desired force only the part along the direction is "
                              "given, 10 N")


# Tangential filter --------------------------------------------------------------------------------


NORMAL = np.array([0.6, 0.0, 0.8])
ACROSS = np.array([0.8, 2.0, -0.6])
FORCE = 7.0 * NORMAL + ACROSS
LAG, PERIOD = 0.5, 0.01


class Setup:
    """Filter of a force that can be set."""

    def __init__(self, force: np.ndarray):
        builder = DiagramBuilder()
        self.source = builder.AddSystem(ConstantVectorSource(force))
        self.system = TangentialFilter.AddToBuilder(
            builder, NORMAL, LAG, PERIOD, measured=self.source.get_output_port())
        self.simulator = Simulator(builder.Build())

    def give(self, force: np.ndarray) -> None:
        context = self.source.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        self.source.get_mutable_source_value(context).set_value(force)

    def read(self) -> np.ndarray:
        return self.system.get_output_port().Eval(
            self.system.GetMyContextFromRoot(self.simulator.get_context()))


def test_the_tangential_part_lags_and_the_normal_part_passes():
    setup = Setup(np.array([*FORCE, 0.1, 0.2, 0.3]))
    setup.simulator.Initialize()
    for steps in (0, 1, 20, 100):
        setup.simulator.AdvanceTo((steps + 0.5) * PERIOD)
        share = 1.0 - np.exp(-(steps + 1) * PERIOD / LAG)
        np.testing.assert_allclose(
            setup.read(), [*(7.0 * NORMAL + share * ACROSS), 0.1, 0.2, 0.3], atol=1e-12)


def test_a_force_that_is_no_number_teaches_nothing():
    setup = Setup(np.append(FORCE, np.zeros(3)))
    setup.simulator.AdvanceTo(1.0)
    before = setup.read()
    setup.give(np.full(6, np.nan))
    setup.simulator.AdvanceTo(1.5)
    assert np.isnan(setup.read()).all()
    setup.give(np.append(FORCE, np.zeros(3)))
    np.testing.assert_allclose(setup.read(), before, atol=2.0 * PERIOD)


def test_nothing_is_across_where_nothing_is_pressed():
    """A wall that was left, or a released force."""
    setup = Setup(np.append(FORCE, np.zeros(3)))
    setup.simulator.AdvanceTo(1.0)
    setup.give(np.zeros(6))
    np.testing.assert_array_equal(setup.read(), np.zeros(6))


def swing(tangential_filter: bool, m: float = 1.5, c: float = 64.0, tau: float = 0.03) -> float:
    """Returns the acceleration of a tip over the one that a law means, at 0.7 Hz.

    Friction cv resists the tip of inertia m, and the law cancels the measured force τ later.
    """
    h, lag, omega = 1e-3, 1.0, 2.0 * np.pi * 0.7
    delay = round(tau / h)
    v, slow, forces, found = 0.0, np.zeros(3), [0.0] * delay, []
    for i in range(12_000):
        forces.append(c * v)
        force = np.array([0.0, forces[-1 - delay], 0.0])
        slow = followed(slow, force, np.array([1.0, 0.0, 0.0]), h / lag)
        cancelled = slow[1] if tangential_filter else force[1]
        rate = (m * np.sin(omega * i * h) - c * v + cancelled) / m
        v += h * rate
        found.append(rate)
    return float(np.max(np.abs(found[-3000:])))


def test_delayed_friction_compensation_makes_a_tip_heavier():
    """By cτ; and that is for slow friction the same as none: the tip is damped instead."""
    assert swing(tangential_filter=False) == pytest.approx(1.5 / (1.5 + 64.0 * 0.03), rel=0.05)
    omega = 2.0 * np.pi * 0.7
    damped = omega * 1.5 / np.hypot(omega * 1.5, 64.0)
    assert swing(tangential_filter=True) == pytest.approx(damped, rel=0.1)
