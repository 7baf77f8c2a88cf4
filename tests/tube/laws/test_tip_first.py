"""Tests of `uvms_drake.tube.laws.tip_first` and of the image that it uses."""

import numpy as np
import pytest
from support.force_reading import reading_off
from support.tiny_robots import tiny_robot

from uvms_drake.control.laws import TipFirst
from uvms_drake.control.laws.law import pair_of
from uvms_drake.control.laws.outputs import outputs_of, tip_rows
from uvms_drake.control.laws.tip_first import BlockGains
from uvms_drake.model.signals.command_path import CommandPath
from uvms_drake.tube.constants import Constant
from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds, reading_input
from uvms_drake.tube.estimates import CertificateSettings, no_estimates
from uvms_drake.tube.law_tube import Basis
from uvms_drake.tube.laws.tip_first import (
    DisturbanceInputs,
    in_joints,
    loop_gains,
    tip_first_law_tube,
)
from uvms_drake.tube.laws.tip_first_image import (
    arm_of,
    configuration_of,
    output_jacobian,
    tip_first_remainders,
)
from uvms_drake.tube.row_gains import moments
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.search_problem import nominal_motion

BOUNDS = ConstraintSet(
    q_lower=np.array([-0.2, 1.0, 0.2, -0.3]), q_upper=np.array([0.2, 1.2, 0.45, 0.3]), roll=0.1,
    pitch=0.1, tip_pitch=0.4, nu1=0.15, nu2=0.1, qdot=0.8)
FEW = CertificateSettings(constant_samples=10, tube_samples=10, terminal_samples=10)


def states(model, seed: int) -> tuple[np.ndarray, ...]:
    """Returns 𝔮̄, ζ̄ and ū (10,), and errors x, x' (10,) of outputs."""
    rng = np.random.default_rng(seed)
    config, zeta = BOUNDS.sample(model, 1, rng)
    return (config[0], zeta[0], 0.3 * rng.normal(size=10), 0.01 * rng.normal(size=10),
            0.02 * rng.normal(size=10))


@pytest.mark.parametrize("seed", range(3))
def test_the_rests_are_what_the_law_does_beyond_its_linear_part(model, seed):
    config, zeta, u, x, x_dot = states(model, seed)
    law, rows = TipFirst(BlockGains(3.0, 2.0), BlockGains(20.0, 10.0)), tip_rows(model)
    found = tip_first_remainders(
        model, rows, nominal_motion(model, config, zeta), u, x, x_dot)
    # The real state by the errors of the outputs, and the law in it.
    real_config = configuration_of(model, rows, config, model.kinematics(config), x)
    kinematics = model.kinematics(real_config)
    J = output_jacobian(model, real_config, kinematics, rows)
    e, e_dot = (np.append(each[:6], J[6:, 6:] @ each[6:]) for each in (x, x_dot))
    y_dot = output_jacobian(model, config, model.kinematics(config), rows) @ zeta
    real_zeta = np.linalg.solve(J, y_dot + e_dot)
    now = pair_of(model, np.append(real_config, real_zeta), np.append(config, zeta))
    out = outputs_of(now, rows)
    np.testing.assert_allclose(out.error, e, atol=1e-9)
    np.testing.assert_allclose(out.rate[0] - out.rate[1], e_dot, atol=1e-9)
    acceleration = u + model.drift(config, zeta)
    command = law.command(model, now, lambda: acceleration, lambda: u)
    k, sigma = law.gains("k", 4), law.gains("sigma", 4)
    linear = np.linalg.solve(J, -(k + sigma) * e_dot - k * sigma * e)
    M, M_bar = (model.mass_matrix(each) for each in (kinematics, model.kinematics(config)))
    expected = np.concatenate([
        real_zeta - zeta, real_config[6:] - config[6:],
        (kinematics.chi - model.kinematics(config).chi)[3:], command.u - u - linear,
        command.tau - M_bar @ u - M @ linear])
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_the_rests_have_derivatives_by_complex_steps(model, derivative):
    config, zeta, u, x, x_dot = states(model, 4)
    rows, along = tip_rows(model), np.random.default_rng(1).normal(size=(5, 10))

    def moved(step):
        here, rate, *others = (each + step * way for each, way in zip(
            (config, zeta, u, x, x_dot), along, strict=True))
        return tip_first_remainders(model, rows, nominal_motion(model, here, rate), *others)

    found = moved(1e-30j).imag / 1e-30
    np.testing.assert_allclose(found, derivative(moved), atol=1e-4 * np.max(np.abs(found)))


