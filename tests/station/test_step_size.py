"""Tests of `uvms_drake.station.step_size`."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.primitives import LinearSystem

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.surface.geometry import Plane
from uvms_drake.model.surface.normal_law import Linear
from uvms_drake.model.surface.shaped_surface import ShapedSurface
from uvms_drake.station.motions.motions import make_ocp
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.scenario.scenario_file import shipped_scenarios
from uvms_drake.station.step_size import (
    ACCURACY,
    check_step,
    floored,
    friction_rate,
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
    scenario = load_scenario("girona500_ideal", gains)
    model = load_model(scenario)
    with pytest.raises(InvalidParameter) as caught:
        check_step(scenario, model)
    assert str(caught.value) == (
        "simulator.max_step_size = 0.02: must be at most 0.0055 s with runge_kutta3: the loop has "
        "a rate of 200 1/s, and longer steps are inaccurate")
    shorter = load_scenario("girona500_ideal", [*gains, "simulator.max_step_size=0.0055"])
    check_step(shorter, model)


def test_a_stiff_wall_is_the_integrators_where_a_held_command_does_not_cancel_it():
    stiff = ["surface.stiffness=1e5", "surface.transition=1e-4", "limits.static_force=null",
             "mpc.time_step=0.1"]
    cancelled = load_scenario("girona500_ideal", stiff)
    check_step(cancelled, load_model(cancelled))
    held = load_scenario("girona500_ideal", [*stiff, "actuation=[{}]"])
    with pytest.raises(InvalidParameter, match=r"^simulator\.max_step_size"):
        check_step(held, load_model(held))


def test_dry_joints_that_the_step_is_too_long_for_are_refused():
    scenario = load_scenario("girona500_ideal", ["model_error.joint_friction.coulomb=[0.5]"])
    with pytest.raises(InvalidParameter, match=r"at most 0\.000\d+ s .* a rate of 1\.\d+e\+03"):
        check_step(scenario, load_model(scenario))


def sliding(friction, speed):
    """Returns a scenario of a rough plane, the robot at its task in contact, and eigenvalues.

    They are those of the accelerations by the velocities [1/s], while the tip slides the way in
    which it is moved most easily.
    """
    scenario = load_scenario("girona500_ideal", ["limits.static_force=null"])
    scenario.surface = ShapedSurface(Plane(), Linear(), 0.0, friction, 0.01)
    model = load_model(scenario)
    config = model.configuration(make_ocp(scenario, model).y_des)
    J, M = model.task_jacobian(config)[:3], model.mass_matrix(model.kinematics(config))
    mobility, ways = np.linalg.eigh((J @ np.linalg.solve(M, J.T))[1:, 1:])
    push = np.linalg.solve(M, J.T) @ np.append(0.0, ways[:, -1])
    zeta, h = speed / mobility[-1] * push, 1e-7
    columns = [(model.drift(config, zeta + h * e) - model.drift(config, zeta - h * e)) / (2.0 * h)
               for e in np.eye(model.size)]
    return scenario, model, config, np.linalg.eigvals(np.array(columns).T)


def test_the_rate_of_friction_is_that_of_a_tip_that_slides_at_half_its_creep():
    """In the dynamics without a controller; the tip is heavier across the wall than along it."""
    scenario, model, config, rates = sliding(0.3, 0.005)
    rate = friction_rate(scenario, model, config)
    assert 0.75 * rate < np.max(np.abs(rates)) <= 1.02 * rate
    *_, at_rest = sliding(0.3, 0.0)
    assert np.max(np.abs(at_rest)) < 0.1 * rate


def test_friction_that_the_step_is_too_long_for_is_refused():
    slow = "surface=!ShapedSurface {friction: 0.3, creep: 0.005}"
    scenario = load_scenario("girona500_ideal", [slow, "limits.static_force=null"])
    model = load_model(scenario)
    with pytest.raises(InvalidParameter, match=r"^simulator\.max_step_size = 0\.02: must be at "
                       r"most 0\.00\d+ s with runge_kutta3: the loop has a rate of \d+ 1/s, and"):
        check_step(scenario, model)
    check_step(replace(scenario, surface=ShapedSurface(friction=0.3, creep=0.2)), model)


def test_a_step_is_rounded_down():
    assert floored(0.00557) == pytest.approx(0.0055)
    assert floored(0.3) <= 0.3
