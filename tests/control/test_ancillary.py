"""Tests of `uvms_drake.control.ancillary`: the error dynamics that the two laws promise."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from support import dh

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.ancillary import AncillaryFeedback, limited_input
from uvms_drake.control.laws import Resolved, Transpose
from uvms_drake.control.laws.law import pair_of
from uvms_drake.control.limits import Limits
from uvms_drake.control.plan import DynamicPlan
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.euler import pose_difference
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state

K, SIGMA = 13.0, 4.0  # 1/s
U_LIMIT = np.array([0.4, 0.3, 0.35, 0.4, 0.5, 0.4, 6.0, 8.0, 8.0, 6.0])  # m/s² (3), rad/s² (7)


def not_asked() -> np.ndarray:
    raise AssertionError("the law has no use for it")


def resolved_input(model, state, nominal, acceleration, k, sigma) -> np.ndarray:
    return Resolved(k, sigma).command(
        model, pair_of(model, state, nominal), lambda: acceleration, not_asked).u()


def transpose_input(model, state, nominal, nominal_input, k, sigma, joints=False) -> np.ndarray:
    return Transpose(k, sigma, joints).command(
        model, pair_of(model, state, nominal), not_asked, lambda: nominal_input).u()


def pairs(model, states, where: str):
    """Yields a real state, a nominal one near it, a nominal acceleration and a disturbance."""
    rng = np.random.default_rng(20)
    for state in states[where]:
        y = model.task_pose(state[:10]) + rng.uniform(-0.05, 0.05, size=10)
        zeta = state[10:] + rng.uniform(-0.05, 0.05, size=10)
        nominal = np.concatenate([model.configuration(y), zeta])
        yield state, nominal, rng.uniform(-0.3, 0.3, size=10), rng.uniform(-0.1, 0.1, size=10)


def flow(state: np.ndarray, acceleration: np.ndarray, s: float) -> np.ndarray:
    """Returns (𝔮, ζ) to first order in the time s."""
    config, zeta = np.split(state, 2)
    return np.concatenate([config + s * configuration_rate(config, zeta), zeta + s * acceleration])


def errors(model, state: np.ndarray, nominal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns 𝔢_y = y − ȳ and 𝔯 = ζ − J_x(𝔮)⁻¹[J_x(𝔮̄)ζ̄ − σ𝔢_y], typed again."""
    (config, zeta), (nominal_config, nominal_zeta) = np.split(state, 2), np.split(nominal, 2)
    error = np.concatenate([dh.chi(config), config[6:]])
    error -= np.concatenate([dh.chi(nominal_config), nominal_config[6:]])
    reference = model.task_jacobian(nominal_config) @ nominal_zeta - SIGMA * error
    return error, zeta - np.linalg.solve(model.task_jacobian(config), reference)


@pytest.mark.parametrize("where", ["free", "skin", "deep"])
def test_the_law_resolved_leaves_exactly_its_cascade(model, states, derivative, where):
    """𝔢̇_y = −σ𝔢_y + J_x𝔯 and 𝔯̇ = −k𝔯 + d under ζ̇ = f + u + d, by differences along the flow."""
    for state, nominal, acceleration, d in pairs(model, states, where):
        u = resolved_input(model, state, nominal, acceleration, K, SIGMA)
        zeta_dot = model.drift(state[:10], state[10:]) + u + d
        error, deviation = errors(model, state, nominal)
        assert np.linalg.norm(error) > 0.01

        def along(s, state=state, nominal=nominal, zeta_dot=zeta_dot, a=acceleration):
            return np.concatenate(errors(model, flow(state, zeta_dot, s), flow(nominal, a, s)))

        error_rate, deviation_rate = np.split(derivative(along), 2)
        np.testing.assert_allclose(
            error_rate, -SIGMA * error + model.task_jacobian(state[:10]) @ deviation, atol=1e-7)
        np.testing.assert_allclose(deviation_rate, -K * deviation + d, atol=1e-6)