@pytest.mark.parametrize(("k", "sigma"), [(20.0, 5.0), (8.0, 8.0), (2000.0, 1.0)])
def test_the_first_moments_are_those_of_the_impulse_responses(k, sigma):
    found = moments(k, sigma)
    assert found.position == pytest.approx((k + sigma) / (k * sigma) ** 2, rel=1e-5)
    assert found.error == pytest.approx(k**-2, rel=1e-5)
    # ∫t|ġ|dt in parts, with the maximum of g at t*.
    k, sigma = 1.000001 * k, sigma
    late = np.log(k / sigma) / (k - sigma)
    g = (np.exp(-sigma * late) - np.exp(-k * late)) / (k - sigma)
    until = ((1.0 - np.exp(-sigma * late)) / sigma - (1.0 - np.exp(-k * late)) / k) / (k - sigma)
    expected = 2.0 * late * g - 2.0 * until + 1.0 / (k * sigma)
    assert found.velocity == pytest.approx(expected, rel=1e-4)
    # ∫t|w| likewise: 1 − (1 + at)e^{−at} is the integral of a²te^{−at}, and there is a zero at 2t*.
    rest = [(1.0 + a * 2.0 * late) * np.exp(-a * 2.0 * late) for a in (sigma, k)]
    assert found.input == pytest.approx(2.0 * (rest[0] - rest[1]) / (k - sigma), rel=1e-4)


def test_what_the_rows_change_meanwhile_costs_no_more_than_the_moment_says():
    """The error G∗(J D) against J(t)(G∗D), for a J that turns and a D that jumps."""
    k, sigma, h, turning = 12.0, 6.0, 1e-3, 0.7
    rng, worst = np.random.default_rng(2), 0.0
    for _ in range(20):
        e, own = np.zeros((2, 2, 2))  # (e, ė) of either, two components
        for i in range(1500):
            if i % 50 == 0:
                D = rng.normal(size=2)
                D /= np.linalg.norm(D)
            angle = turning * i * h
            J = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            for z, sensor_effect in ((e, J @ D), (own, D)):
                z[1] += h * (sensor_effect - (k + sigma) * z[1] - k * sigma * z[0])
                z[0] += h * z[1]
        worst = max(worst, float(np.linalg.norm(e[0] - J @ own[0])))
    assert 0.05 < worst / (turning * moments(k, sigma).position) < 1.0


def test_an_arm_that_can_be_stretched_is_found_out():
    """Its J_sq loses rank in the middle of the set, which no sample hits."""
    axes, anchors = [[0, 0, 1], [0, 1, 0], [0, 1, 0]], [[0.5, 0, 0], [0.1, 0, 0], [0.3, 0, 0]]
    arm = tiny_robot(axes, anchors, (0.3, 0.0, 0.0))
    for lower, regular in ((0.3, True), (-0.31, False)):
        bounds = ConstraintSet(
            q_lower=np.array([-0.1, 0.2, lower]), q_upper=np.array([0.1, 0.4, 0.9]), roll=0.1,
            pitch=0.1, tip_pitch=1.4, nu1=0.1, nu2=0.1, qdot=0.1)
        found = arm_of(arm, bounds, np.arange(3), FEW)
        assert (found.regular > 0.0) == regular
        assert np.isfinite(found.carried) == regular


