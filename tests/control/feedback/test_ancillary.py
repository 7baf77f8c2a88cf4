"""Tests of `uvms_drake.control.feedback.ancillary`: the system that reads the ports of a law."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from support.laws import SIGMA, K, pairs, resolved_input, transpose_input

from uvms_drake.control.feedback.ancillary import AncillaryFeedback, limited_input
from uvms_drake.control.laws import Resolved, TipFirst
from uvms_drake.control.limits import Limits
from uvms_drake.papers.nikou2018 import Transpose
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state

U_LIMIT = np.array([0.4, 0.3, 0.35, 0.4, 0.5, 0.4, 6.0, 8.0, 8.0, 6.0])  # m/s² (3), rad/s² (7)


@pytest.mark.parametrize("config", [Resolved(k=K, sigma=SIGMA), Transpose(k=K, sigma=SIGMA)])
def test_the_system_computes_its_law_in_any_diagram(model, states, config):
    state, nominal, acceleration, _ = next(pairs(model, states, "deep"))
    nominal_input = np.linspace(0.0, 1.0, 10)
    builder = DiagramBuilder()
    feedback = AncillaryFeedback(model, config)
    builder.AddNamedSystem("feedback", feedback)
    for name, value in (("state", state), ("nominal_state", nominal),
                        ("nominal_acceleration", acceleration), ("nominal_input", nominal_input)):
        source = builder.AddNamedSystem(name, ConstantVectorSource(value))
        builder.Connect(source.get_output_port(), feedback.GetInputPort(name))
    builder.ExportOutput(feedback.GetOutputPort("u"), "u")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    assert context.num_total_states() == 0
    if isinstance(config, Resolved):
        expected = resolved_input(model, state, nominal, acceleration, K, SIGMA)
    else:
        expected = transpose_input(model, state, nominal, nominal_input, K, SIGMA)
    np.testing.assert_array_equal(diagram.GetOutputPort("u").Eval(context), expected)


@pytest.mark.parametrize("where", ["free", "deep"])
@pytest.mark.parametrize("config", [Resolved(k=K, sigma=SIGMA), Transpose(k=K, sigma=SIGMA)])
def test_with_tau_the_plant_accelerates_by_u_more_than_without_it(
        model, plane, states, config, where):
    """ζ̇ = f + u: the full inertia, with added mass and rotors, on both sides."""
    plant = make_uvms_plant("girona500_arm5e", surface=plane,
                            disturbance=ConstantDisturbance(bound=0.0))
    water = plant.GetSubsystemByName("hydrodynamics")
    order = plant.GetSubsystemByName("tau_to_drake_order")
    context = plant.CreateDefaultContext()
    feedback = AncillaryFeedback(model, config)
    inputs = feedback.CreateDefaultContext()

    def accelerate(force):
        plant.GetInputPort("tau").FixValue(context, force)
        return water.GetOutputPort("acceleration").Eval(
            water.GetMyContextFromRoot(context)).copy()

    for state, nominal, _, _ in pairs(model, states, where):
        set_state(plant, context, state)
        for name, value in (("state", state), ("nominal_state", nominal),
                            ("nominal_acceleration", np.linspace(-0.1, 0.2, 10)),
                            ("nominal_input", np.linspace(0.3, -0.2, 10))):
            feedback.GetInputPort(name).FixValue(inputs, value)
        tau, u = (feedback.GetOutputPort(name).Eval(inputs) for name in ("tau", "u"))
        gained = accelerate(tau) - accelerate(np.zeros(10))
        accelerate(u)  # The same map takes u into the plant's order.
        expected = order.GetOutputPort("drake_order").Eval(order.GetMyContextFromRoot(context))
        np.testing.assert_allclose(gained, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("config", [Resolved(k=K, sigma=SIGMA), Transpose(k=K, sigma=SIGMA)])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_without_a_measurement_the_command_is_the_plans_own(model, states, config, value):
    state, nominal, acceleration, _ = next(pairs(model, states, "deep"))
    nominal_input = acceleration - model.drift(nominal[:10], nominal[10:])
    feedback = AncillaryFeedback(model, config)
    context = feedback.CreateDefaultContext()
    for name, given in (("nominal_state", nominal), ("nominal_acceleration", acceleration),
                        ("nominal_input", nominal_input)):
        feedback.GetInputPort(name).FixValue(context, given)
    M = model.mass_matrix(model.kinematics(nominal[:10]))
    for index in (0, 19):
        feedback.GetInputPort("state").FixValue(context, state)
        assert feedback.GetOutputPort("lost").Eval(context) == 0.0
        assert np.max(np.abs(feedback.GetOutputPort("u").Eval(context) - nominal_input)) > 0.1
        lost = state.copy()
        lost[index] = value
        feedback.GetInputPort("state").FixValue(context, lost)
        assert feedback.GetOutputPort("lost").Eval(context) == 1.0
        np.testing.assert_allclose(
            feedback.GetOutputPort("u").Eval(context), nominal_input, atol=1e-9)
        np.testing.assert_allclose(
            feedback.GetOutputPort("tau").Eval(context), M @ nominal_input, rtol=1e-9, atol=1e-8)


def test_the_measured_force_takes_the_place_of_the_surface_while_it_is_finite(model, states):
    state, nominal, acceleration, _ = next(pairs(model, states, "deep"))
    contact = np.array([3.0, -4.0, 5.0, 0.1, 0.2, -0.3])
    feedback = AncillaryFeedback(model, Resolved(K, SIGMA))
    context = feedback.CreateDefaultContext()
    for name, value in (("state", state), ("nominal_state", nominal),
                        ("nominal_acceleration", acceleration)):
        feedback.GetInputPort(name).FixValue(context, value)

    def tau():
        return feedback.GetOutputPort("tau").Eval(context).copy()

    known, measured = tau(), feedback.GetInputPort("force_measured")
    measured.FixValue(context, contact)
    kinematics = model.kinematics(state[:10])
    believed = model.surface.force(kinematics.chi, kinematics.J_chi @ state[10:])
    np.testing.assert_allclose(
        tau() - known, kinematics.J_chi.T @ (contact - believed), rtol=1e-9, atol=1e-9)
    assert np.max(np.abs(tau() - known)) > 1.0
    measured.FixValue(context, np.where(np.arange(6) == 4, np.nan, contact))
    np.testing.assert_array_equal(tau(), known)
    lost = np.full(20, np.nan)
    feedback.GetInputPort("state").FixValue(context, lost)
    measured.FixValue(context, contact)
    assert np.all(np.isfinite(tau()))


def commands(model, states, size: float):
    """Yields M of the robot and random u up to `size` times the limits, and τ = M u."""
    rng = np.random.default_rng(30)
    for state in states["free"]:
        M = model.mass_matrix(model.kinematics(state[:10]))
        u = size * U_LIMIT * rng.uniform(-1.0, 1.0, size=10)
        yield M, u, M @ u


def test_each_acceleration_is_cut_to_its_limit_and_the_force_follows(model, states):
    for M, u, tau in commands(model, states, 3.0):
        cut_u, cut_tau, limited = limited_input(u, tau, M, U_LIMIT)
        beyond = np.abs(u) > U_LIMIT
        assert limited
        assert 0 < np.count_nonzero(beyond) < 10
        np.testing.assert_array_equal(cut_u[~beyond], u[~beyond])
        np.testing.assert_array_equal(cut_u[beyond], (np.sign(u) * U_LIMIT)[beyond])
        np.testing.assert_allclose(cut_tau, M @ cut_u, rtol=1e-12)


def test_each_force_is_cut_to_its_limit_and_the_acceleration_follows(model, states):
    for M, u, tau in commands(model, states, 3.0):
        within_u = M @ np.clip(u, -U_LIMIT, U_LIMIT)
        tau_limit = np.abs(within_u) * np.tile([0.5, 2.0], 5)
        cut_u, cut_tau, limited = limited_input(u, tau, M, U_LIMIT, tau_limit)
        assert limited
        np.testing.assert_allclose(cut_tau, within_u * np.tile([0.5, 1.0], 5), rtol=1e-12)
        np.testing.assert_allclose(M @ cut_u, cut_tau, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("config", [Resolved(k=K, sigma=SIGMA), Transpose(k=K, sigma=SIGMA)])
def test_the_system_says_whether_a_limit_cuts_its_command(model, states, config):
    """With limits on either side of what the law commands, of u and of τ."""
    state, nominal, acceleration, _ = next(pairs(model, states, "deep"))
    nominal_input = acceleration - model.drift(nominal[:10], nominal[10:])

    def outputs(limits):
        feedback = AncillaryFeedback(model, config, limits)
        context = feedback.CreateDefaultContext()
        for name, value in (("state", state), ("nominal_state", nominal),
                            ("nominal_acceleration", acceleration),
                            ("nominal_input", nominal_input)):
            feedback.GetInputPort(name).FixValue(context, value)
        return [feedback.GetOutputPort(name).Eval(context).copy()
                for name in ("u", "tau", "limited")]

    u, tau, limited = outputs(None)
    assert limited == 0.0
    wide, tight = 1.001 * np.abs(u), 0.5 * np.abs(u)
    for limits in (Limits(u=wide), Limits(u=wide, tau=1.001 * np.abs(tau))):
        for value, expected in zip(outputs(limits), (u, tau, 0.0), strict=True):
            np.testing.assert_array_equal(value, expected)
    cut_u, cut_tau, limited = outputs(Limits(u=tight))
    assert limited == 1.0
    np.testing.assert_allclose(cut_u, 0.5 * u, rtol=1e-12)
    np.testing.assert_allclose(cut_tau, 0.5 * tau, rtol=1e-9)
    cut_u, cut_tau, limited = outputs(Limits(u=wide, tau=0.5 * np.abs(tau)))
    assert limited == 1.0
    np.testing.assert_allclose(cut_u, 0.5 * u, rtol=1e-9)
    np.testing.assert_allclose(cut_tau, 0.5 * tau, rtol=1e-12)


def test_where_the_thrusters_say_what_they_give_only_the_joints_are_cut_here(model, states):
    """The vehicle is asked for more than its limits, the joints are not, then they are, too."""
    state, nominal, acceleration, _ = next(pairs(model, states, "free"))
    for joints, cut in ((1e3, False), (1e-2, True)):
        limits = Limits(u=np.repeat([1e-3, joints], [6, 4]))
        feedback = AncillaryFeedback(model, TipFirst(), limits)
        context = feedback.CreateDefaultContext()
        for name, value in (("state", state), ("nominal_state", nominal),
                            ("nominal_acceleration", acceleration)):
            feedback.GetInputPort(name).FixValue(context, value)
        assert feedback.GetOutputPort("limited").Eval(context)[0] == 1.0
        feedback.GetInputPort("vehicle_wrench").FixValue(context, np.zeros(6))
        assert feedback.GetOutputPort("limited").Eval(context)[0] == cut
        u = feedback.GetOutputPort("u").Eval(context)
        assert np.max(np.abs(u[:6])) > 1e-3
        assert np.max(np.abs(u[6:])) <= joints * (1.0 + 1e-9)