def test_the_law_resolved_keeps_a_closed_loop_within_its_bound(model):
    """‖𝔯‖ ≤ d̃/k and ‖𝔢_y‖ ≤ J̄d̃/(kσ) over 3 s from zero error, pressing into the wall."""
    y = np.array([0.0, 0.2, 0.1, 0.0, 0.0, 0.1, 0.0, 1.1, 0.47, 0.0])
    zeta = np.array([0.05, 0.02, 0.0, 0.0, 0.0, 0.05, 0.1, -0.05, 0.05, 0.1])
    plan = DynamicPlan.from_accelerations(
        0.0, 3.0, model.configuration(y), zeta, -zeta[None] / 3.0)
    bound, dt = 0.1, 0.003
    direction = np.linspace(1.0, -0.5, 10)
    direction *= bound / np.linalg.norm(direction)

    def rate(time: float, state: np.ndarray) -> np.ndarray:
        config, nominal_zeta, nominal_zeta_dot = plan.at(time)
        u = resolved_input(model, state, np.concatenate([config, nominal_zeta]),
                           nominal_zeta_dot, K, SIGMA)
        zeta_dot = model.drift(state[:10], state[10:]) + u + direction
        return np.concatenate([configuration_rate(state[:10], state[10:]), zeta_dot])

    state, worst, norms = np.concatenate([plan.config[0], zeta]), [], []
    for i in range(1000):
        middle = state + 0.5 * dt * rate(i * dt, state)
        state = state + dt * rate((i + 0.5) * dt, middle)
        nominal = np.concatenate(plan.at((i + 1) * dt)[:2])
        worst.append([np.linalg.norm(each) for each in errors(model, state, nominal)])
        norms.append(np.linalg.norm(model.task_jacobian(state[:10]), 2))
    worst_e, worst_r = np.max(worst, axis=0)
    assert 0.99 * bound / K < worst_r <= bound / K * (1.0 + 1e-3)
    assert worst_e <= np.max(norms) * bound / (K * SIGMA)
    assert worst_e > 0.2 * bound / (K * SIGMA), "the disturbance does something"


@pytest.mark.parametrize("where", ["free", "deep"])
def test_without_an_error_the_nominal_input_is_passed_on(model, states, where):
    acceleration = np.linspace(-0.3, 0.3, 10)
    for state in states[where]:
        nominal_input = acceleration - model.drift(state[:10], state[10:])
        np.testing.assert_allclose(
            resolved_input(model, state, state, acceleration, K, SIGMA), nominal_input,
            rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            transpose_input(model, state, state, nominal_input, K, SIGMA), nominal_input,
            atol=1e-12)


@pytest.mark.parametrize("where", ["free", "deep"])
def test_the_law_transpose_is_the_papers_as_its_proof_needs_it(model, states, where):
    """That is, u = ū − k(ζ − ζ̄) − kσJ(𝔮̄)ᵀ(χ − χ̄)."""
    for state, nominal, nominal_input, _ in pairs(model, states, where):
        error = dh.chi(state[:10]) - dh.chi(nominal[:10])
        J = model.task_jacobian(nominal[:10])[:6]
        expected = nominal_input - K * (state[10:] - nominal[10:]) - K * SIGMA * (J.T @ error)
        u = transpose_input(model, state, nominal, nominal_input, K, SIGMA)
        np.testing.assert_allclose(u, expected, atol=1e-12)


@pytest.mark.parametrize("where", ["free", "deep"])
def test_with_joints_the_law_transpose_feeds_back_the_extended_task(model, states, where):
    """That is, u = ū − k(ζ − ζ̄) − kσJ_x(𝔮̄)ᵀ(y − ȳ), y = (χ, q)."""
    for state, nominal, nominal_input, _ in pairs(model, states, where):
        y, y_nominal = (np.concatenate([dh.chi(x[:10]), x[6:10]]) for x in (state, nominal))
        J_x = model.task_jacobian(nominal[:10])
        expected = nominal_input - K * (state[10:] - nominal[10:]) - K * SIGMA * (
            J_x.T @ (y - y_nominal))
        u = transpose_input(model, state, nominal, nominal_input, K, SIGMA, joints=True)
        np.testing.assert_allclose(u, expected, atol=1e-12)


def turned(state: np.ndarray, angle: float) -> np.ndarray:
    """Returns the state seen after a turn of the whole world about the vertical, ψ in (−π, π]."""
    out = state.copy()
    out[:3] = dh.rotation("z", angle)[:3, :3] @ state[:3]
    out[5] = np.arctan2(np.sin(state[5] + angle), np.cos(state[5] + angle))
    return out


@pytest.mark.parametrize("law", [resolved_input, transpose_input])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_errors_across_the_jump_of_the_yaw_angle_are_small(uvms, states, law, sign):
    """Real yaw π − ε against nominal −π + ε gives the input of −ε against ε, from behind."""
    floor = UnilateralPlane(point=np.array([0.0, 0.0, 50.0]), normal=np.array([0.0, 0.0, -1.0]))
    model = ContactModel(uvms, check_surface(floor))  # The same seen from north and from south.
    for real, ideal, nominal, _ in pairs(model, states, "free"):
        real, ideal = real.copy(), ideal.copy()
        real[5] += -0.02 * sign - dh.chi(real[:10])[5]
        ideal[5] += 0.02 * sign - dh.chi(ideal[:10])[5]
        behind = turned(real, np.pi), turned(ideal, np.pi)
        assert abs(dh.chi(behind[0][:10])[5] - dh.chi(behind[1][:10])[5]) > 6.0
        np.testing.assert_allclose(law(model, *behind, nominal, K, SIGMA),
                                   law(model, real, ideal, nominal, K, SIGMA), atol=1e-9)


