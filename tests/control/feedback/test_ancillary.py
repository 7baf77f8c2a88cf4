"""Tests of `uvms_drake.control.feedback.ancillary`: the system that reads the ports of a law."""

import numpy as np
import pytest
from support.laws import SIGMA, K, pairs, resolved_input, transpose_input

import uvms_drake as uv
from uvms_drake.control.feedback.ancillary import AncillaryFeedback, limited_input
from uvms_drake.papers.nikou2018 import Transpose

U_LIMIT = np.array([0.4, 0.3, 0.35, 0.4, 0.5, 0.4, 6.0, 8.0, 8.0, 6.0])  # m/s² (3), rad/s² (7)


both_laws = pytest.mark.parametrize("config", [
    uv.Resolved(k=K, sigma=SIGMA), Transpose(k=K, sigma=SIGMA)])


@pytest.fixture
def signals(model, states) -> dict[str, np.ndarray]:
    """Inputs of the system, pressing."""
    state, nominal, acceleration, _ = next(pairs(model, states, "deep"))
    return {"state": state, "nominal_state": nominal, "nominal_acceleration": acceleration,
            "nominal_input": acceleration - model.drift(nominal[:10], nominal[10:])}


def give(feedback, context, **values) -> None:
    """Sets input ports."""
    for name, value in values.items():
        feedback.GetInputPort(name).FixValue(context, value)


def read(feedback, context, *names) -> list[np.ndarray]:
    """Returns what is at output ports."""
    return [feedback.GetOutputPort(name).Eval(context).copy() for name in names]


@both_laws
def test_the_system_computes_its_law(model, signals, config):
    feedback = AncillaryFeedback(model, config)
    context = feedback.CreateDefaultContext()
    assert context.num_total_states() == 0
    give(feedback, context, **signals)
    state, nominal, acceleration, nominal_input = signals.values()
    if isinstance(config, uv.Resolved):
        expected = resolved_input(model, state, nominal, acceleration, K, SIGMA)
    else:
        expected = transpose_input(model, state, nominal, nominal_input, K, SIGMA)
    np.testing.assert_array_equal(read(feedback, context, "u")[0], expected)


@pytest.mark.parametrize("where", ["free", "deep"])
@both_laws
def test_with_tau_the_plant_accelerates_by_u_more_than_without_it(
        model, plane, states, config, where):
    """ζ̇ = f + u: the full inertia, with added mass and rotors, on both sides."""
    plant = uv.make_uvms_plant("girona500_arm5e", surface=plane,
                            disturbance=uv.disturbances.ConstantDisturbance(bound=0.0))
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
        uv.set_state(plant, context, state)
        give(feedback, inputs, state=state, nominal_state=nominal,
             nominal_acceleration=np.linspace(-0.1, 0.2, 10),
             nominal_input=np.linspace(0.3, -0.2, 10))
        tau, u = read(feedback, inputs, "tau", "u")
        gained = accelerate(tau) - accelerate(np.zeros(10))
        accelerate(u)  # The same map takes u into the plant's order.
        expected = order.GetOutputPort("drake_order").Eval(order.GetMyContextFromRoot(context))
        np.testing.assert_allclose(gained, expected, rtol=1e-9, atol=1e-9)


@both_laws
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_without_a_measurement_the_command_is_the_plans_own(model, signals, config, value):
    feedback = AncillaryFeedback(model, config)
    context, nominal_input = feedback.CreateDefaultContext(), signals["nominal_input"]
    M = model.mass_matrix(model.kinematics(signals["nominal_state"][:10]))
    for index in (0, 19):
        give(feedback, context, **signals)
        lost, u = read(feedback, context, "lost", "u")
        assert lost == 0.0 and np.max(np.abs(u - nominal_input)) > 0.1
        give(feedback, context, state=np.where(np.arange(20) == index, value, signals["state"]))
        lost, u, tau = read(feedback, context, "lost", "u", "tau")
        assert lost == 1.0
        np.testing.assert_allclose(u, nominal_input, atol=1e-9)
        np.testing.assert_allclose(tau, M @ nominal_input, rtol=1e-9, atol=1e-8)


