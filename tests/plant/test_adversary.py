"""`plant.adversary`: never above the bound, aimed as it says, and its state is in the Context."""

import numpy as np
import pytest
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Demultiplexer,
    Integrator,
    LinearSystem,
)

from uvms_drake.plant.adversary import (
    KINDS,
    PREVIEW_TIME,
    ROWS,
    AdversarialDisturbance,
    Adversary,
)

BOUND = 0.3
DIRECTION = np.arange(1.0, 11.0)
FIXED = DIRECTION / np.linalg.norm(DIRECTION)
WEIGHTS = np.array([0.1, 0.05, 0.2, 0.3, 0.1, 0.15, 1.0, 0.8, 0.6, 0.9])
SQUARE = ("bang_bang", "per_channel")


def fixed_inputs(adversary, context, state, e_y=None, r=None):
    for port, value in (("state", state), ("e_y", e_y), ("r", r)):
        if value is not None:
            adversary.GetInputPort(port).FixValue(context, value)


def value(adversary, context):
    return adversary.GetOutputPort("disturbance").Eval(context).copy()


@pytest.mark.parametrize("weights", [np.ones(10), WEIGHTS], ids=["ball", "weighted"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rows", ["all", "position"])
def test_the_bound_holds_exactly_and_all_but_the_sinusoid_take_it(
        model, states, kind, rows, weights):
    adversary = Adversary(model, AdversarialDisturbance(
        BOUND, kind, rows, phase=1.0, weights=weights))
    rng, context = np.random.default_rng(0), adversary.CreateDefaultContext()
    norms = []
    for state in np.vstack(list(states.values())):
        for size in (0.0, 1e-12, 1e-6, 1e-3, 1.0):
            context.SetTime(rng.uniform(0.0, 9.0))
            fixed_inputs(adversary, context, state, *(size * rng.normal(size=(2, 10))))
            norms.append(np.linalg.norm(value(adversary, context) / weights))
    assert np.max(norms) <= BOUND
    if kind == "sinusoid":
        assert np.min(norms) < 0.5 * BOUND
        assert np.max(norms) > 0.95 * BOUND
    else:
        np.testing.assert_allclose(norms, BOUND, rtol=1e-12)


@pytest.mark.parametrize("rows", ROWS)
def test_no_point_of_the_ellipsoid_is_worse_than_the_aimed_ones(model, states, rows):
    """Against many points d with ‖Ŵ⁻¹d‖ = d̃: each kind maximises its objective."""
    rng = np.random.default_rng(6)
    points = rng.normal(size=(20_000, 10))
    points *= BOUND * WEIGHTS / np.linalg.norm(points, axis=1)[:, None]
    for state in states["deep"][:3]:
        e_y, r = 0.01 * rng.normal(size=(2, 10))
        J = model.task_jacobian(state[:10])[ROWS[rows]]
        drift = e_y[ROWS[rows]] + PREVIEW_TIME * J @ r
        aims = {"along_r": lambda d, r=r: d @ (r / WEIGHTS**2),
                "along_task_error": lambda d, J=J, e_y=e_y: d @ (J.T @ e_y[ROWS[rows]]),
                "leading": lambda d, J=J: np.linalg.norm(d @ J.T, axis=-1),
                "predictive": lambda d, J=J, drift=drift: np.linalg.norm(
                    drift + 0.5 * PREVIEW_TIME**2 * d @ J.T, axis=-1)}
        for kind, aim in aims.items():
            adversary = Adversary(model, AdversarialDisturbance(
                BOUND, kind, rows, weights=WEIGHTS))
            context = adversary.CreateDefaultContext()
            fixed_inputs(adversary, context, state, e_y, r)
            assert aim(value(adversary, context)) >= np.max(aim(points))


@pytest.mark.parametrize("rows", ROWS)
def test_in_the_cascade_it_reaches_the_radius_of_the_weighted_tube(model, states, rows):
    """𝔯̇ = −k𝔯 + d, 𝔢̇ = −σ𝔢 + J𝔯 with a constant J: all kinds stay below ‖J_bŴ‖ d̃/(kσ)."""
    k, sigma, state = 20.0, 5.0, states["free"][0]
    J = model.task_jacobian(state[:10])
    radius = np.linalg.norm(J[ROWS[rows]] @ np.diag(WEIGHTS), 2) * BOUND / (k * sigma)
    zero, eye = np.zeros((10, 10)), np.eye(10)
    reached = {}
    for kind in ("leading", "along_task_error", "along_r", "predictive", "constant"):
        builder = DiagramBuilder()
        cascade = builder.AddSystem(LinearSystem(
            np.block([[-k * eye, zero], [J, -sigma * eye]]), np.vstack([eye, zero]), np.eye(20),
            []))
        split = builder.AddSystem(Demultiplexer([10, 10]))
        builder.Connect(cascade.get_output_port(), split.get_input_port())
        source = builder.AddSystem(ConstantVectorSource(state))
        adversary = Adversary.AddToBuilder(
            builder, model, AdversarialDisturbance(BOUND, kind, rows, DIRECTION, weights=WEIGHTS),
            state=source.get_output_port(), e_y=split.get_output_port(1),
            r=split.get_output_port(0))
        builder.Connect(adversary.get_output_port(), cascade.get_input_port())
        simulator = Simulator(builder.Build())
        ResetIntegratorFromFlags(simulator, "runge_kutta3", 0.01)
        simulator.get_mutable_integrator().set_fixed_step_mode(True)
        simulator.AdvanceTo(1.5)
        x = cascade.get_output_port().Eval(cascade.GetMyContextFromRoot(simulator.get_context()))
        assert np.linalg.norm(x[:10] / WEIGHTS) <= (1.0 + 1e-9) * BOUND / k
        reached[kind] = np.linalg.norm(x[10:][ROWS[rows]]) / radius
    assert max(reached.values()) <= 1.0 + 1e-9
    assert reached["leading"] > 0.99
    assert reached["along_task_error"] > 0.95


@pytest.mark.parametrize("rows", ROWS)
def test_leading_is_what_j_amplifies_most_with_a_sign_that_stays(model, states, rows):
    adversary = Adversary(
        model, AdversarialDisturbance(BOUND, "leading", rows, direction=DIRECTION))
    context = adversary.CreateDefaultContext()
    for state in states["free"]:
        fixed_inputs(adversary, context, state)
        d = value(adversary, context)
        J_b = model.task_jacobian(state[:10])[ROWS[rows]]
        assert np.linalg.norm(J_b @ d) == pytest.approx(BOUND * np.linalg.norm(J_b, 2))
        assert d @ DIRECTION >= 0.0
        before = d
        state = state + 1e-4
        fixed_inputs(adversary, context, state)
        if rows in ("position", "all"):  # the others' leading direction is not unique
            np.testing.assert_allclose(value(adversary, context), before, atol=1e-2 * BOUND)


@pytest.mark.parametrize("kind", SQUARE)
def test_a_step_of_the_integration_ends_where_the_sign_changes(model, kind):
    """The integral of d is exact with steps that are longer than the intervals between."""
    builder = DiagramBuilder()
    adversary = Adversary.AddToBuilder(builder, model, AdversarialDisturbance(
        BOUND, kind, direction=DIRECTION, channel=2, period=0.37, phase=0.9))
    integrator = builder.AddSystem(Integrator(10))
    builder.Connect(adversary.get_output_port(), integrator.get_input_port())
    simulator = Simulator(builder.Build())
    simulator.get_mutable_integrator().set_fixed_step_mode(True)
    simulator.get_mutable_integrator().set_maximum_step_size(1.0)
    simulator.AdvanceTo(1.7)
    t = (np.arange(1_000_000) + 0.5) * 1.7e-6
    expected = np.mean(np.sign(np.sin(2.0 * np.pi * t / 0.37 + 0.9))) * 1.7
    base = FIXED if kind == "bang_bang" else np.eye(10)[2]
    final = integrator.get_output_port().Eval(
        integrator.GetMyContextFromRoot(simulator.get_context()))
    np.testing.assert_allclose(final, BOUND * expected * base, atol=1e-5)


def test_a_square_wave_may_start_at_any_time_and_a_cloned_context_goes_on(model):
    adversary = Adversary(model, AdversarialDisturbance(BOUND, "bang_bang", period=0.8))
    simulator = Simulator(adversary)
    simulator.get_mutable_context().SetTime(0.5)  # the second half of the period
    simulator.Initialize()
    assert value(adversary, simulator.get_context())[0] < 0.0
    simulator.AdvanceTo(0.9)
    twin = Simulator(adversary, simulator.get_context().Clone())
    for time in (0.9, 1.1, 1.3, 1.7):
        for each in (simulator, twin):
            each.AdvanceTo(time)
        np.testing.assert_array_equal(value(adversary, simulator.get_context()),
                                      value(adversary, twin.get_context()))


# The adversary `predictive`: no other direction of the same size takes the error further.




@pytest.mark.parametrize("rows", ["all", "position", "joints"])
@pytest.mark.parametrize("size", [0.0, 1e-4, 1e-2])
def test_no_other_direction_takes_the_error_further(model, states, rows, size):
    adversary = Adversary(model, AdversarialDisturbance(BOUND, "predictive", rows))
    context, rng = adversary.CreateDefaultContext(), np.random.default_rng(5)
    for state in states["deep"]:
        e_y, r = size * rng.normal(size=(2, 10))
        for name, value in (("state", state), ("e_y", e_y), ("r", r)):
            adversary.GetInputPort(name).FixValue(context, value)
        d = adversary.get_output_port().Eval(context)
        assert np.linalg.norm(d) == pytest.approx(BOUND, rel=1e-9)
        J = model.task_jacobian(state[:10])[ROWS[rows]]
        drift = e_y[ROWS[rows]] + PREVIEW_TIME * J @ r

        def reached(others, J=J, drift=drift):
            return np.linalg.norm(drift + 0.5 * PREVIEW_TIME**2 * others @ J.T, axis=-1)

        others = rng.normal(size=(2000, 10))
        others *= BOUND / np.linalg.norm(others, axis=1)[:, None]
        near = d + 0.05 * others
        near *= BOUND / np.linalg.norm(near, axis=1)[:, None]
        assert reached(d) >= 0.99 * max(np.max(reached(others)), np.max(reached(near)))
