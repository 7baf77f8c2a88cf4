"""Tests of `uvms_drake.control.contact.tangential_filter`."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.contact.tangential_filter import TangentialFilter, followed

N = np.array([0.6, 0.0, 0.8])
ACROSS = np.array([0.8, 2.0, -0.6])
FORCE = 7.0 * N + ACROSS
LAG, PERIOD = 0.5, 0.01


class Setup:
    """Filter of a force that can be set."""

    def __init__(self, force: np.ndarray):
        builder = DiagramBuilder()
        self.source = builder.AddSystem(ConstantVectorSource(force))
        self.system = TangentialFilter.AddToBuilder(
            builder, N, LAG, PERIOD, measured=self.source.get_output_port())
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)

    def give(self, force: np.ndarray) -> None:
        context = self.source.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        self.source.get_mutable_source_value(context).set_value(force)

    def read(self, context=None) -> np.ndarray:
        return self.system.get_output_port().Eval(self.system.GetMyContextFromRoot(
            context or self.simulator.get_context()))


def test_the_tangential_part_lags_and_the_normal_part_passes():
    setup = Setup(np.array([*FORCE, 0.1, 0.2, 0.3]))
    setup.simulator.Initialize()
    for steps in (0, 1, 20, 100):
        setup.simulator.AdvanceTo((steps + 0.5) * PERIOD)
        share = 1.0 - np.exp(-(steps + 1) * PERIOD / LAG)
        np.testing.assert_allclose(
            setup.read(), [*(7.0 * N + share * ACROSS), 0.1, 0.2, 0.3], atol=1e-12)


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


def test_all_that_changes_is_in_the_context():
    setup = Setup(np.append(FORCE, np.zeros(3)))
    setup.simulator.AdvanceTo(0.105)
    other = Simulator(setup.diagram, setup.simulator.get_context().Clone())
    for simulator in (setup.simulator, other):
        simulator.AdvanceTo(0.3)
    np.testing.assert_array_equal(setup.read(), setup.read(other.get_context()))


@pytest.mark.parametrize(("lag", "period", "key"), [(0.0, 0.01, "lag"), (1.0, -1.0, "period")])
def test_times_are_positive(lag, period, key):
    with pytest.raises(InvalidParameter, match=key):
        TangentialFilter(N, lag, period)


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