def test_the_measured_force_takes_the_place_of_the_surface_while_it_is_finite(model, signals):
    contact, state = np.array([3.0, -4.0, 5.0, 0.1, 0.2, -0.3]), signals["state"]
    feedback = AncillaryFeedback(model, uv.Resolved(K, SIGMA))
    context = feedback.CreateDefaultContext()

    def tau(**values):
        give(feedback, context, **values)
        return read(feedback, context, "tau")[0]

    known, measured = tau(**signals), tau(force_measured=contact)
    kinematics = model.kinematics(state[:10])
    believed = model.surface.force(kinematics.chi, kinematics.J_chi @ state[10:])
    np.testing.assert_allclose(
        measured - known, kinematics.J_chi.T @ (contact - believed), rtol=1e-9, atol=1e-9)
    assert np.max(np.abs(measured - known)) > 1.0
    np.testing.assert_array_equal(
        tau(force_measured=np.where(np.arange(6) == 4, np.nan, contact)), known)
    assert np.all(np.isfinite(tau(state=np.full(20, np.nan), force_measured=contact)))


def test_each_acceleration_and_each_force_is_cut_to_its_limit_and_the_other_follows(
        model, states):
    rng = np.random.default_rng(30)
    for state in states["free"]:
        M = model.mass_matrix(model.kinematics(state[:10]))
        u = 3.0 * U_LIMIT * rng.uniform(-1.0, 1.0, size=10)
        within = np.clip(u, -U_LIMIT, U_LIMIT)
        cut_u, cut_tau, limited = limited_input(u, M @ u, M, U_LIMIT)
        assert limited and 0 < np.count_nonzero(within != u) < 10
        np.testing.assert_array_equal(cut_u, within)
        np.testing.assert_allclose(cut_tau, M @ within, rtol=1e-12)
        tau_limit = np.abs(M @ within) * np.tile([0.5, 2.0], 5)
        cut_u, cut_tau, limited = limited_input(u, M @ u, M, U_LIMIT, tau_limit)
        assert limited
        np.testing.assert_allclose(cut_tau, M @ within * np.tile([0.5, 1.0], 5), rtol=1e-12)
        np.testing.assert_allclose(M @ cut_u, cut_tau, rtol=1e-9, atol=1e-9)


@both_laws
def test_the_system_says_whether_a_limit_cuts_its_command(model, signals, config):
    """With limits on either side of what the law commands, of u and of τ."""
    def outputs(limits):
        feedback = AncillaryFeedback(model, config, limits)
        context = feedback.CreateDefaultContext()
        give(feedback, context, **signals)
        return read(feedback, context, "u", "tau", "limited")

    u, tau, limited = outputs(None)
    assert limited == 0.0
    wide = 1.001 * np.abs(u)
    for u_limit, tau_limit, share in ((wide, None, 1.0), (wide, 1.001 * np.abs(tau), 1.0),
                                      (0.5 * np.abs(u), None, 0.5), (wide, 0.5 * np.abs(tau), 0.5)):
        cut_u, cut_tau, limited = outputs(uv.limits.Limits(u=u_limit, tau=tau_limit))
        np.testing.assert_allclose(cut_u, share * u, rtol=1e-9)
        np.testing.assert_allclose(cut_tau, share * tau, rtol=1e-9)
        assert limited == (share < 1.0)


def test_where_the_thrusters_say_what_they_give_only_the_joints_are_cut_here(model, states):
    """The vehicle is asked for more than its limits, the joints are not, then they are, too."""
    state, nominal, acceleration, _ = next(pairs(model, states, "free"))
    for joints, cut in ((1e3, False), (1e-2, True)):
        limits = uv.limits.Limits(u=np.repeat([1e-3, joints], [6, 4]))
        feedback = AncillaryFeedback(model, uv.laws.TipFirst(), limits)
        context = feedback.CreateDefaultContext()
        give(feedback, context, state=state, nominal_state=nominal,
             nominal_acceleration=acceleration)
        assert read(feedback, context, "limited")[0] == 1.0
        give(feedback, context, vehicle_wrench=np.zeros(6))
        limited, u = read(feedback, context, "limited", "u")
        assert limited == cut
        assert np.max(np.abs(u[:6])) > 1e-3
        assert np.max(np.abs(u[6:])) <= joints * (1.0 + 1e-9)
