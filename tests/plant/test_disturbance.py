"""Disturbances: the bound, closed forms, aims of an adversary, and a state in the Context."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, Demultiplexer, Integrator, LinearSystem

from uvms_drake.plant import disturbance
from uvms_drake.plant.adversary import KINDS, PREVIEW_TIME, ROWS, AdversarialDisturbance, Adversary

SIZE, BOUND = 7, 0.3
IN_TIME = [disturbance.ConstantDisturbance(BOUND),
           disturbance.SinusoidalDisturbance(BOUND, frequency=1.7, phase=0.4),
           disturbance.RandomDisturbance(BOUND, bandwidth=3.0)]
WEIGHTS = np.array([0.1, 0.3, 0.05, 0.7, 1.0, 0.9, 0.2])
"""Weights of the ellipsoid with the semi-axes BOUND times these."""


def record(config, times, seed=0, size=SIZE):
    """Returns d (len(times), size), simulated through `times`."""
    simulator = Simulator(config.system(size, seed))
    port = simulator.get_system().GetOutputPort("disturbance")
    simulator.get_mutable_context().SetTime(times[0])
    simulator.Initialize()
    values = []
    for time in times:
        simulator.AdvanceTo(time)
        values.append(port.Eval(simulator.get_context()).copy())
    return np.array(values)


@pytest.mark.parametrize("config", IN_TIME)
def test_the_bound_holds_at_ten_thousand_times_in_an_ellipsoid_too(config):
    """Exactly, so rounding must not exceed it either."""
    times, weighted = np.linspace(0.0, 250.0, 10_000), replace(config, weights=WEIGHTS)
    values, plain = record(weighted, times), record(config, times)
    norms = np.linalg.norm(values / WEIGHTS, axis=1)
    assert 0.8 * BOUND < np.max(norms) <= BOUND
    assert np.max(np.linalg.norm(plain, axis=1)) <= BOUND
    np.testing.assert_allclose(weighted.norm(values), norms, rtol=1e-12)
    assert np.all(np.max(np.abs(values), axis=0) <= BOUND * WEIGHTS)
    np.testing.assert_allclose(values, WEIGHTS * plain, rtol=1e-12, atol=1e-15)


def test_the_sinusoid_is_the_papers_with_the_two_norm_as_its_bound():
    times = np.linspace(0.0, 9.0, 50)
    values = record(disturbance.SinusoidalDisturbance(BOUND, frequency=1.7, phase=0.4), times)
    expected = np.outer(BOUND * np.sin(1.7 * times + 0.4), np.ones(SIZE) / np.sqrt(SIZE))
    np.testing.assert_allclose(values, expected, rtol=1e-13)


def test_samples_fill_the_ball_uniformly():
    """For uniform samples ‖x‖ⁿ is uniform on [0, 1] and the mean is zero."""
    samples = np.array([disturbance.ball_sample(3, 5, i) for i in range(4000)])
    radii = np.sort(np.linalg.norm(samples, axis=1)) ** 3
    np.testing.assert_allclose(radii, np.linspace(0.0, 1.0, 4000), atol=0.03)
    np.testing.assert_allclose(np.mean(samples, axis=0), 0.0, atol=0.03)


def test_a_random_disturbance_passes_through_its_samples_with_zero_slope():
    bandwidth, h = 2.0, 1e-5
    knots = np.arange(1, 9) / (2.0 * bandwidth)
    times = np.sort(np.concatenate([knots - h, knots, knots + h]))
    before, at, after = record(disturbance.RandomDisturbance(BOUND, bandwidth), times, 4).reshape(
        8, 3, SIZE).swapaxes(0, 1)
    samples = BOUND * np.array([disturbance.ball_sample(SIZE, 4, i) for i in range(1, 9)])
    np.testing.assert_allclose(at, samples, atol=1e-15)
    np.testing.assert_allclose((at - before) / h, 0.0, atol=1e-3)
    np.testing.assert_allclose((after - at) / h, 0.0, atol=1e-3)


def test_most_of_the_power_of_a_random_disturbance_is_below_the_bandwidth():
    bandwidth, step = 1.5, 0.02
    values = record(disturbance.RandomDisturbance(BOUND, bandwidth), np.arange(0.0, 400.0, step))
    power = np.sum(np.abs(np.fft.rfft(values, axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(len(values), step)
    assert np.sum(power[frequency <= bandwidth]) > 0.9 * np.sum(power)
    assert np.sum(power[frequency <= 0.5 * bandwidth]) < 0.9 * np.sum(power)


def test_a_simulation_may_start_at_any_time():
    config = disturbance.RandomDisturbance(BOUND, 2.0)
    late = np.linspace(3.1, 5.0, 20)
    np.testing.assert_allclose(
        record(config, late), record(config, np.concatenate([[0.0], late]))[1:], atol=1e-14)


DIRECTION = np.arange(1.0, 11.0)
FIXED = DIRECTION / np.linalg.norm(DIRECTION)
AIMED = np.array([0.1, 0.05, 0.2, 0.3, 0.1, 0.15, 1.0, 0.8, 0.6, 0.9])
SQUARE = ("bang_bang", "per_channel")


def fixed_inputs(adversary, context, state, e_y=None, r=None):
    for port, value in (("state", state), ("e_y", e_y), ("r", r)):
        if value is not None:
            adversary.GetInputPort(port).FixValue(context, value)


def value(adversary, context):
    return adversary.GetOutputPort("disturbance").Eval(context).copy()


@pytest.mark.parametrize("weights", [np.ones(10), AIMED], ids=["ball", "weighted"])
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
    points *= BOUND * AIMED / np.linalg.norm(points, axis=1)[:, None]
    for state in states["deep"][:3]:
        e_y, r = 0.01 * rng.normal(size=(2, 10))
        J = model.task_jacobian(state[:10])[ROWS[rows]]
        drift = e_y[ROWS[rows]] + PREVIEW_TIME * J @ r
        aims = {"along_r": lambda d, r=r: d @ (r / AIMED**2),
                "along_task_error": lambda d, J=J, e_y=e_y: d @ (J.T @ e_y[ROWS[rows]]),
                "leading": lambda d, J=J: np.linalg.norm(d @ J.T, axis=-1),
                "predictive": lambda d, J=J, drift=drift: np.linalg.norm(
                    drift + 0.5 * PREVIEW_TIME**2 * d @ J.T, axis=-1)}
        for kind, aim in aims.items():
            adversary = Adversary(model, AdversarialDisturbance(
                BOUND, kind, rows, weights=AIMED))
            context = adversary.CreateDefaultContext()
            fixed_inputs(adversary, context, state, e_y, r)
            assert aim(value(adversary, context)) >= np.max(aim(points))


@pytest.mark.parametrize("rows", ROWS)
def test_in_the_cascade_it_reaches_the_radius_of_the_weighted_tube(model, states, rows):
    """𝔯̇ = −k𝔯 + d, 𝔢̇ = −σ𝔢 + J𝔯 with a constant J: all kinds stay below ‖J_bŴ‖ d̃/(kσ)."""
    k, sigma, state = 20.0, 5.0, states["free"][0]
    J = model.task_jacobian(state[:10])
    radius = np.linalg.norm(J[ROWS[rows]] @ np.diag(AIMED), 2) * BOUND / (k * sigma)
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
            builder, model, AdversarialDisturbance(BOUND, kind, rows, DIRECTION, weights=AIMED),
            state=source.get_output_port(), e_y=split.get_output_port(1),
            r=split.get_output_port(0))
        builder.Connect(adversary.get_output_port(), cascade.get_input_port())
        simulator = Simulator(builder.Build())
        ResetIntegratorFromFlags(simulator, "runge_kutta3", 0.01)
        simulator.get_mutable_integrator().set_fixed_step_mode(True)
        simulator.AdvanceTo(1.5)
        x = cascade.get_output_port().Eval(cascade.GetMyContextFromRoot(simulator.get_context()))
        assert np.linalg.norm(x[:10] / AIMED) <= (1.0 + 1e-9) * BOUND / k
        reached[kind] = np.linalg.norm(x[10:][ROWS[rows]]) / radius
    assert max(reached.values()) <= 1.0 + 1e-9
    assert reached["leading"] > 0.99
    assert reached["along_task_error"] > 0.95


@pytest.mark.parametrize("rows", ROWS)
def test_the_sign_of_the_leading_one_stays(model, states, rows):
    adversary = Adversary(
        model, AdversarialDisturbance(BOUND, "leading", rows, direction=DIRECTION))
    context = adversary.CreateDefaultContext()
    for state in states["free"]:
        fixed_inputs(adversary, context, state)
        before = value(adversary, context)
        assert before @ DIRECTION >= 0.0
        fixed_inputs(adversary, context, state + 1e-4)
        if rows in ("position", "all"):  # the others' leading direction is not unique
            np.testing.assert_allclose(value(adversary, context), before, atol=1e-2 * BOUND)


@pytest.mark.parametrize("kind", SQUARE)
def test_a_step_of_the_integration_ends_where_the_sign_changes(model, kind):
    """The integral of d is exact with steps that are longer than the intervals between."""
    builder = DiagramBuilder()
    adversary = builder.AddSystem(Adversary(model, AdversarialDisturbance(
        BOUND, kind, direction=DIRECTION, channel=2, period=0.37, phase=0.9)))
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


@pytest.mark.parametrize(("kind", "start"), [("random", 2.9), ("bang_bang", 0.5)])
def test_it_may_start_at_any_time_and_a_cloned_context_goes_on(model, kind, start):
    system = (disturbance.RandomDisturbance(BOUND, 2.0).system(SIZE, 9) if kind == "random" else
              Adversary(model, AdversarialDisturbance(BOUND, "bang_bang", period=0.8)))
    simulator = Simulator(system)
    simulator.get_mutable_context().SetTime(start)  # The second half of the period.
    simulator.Initialize()
    assert kind == "random" or value(system, simulator.get_context())[0] < 0.0
    simulator.AdvanceTo(start + 0.4)
    twin = Simulator(system, simulator.get_context().Clone())
    for later in (0.4, 0.5, 0.6, 0.8, 1.2, 4.1):
        for each in (simulator, twin):
            each.AdvanceTo(start + later)
        np.testing.assert_array_equal(value(system, simulator.get_context()),
                                      value(system, twin.get_context()))