def test_under_a_tilted_frame_an_arm_has_no_more_authority_than_at_its_worst_heading():
    """Above a floor: its wrist pitches the tool at one heading, and yaws it at another."""
    axes = [[0, 0, 1], [0, 1, 0], [0, 1, 0], [0, 1, 0]]
    anchors = [[0.5, 0, 0], [0.1, 0, 0], [0.3, 0, 0], [0.25, 0, 0]]
    arm = tiny_robot(axes, anchors, (0.15, 0.0, 0.0), task_frame=(0.0, -0.5 * np.pi, 0.0))
    bounds = ConstraintSet(
        q_lower=np.array([-0.1, -0.2, -0.8, -0.7]), q_upper=np.array([0.1, -0.1, -0.7, -0.6]),
        roll=0.05, pitch=0.05, tip_pitch=1.0, nu1=0.1, nu2=0.1, qdot=0.1)
    rows, rng, least = np.array([0, 1, 2, 4]), np.random.default_rng(6), []
    for yaw in (0.0, np.pi):
        config = np.zeros((2000, 10))
        config[:, 3:6] = rng.uniform(-1.0, 1.0, (2000, 3)) * [bounds.roll, bounds.pitch, yaw]
        config[:, 6:] = rng.uniform(bounds.q_lower, bounds.q_upper, (2000, 4))
        J_sq = arm.task_jacobian(config)[:, rows][..., 6:]
        least.append(np.min(np.linalg.svd(J_sq, compute_uv=False)[:, -1]))
    assert least[0] > 0.05 > 10.0 * least[1]
    assert arm_of(arm, bounds, rows, FEW).regular <= least[1]


def basis(model, **changed) -> Basis:
    """Returns data with constants that are not what they would be, but larger."""
    known = {name: Constant(name, value, "proven", 1, value) for name, value in (
        ("J_position_max", 3.0), ("J_dot_max", 1.0))}
    values = {"model": model, "declared": BOUNDS, "constants": known, "d_bound": 0.05,
              "weights": np.ones(model.size), "u_limit": np.repeat([0.5, 20.0], [6, 4]),
              "settings": FEW}
    return Basis(**(values | changed))


@pytest.mark.parametrize(("law", "message"), [
    (TipFirst(rows=["x", "y", "q3", "q4"]), "rows of the tip's task, z is not among them"),
    (TipFirst(undriven=["roll"]), "undriven roll, of which no bound is known"),
    (TipFirst(tip=BlockGains(20.0, 10.0, observer=2.0)),
     "an observer of tip, of which no tube is proven")])
def test_what_has_no_bound_is_void_and_says_so(model, law, message):
    found = tip_first_law_tube(law, basis(model))
    assert [condition.name for condition in found.conditions if not condition.holds] == [message]


def test_a_soft_vehicle_costs_the_tip_nothing_and_the_joints_much(model, monkeypatch):
    """To first order, which is enough for this."""
    monkeypatch.setattr("uvms_drake.tube.search.second_search.supremum",
                        lambda problem, x, values, *effort: np.max(values, axis=0))
    soft, stiff = (tip_first_law_tube(
        TipFirst(BlockGains(k, k), BlockGains(20.0, 10.0)), basis(model))
        for k in (4.0, 8.0))
    assert all(condition.holds for condition in soft.conditions)
    assert soft.radii.position == pytest.approx(3.0 * 0.05 / 200.0) == stiff.radii.position
    assert soft.budget["vehicle"]["d"] == pytest.approx(0.05 / 16.0)
    assert soft.radii.roll == pytest.approx(0.05 / 16.0 / np.sqrt(1.0 - np.sin(0.1)))
    assert soft.radii.joints > 2.0 * stiff.radii.joints > 0.0
    assert soft.radii.u[0] < 2.0 * 0.05  # the vehicle's own, whatever the arm has to do


def test_no_push_moves_the_joints_further_than_claimed(model):
    """The worst d along a motion, which is known: that which J_sq⁻¹(T)J_s(t) answers to most."""
    k, sigma, rows, v = 20.0, 10.0, tip_rows(model), np.array([0.0, 0.0, 1.0, 0.0])
    t, nominal = np.linspace(0.0, 1.0, 401), 0.5 * (BOUNDS.q_lower + BOUNDS.q_upper)
    config = np.zeros((len(t), model.size))
    config[:, 6:] = nominal + np.multiply.outer(np.sin(3.0 * t), 0.4 * (BOUNDS.q_upper - nominal))
    J_s = model.task_jacobian(config)[:, rows]
    turning = float(np.max(np.linalg.norm(np.diff(J_s, axis=0), 2, axis=(1, 2)))) / t[1]
    data = basis(model, constants={"J_dot_max": Constant(
        "J_dot_max", turning, "proven", 1, turning)})
    arm = arm_of(model, BOUNDS, rows, FEW)
    claim = in_joints(
        data, arm, loop_gains(k, sigma, data), DisturbanceInputs(data))["d"]
    inverse = np.linalg.inv(J_s[-1, :, 6:])
    answer, age = np.linalg.norm(v @ inverse @ J_s, axis=1), t[-1] - t
    slow, fast = np.exp(-sigma * age), np.exp(-k * age)
    g = np.array([slow - fast, k * fast - sigma * slow, k**2 * fast - sigma**2 * slow])
    worst = 0.05 * np.trapezoid(np.abs(g) / (k - sigma) * answer, t)
    assert (worst <= claim[:3]).all()
    assert (worst >= 0.2 * claim[:3]).all(), worst / claim[:3]


