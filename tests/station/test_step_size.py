"""Tests of `uvms_drake.station.step_size`."""

import copy
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.primitives import LinearSystem
from support.scenarios import OF_A_STATION

import uvms_drake as uv
from uvms_drake.model.surface.contact_laws import Linear
from uvms_drake.model.surface.geometry import Plane
from uvms_drake.model.surface.law import check_surface
from uvms_drake.station import step_size
from uvms_drake.station.step_size import (
    ACCURACY,
    friction_rate,
    largest_step,
    loop_rates,
    step_error,
    way_to_force,
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


@pytest.mark.parametrize("name", OF_A_STATION)
def test_a_shipped_scenario_has_a_step_that_is_short_enough(name, monkeypatch):
    """One that is chosen divides the period of the logs, and one more step in it is not needed."""
    scenario = uv.load_scenario(name)
    model = uv.load_model(scenario)
    rates = step_size._rates_at_task(scenario, model)
    monkeypatch.setattr(step_size, "_rates_at_task", lambda *_: rates)
    stepping = uv.with_step(scenario, model)
    assert uv.with_step(stepping, model) is stepping
    step = stepping.simulator.max_step_size
    if scenario.simulator.max_step_size == 0.0:
        parts = scenario.log_period / step
        assert parts == pytest.approx(round(parts))
        longer = copy.copy(stepping.simulator)
        longer.max_step_size = scenario.log_period / max(round(parts) - 1, 0.999)
        with pytest.raises(uv.InvalidParameter) if parts > 1.5 else nullcontext():
            uv.with_step(replace(scenario, simulator=longer), model)


def test_a_step_that_no_rate_is_known_for_has_to_be_given(monkeypatch):
    def without_plan(*_):
        raise uv.RunFailed("limits.u[3] is exceeded")

    monkeypatch.setattr("uvms_drake.station.step_size._rates_at_task", without_plan)
    scenario = uv.load_scenario("girona500_ideal")
    with pytest.raises(uv.InvalidParameter, match=r"no plan .*: limits\.u\[3\] is exceeded$"):
        uv.with_step(scenario, uv.load_model(scenario))
    given = uv.load_scenario("girona500_ideal", ["simulator.max_step_size=0.02"])
    assert uv.with_step(given, uv.load_model(given)) is given


def test_a_semi_explicit_scheme_has_its_step_chosen_as_an_explicit_one():
    steps = [uv.with_step(uv.load_scenario("girona500_ideal", [
        "ancillary.k=300", f"simulator={{integration_scheme: {scheme}, max_step_size: 0.0}}"]))
        .simulator.max_step_size for scheme in ("explicit_euler", "semi_explicit_euler")]
    assert steps[0] == steps[1] < 0.01


def test_a_chosen_step_follows_the_gains():
    for k, step in ((20.0, 0.02), (100.0, 0.01), (200.0, 0.005)):
        scenario = uv.load_scenario("girona500_ideal", [f"ancillary.k={k}", f"ancillary.sigma={k}"])
        chosen = uv.with_step(scenario, uv.load_model(scenario)).simulator.max_step_size
        assert chosen == pytest.approx(step)


def test_a_stiff_wall_is_the_integrators_where_a_held_command_does_not_cancel_it():
    stiff = ["surface.stiffness=1e5", "surface.transition=1e-4", "limits.static_force=null",
             "mpc.time_step=0.1"]
    stiff += ["simulator.max_step_size=0.02"]
    cancelled = uv.load_scenario("girona500_ideal", stiff)
    uv.with_step(cancelled, uv.load_model(cancelled))
    held = uv.load_scenario("girona500_ideal", [*stiff, "actuation=[{}]"])
    with pytest.raises(uv.InvalidParameter, match=r"^simulator\.max_step_size"):
        uv.with_step(held, uv.load_model(held))


def test_the_rates_of_an_unknown_wall_are_those_of_a_press_on_it():
    """The depth of its task says nothing: at it the tip would be off the wall."""
    law = "surface.law=!Linear {stiffness: 4.0e5, transition: 1.0e-5}"
    stiff = uv.load_scenario("girona500_real_loop", [law, "simulator.max_step_size=0.01"])
    with pytest.raises(uv.InvalidParameter, match=r"^simulator\.max_step_size.*loop of law, surf"):
        uv.with_step(stiff)
    scenario = uv.load_scenario("girona500_real_loop")
    surface, chi = check_surface(scenario.surface), np.array([-0.3, 0.1, 0.2, 0.0, 0.0, 0.0])
    n = scenario.contact.direction
    for force in (5.0, 20.0):
        way = way_to_force(surface, chi, n, force)
        assert surface.static_force(chi + way * np.pad(n, (0, 3))) == pytest.approx(force, rel=0.05)
    away = chi - np.array([20.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert way_to_force(surface, away, n, 5.0) == 0.0


def sliding(friction, speed):
    """Returns a scenario of a rough plane, the robot at its task in contact, and eigenvalues.

    They are those of the accelerations by the velocities [1/s], while the tip slides the way in
    which it is moved most easily.
    """
    scenario = uv.load_scenario("girona500_ideal", ["limits.static_force=null"])
    scenario.surface = uv.ShapedSurface(Plane(), Linear(), 0.0, friction, 0.01)
    model = uv.load_model(scenario)
    config = model.configuration(uv.make_ocp(scenario, model).y_des)
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