def test_the_difference_of_euler_angles_is_the_shorter_one():
    y, y_nominal = np.zeros(10), np.zeros(10)
    y[3:6], y_nominal[3:6] = [3.1, -3.1, 0.2], [-3.1, 3.1, 0.1]
    y[9], y_nominal[9] = 3.1, -3.1  # A joint angle is no angle modulo 2π.
    expected = np.zeros(10)
    expected[3:6] = 6.2 - 2 * np.pi, 2 * np.pi - 6.2, 0.1
    expected[9] = 6.2
    np.testing.assert_allclose(pose_difference(y, y_nominal), expected, atol=1e-12)


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
    plant = make_uvms_plant(model="girona500_arm5e", surface=plane,
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


def test_the_pair_is_the_measured_and_the_nominal_motion(model, states):
    real, nominal = states["free"][:2]
    feedback = AncillaryFeedback(model, Resolved())
    context = feedback.CreateDefaultContext()
    for name, value in (("state", real), ("nominal_state", nominal)):
        feedback.GetInputPort(name).FixValue(context, value)
    now = feedback.GetOutputPort("pair").Eval(context)
    y, J_x, J_x_dot = model.task_motion(real[:10], real[10:])
    for value, expected in ((now.y[0], y), (now.J_x[0], J_x), (now.J_x_dot[0], J_x_dot),
                            (now.inverse @ J_x, np.eye(10)), (now.zeta[0], real[10:]),
                            (now.y[1], model.task_pose(nominal[:10]))):
        np.testing.assert_allclose(value, expected, atol=1e-12)


@pytest.mark.parametrize(("config", "needed"), [
    (Resolved(), "nominal_acceleration"), (Transpose(), "nominal_input")])
def test_a_law_asks_only_for_the_ports_that_it_reads(model, states, config, needed):
    feedback = AncillaryFeedback(model, config)
    context = feedback.CreateDefaultContext()
    for name in ("state", "nominal_state"):
        feedback.GetInputPort(name).FixValue(context, states["free"][0])
    feedback.GetInputPort(needed).FixValue(context, np.zeros(10))
    assert np.all(np.isfinite(feedback.GetOutputPort("u").Eval(context)))


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


@pytest.mark.parametrize("where", ["free", "skin", "deep"])
def test_with_a_measured_force_the_law_resolved_asks_nothing_of_the_surface(model, states, where):
    """Only M⁻¹Jᵀ(𝔉_s − 𝔉) is added to what a perfect model commands, whatever the true 𝔉 is."""
    rng = np.random.default_rng(5)
    for state, nominal, acceleration, _ in pairs(model, states, where):
        true, off = rng.normal(size=6) * [30.0, 30.0, 30.0, 1.0, 1.0, 1.0], rng.normal(size=6)
        now = pair_of(model, state, nominal)
        known, felt, wrong = (
            Resolved(K, SIGMA).command(
                model, now._replace(contact=contact), lambda a=acceleration: a, not_asked).u()
            + model.drift(state[:10], state[10:], contact if contact is None else true)
            for contact in (None, true, true + off))
        np.testing.assert_allclose(felt, known, rtol=1e-9, atol=1e-9)
        kinematics = model.kinematics(state[:10])
        np.testing.assert_allclose(wrong - felt, np.linalg.solve(
            model.mass_matrix(kinematics), kinematics.J_chi.T @ off), rtol=1e-8, atol=1e-9)


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

    known, measured = tau(), feedback.GetInputPort("measured_force")
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


def test_a_command_within_the_limits_is_passed_on_bit_for_bit(model, states):
    for M, u, tau in commands(model, states, 0.9):
        for tau_limit in (None, 1.001 * np.abs(tau)):
            cut_u, cut_tau, limited = limited_input(u, tau, M, U_LIMIT, tau_limit)
            assert cut_u is u
            assert cut_tau is tau
            assert not limited


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


@pytest.mark.parametrize(("limits", "key"), [
    (Limits(u=U_LIMIT[:6]), "limits.u"), (Limits(u=-U_LIMIT), "limits.u"),
    (Limits(u=U_LIMIT, tau=np.zeros(10)), "limits.tau")])
def test_a_limit_that_has_no_meaning_is_named(model, limits, key):
    with pytest.raises(InvalidParameter) as caught:
        AncillaryFeedback(model, Resolved(), limits)
    assert caught.value.key == key


@pytest.mark.parametrize("law", [Resolved, Transpose])
@pytest.mark.parametrize(("key", "value"), [
    ("k", 0.0), ("k", -1.0), ("k", np.inf), ("sigma", 0.0), ("sigma", np.nan)])
def test_a_gain_that_is_not_positive_is_named(model, law, key, value):
    with pytest.raises(InvalidParameter) as caught:
        AncillaryFeedback(model, law(**{key: value}))
    assert caught.value.key == key