SENSED = MeasuredForceBounds(size=50.0, rate=0.0, ripple=0.0, tangential_rate=0.0,
                             tangential_ripple=0.0, tool_angle=0.2,
                             reading=reading_off(2.0, 0.1, 0.02, 0.01))


@pytest.mark.long
def test_a_reading_adds_to_the_input_and_to_the_forces(model, monkeypatch):
    """To both limits, what is off while the tip turns beside the error in rest."""
    given = []

    def reading(model, declared, force, torque, settings):
        given.append((force, torque))
        return (len(given) - 1.0) * np.arange(20.0), no_estimates

    monkeypatch.setattr("uvms_drake.tube.laws.tip_first.reading_input", reading)
    monkeypatch.setattr("uvms_drake.tube.search.second_search.supremum",
                        lambda problem, x, values, *effort: np.max(values, axis=0))
    monkeypatch.setattr("uvms_drake.tube.search.joint_search.GRID_POINTS", 16)
    monkeypatch.setattr("uvms_drake.tube.search.joint_search.ROUNDS", 0)
    law, felt = TipFirst(BlockGains(20.0, 20.0), BlockGains(50.0, 50.0)), basis(
        model, contact=SENSED, forces=True)
    without, found = (tip_first_law_tube(law, felt).radii for _ in range(2))
    added = np.concatenate([found.u - without.u, found.tau - without.tau])
    np.testing.assert_allclose(added, np.arange(20.0), atol=1e-9)
    # At least what the joints of the arm turn the tip by, one at a time and at their limit.
    J = model.kinematics(np.append(np.zeros(6), 0.5 * (BOUNDS.q_lower + BOUNDS.q_upper))).J_links
    turning = BOUNDS.nu2 + BOUNDS.qdot * np.max(np.linalg.norm(J[-1, 3:, 6:], axis=0))
    assert given[0][0] >= 2.0 + turning * 50.0 * 0.03
    assert given[0][1] == 0.1


def test_what_a_reading_adds_is_reached(model, monkeypatch):
    monkeypatch.setattr("uvms_drake.tube.search.joint_search.GRID_POINTS", 256)
    monkeypatch.setattr("uvms_drake.tube.search.joint_search.ROUNDS", 4)
    lower, upper, rng = BOUNDS.q_lower, BOUNDS.q_upper, np.random.default_rng(0)
    most = reading_input(model, BOUNDS, 3.0, 0.2, FEW)[0] / FEW.safety_factor
    reached = np.zeros(20)
    for _ in range(100):
        config = np.append(np.zeros(6), rng.uniform(lower, upper))
        kinematics = model.kinematics(config)
        J = kinematics.J_links[-1]
        forces = J.T * np.sign(rng.normal())
        rows = np.concatenate([np.linalg.solve(model.mass_matrix(kinematics), forces), forces])
        for i, row in enumerate(rows):
            e = np.concatenate([3.0 * row[:3] / max(np.linalg.norm(row[:3]), 1e-9),
                                0.2 * row[3:] / max(np.linalg.norm(row[3:]), 1e-9)])
            reached[i] = max(reached[i], (rows @ e)[i])
    assert (reached <= most + 1e-9).all()
    assert (reached >= 0.8 * most).all()


def test_commands_that_act_late_have_no_tube_and_say_so(model):
    path = CommandPath(0.02, 0.01, dead_time=0.04, lag=0.15)
    found = tip_first_law_tube(TipFirst(BlockGains(4.0, 4.0), BlockGains(20.0, 10.0)),
                               basis(model, command_path=path))
    assert [item.topic for item in found.conditions if not item.holds] == ["actuation path"]
    assert found.radii.position is None and not found.budget
