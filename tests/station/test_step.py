"""Tests of `uvms_drake.station.step`."""

import numpy as np
import pytest
from pydrake.systems.primitives import LinearSystem

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario import load_scenario, shipped_scenarios
from uvms_drake.station.step import (
    ACCURACY,
    check_step,
    floored,
    largest_step,
    loop_rates,
    step_error,
)


@pytest.mark.parametrize(("order", "polynomial"), [
    (1, [1.0, 1.0]), (2, [0.5, 1.0, 1.0]), (3, [1 / 6, 0.5, 1.0, 1.0])])
def test_the_error_of_a_step_is_that_of_the_scheme(order, polynomial):
    for z in (-0.4, -2.0, -0.3 + 1.1j):
        assert step_error(order, z) == pytest.approx(abs(np.polyval(polynomial, z) - np.exp(z)))


def test_the_largest_step_is_inside_of_where_the_scheme_is_stable_and_accurate():
    for scheme, stable in (("explicit_euler", 2.0), ("runge_kutta2", 2.0), ("runge_kutta3", 2.51)):
        step = largest_step(scheme, np.array([-20.0, -5.0]))
        order = {"explicit_euler": 1, "runge_kutta2": 2, "runge_kutta3": 3}[scheme]
        assert step_error(order, -20.0 * step) == pytest.approx(ACCURACY)
        assert 20.0 * step < stable
    assert largest_step("radau3", np.array([-1e9])) == np.inf


def test_the_rates_are_the_eigenvalues_of_the_loop():
    rotation = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    expected = np.array([-200.0, -3.0, 1.0])
    A = rotation @ np.diag(expected) @ rotation.T
    system = LinearSystem(A=A, B=np.zeros((3, 0)), C=np.zeros((0, 3)), D=np.zeros((0, 0)))
    context = system.CreateDefaultContext()
    context.SetContinuousState([1.0, 2.0, 3.0])
    np.testing.assert_allclose(np.sort(loop_rates(system, context).real), expected, rtol=1e-6)
    np.testing.assert_array_equal(context.get_continuous_state_vector().CopyToVector(), [1, 2, 3])


@pytest.mark.parametrize("name", shipped_scenarios())
def test_a_shipped_scenario_has_a_step_that_is_short_enough(name):
    scenario = load_scenario(name)
    check_step(scenario, load_model(scenario))


def test_gains_that_the_step_is_too_long_for_are_refused_with_the_step_that_they_need():
    gains = ["ancillary.k=200", "ancillary.sigma=200"]
    scenario = load_scenario("girona500_contact", gains)
    model = load_model(scenario)
    with pytest.raises(InvalidParameter) as caught:
        check_step(scenario, model)
    assert str(caught.value) == (
        "simulator.max_step_size = 0.02: must be at most 0.0055 s with runge_kutta3: the loop has "
        "a rate of 200 1/s, and longer steps make errors of their own")
    shorter = load_scenario("girona500_contact", [*gains, "simulator.max_step_size=0.0055"])
    check_step(shorter, model)


def test_a_step_is_rounded_down():
    assert floored(0.00557) == pytest.approx(0.0055)
    assert floored(0.3) <= 0.3
