"""`control.feedback.tube_monitor` alone; `test_tube_in_contact` has it on the full dynamics."""

import logging

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from support.scripts import Script, report_of, use_fixed_steps
from support.tube_bounds import resolved_preimage_tube, rise

import uvms_drake as uv
from uvms_drake.common.alarm import LOGGER
from uvms_drake.control.feedback.tube_monitor import ALARMS, FIELDS, SAID, TubeMonitor
from uvms_drake.control.laws.law import Deviation, pair_of
from uvms_drake.control.laws.resolved import gains_and_growth
from uvms_drake.papers.nikou2018 import Transpose
from uvms_drake.tube.row_gains import resolved_tube

LAW = uv.Resolved(k=20.0, sigma=5.0)
D_BOUND = 0.1
WEIGHTS = np.array([0.1, 0.05, 0.2, 0.3, 0.1, 0.15, 0.9, 0.8, 0.6, 1.0])


@pytest.fixture
def pair(states) -> tuple[np.ndarray, np.ndarray]:
    """A real and a nominal state (20,), a few millimetres and mm/s apart."""
    nominal = states["deep"][3]
    return nominal + 0.004 * np.random.default_rng(5).normal(size=20), nominal


def deviation(model, law, state, nominal_state) -> Deviation:
    return law.deviation(pair_of(model, state, nominal_state))


def test_the_errors_are_those_of_the_laws(model, pair):
    real, nominal = pair
    (q, zeta), (q_n, zeta_n) = np.split(real, 2), np.split(nominal, 2)
    J, J_n = model.task_jacobian(q), model.task_jacobian(q_n)
    e_y = model.task_pose(q) - model.task_pose(q_n)
    z = zeta - zeta_n
    now = deviation(model, LAW, real, nominal)
    np.testing.assert_allclose(now.e_y, e_y, atol=1e-12)
    # The first equation of the cascade defines 𝔯: 𝔢̇_y = −σ𝔢_y + J_x 𝔯.
    np.testing.assert_allclose(
        J @ now.r, J @ zeta - J_n @ zeta_n + LAW.sigma * e_y, atol=1e-12)
    blocks = [e_y, e_y[:3], e_y[3:6], e_y[6:], z, now.r]
    np.testing.assert_allclose(now.norms, [np.linalg.norm(x) for x in blocks], atol=1e-12)
    gains, _ = gains_and_growth(pair_of(model, *pair), np.ones(10))
    np.testing.assert_allclose(
        gains, [np.linalg.norm(rows, 2) for rows in (J, J[:3], J[3:6])] + [1.0, 1.0])
    w = np.linalg.norm(np.linalg.solve(J, e_y))
    x = np.array([now.norms[5], 0.0, 0.0, 0.0, 0.0, w])
    bound = LAW.run_bound(D_BOUND, np.ones(10)).bounds(x, pair_of(model, *pair))
    assert now.norms[4] <= bound[4] + 1e-12

    transpose = Transpose(k=20.0, sigma=1.5)
    now = deviation(model, transpose, real, nominal)
    np.testing.assert_allclose(now.r, z + 1.5 * J_n[:6].T @ e_y[:6], atol=1e-12)
    assert now.norms[0] == pytest.approx(np.linalg.norm(e_y[:6]))


def test_mu_bounds_how_fast_the_preimage_grows_by_the_turning_of_j(model, pair):
    real, nominal = pair
    _, mu = gains_and_growth(pair_of(model, real, nominal), np.ones(10))
    rate = uv.configuration_rate(real[:10], real[10:])
    J, forward, backward = (model.task_jacobian(real[:10] + s * rate) for s in (0.0, 1e-5, -1e-5))
    turning = np.linalg.solve(J, forward - backward) / 2e-5
    w = np.random.default_rng(0).normal(size=(1000, 10))
    growth = -np.sum(w * (w @ turning.T), axis=1) / np.sum(w * w, axis=1)
    assert np.max(growth) <= mu
    eigenvalue = np.linalg.eigvalsh(-0.5 * (turning + turning.T))[-1]
    assert mu == pytest.approx(eigenvalue, rel=1e-6)


def scripted(model, law=LAW, radii=None, state=None, nominal=None, disturbance=None, safety=None,
             **options):
    """Returns a Simulator of a monitor fed by a `Script`, and the monitor."""
    builder = DiagramBuilder()
    signals = {"state": state, "nominal": nominal}
    if disturbance is not None:
        signals["disturbance"] = disturbance
    if safety is not None:
        signals["safety"] = safety
    script = builder.AddSystem(Script(**signals))
    monitor = TubeMonitor.AddToBuilder(
        builder, model, law, D_BOUND, radii or {}, **options, state=script.GetOutputPort("state"),
        nominal_state=script.GetOutputPort("nominal"),
        disturbance=script.GetOutputPort("disturbance") if disturbance is not None else None,
        safety=script.GetOutputPort("safety") if safety is not None else None)
    simulator = Simulator(builder.Build())
    use_fixed_steps(simulator)
    return simulator, monitor, monitor.GetMyContextFromRoot(simulator.get_context())


def test_after_a_trip_neither_deviations_nor_disturbances_count(model, states):
    at_rest = np.concatenate([states["free"][0][:10], np.zeros(10)])
    simulator, monitor, context = scripted(
        model, radii={"position": 0.001}, nominal=lambda t: at_rest,
        state=lambda t: at_rest + 0.01 * np.eye(20)[0] * (t > 0.5),
        disturbance=lambda t: 0.2 * np.eye(10)[0] * (t > 0.5),
        safety=lambda t: np.array([float(t > 0.4), 1.0, 0.4, np.nan, 0.0]))
    simulator.AdvanceTo(1.0)
    report = report_of(monitor, context)
    assert report["set_exits"] == report["disturbance_exits"] == 0.0
    assert report["worst_disturbance"] == 0.0


@pytest.mark.parametrize("weights", [np.ones(10), WEIGHTS], ids=["ball", "weighted"])
def test_the_bounds_are_those_of_the_certificate_where_j_stands_still(model, pair, weights):
    """The configurations are held, but not the velocities, so that J̇ is not zero."""
    simulator, monitor, context = scripted(
        model, state=lambda t: pair[0], nominal=lambda t: pair[1], weights=weights)
    J, J_n = (model.task_jacobian(state[:10]) for state in pair)
    _, mu = gains_and_growth(pair_of(model, *pair), np.ones(10))
    assert abs(mu) > 0.05
    offset = np.linalg.norm(np.linalg.solve(J, (J_n - J) @ pair[1][10:]))
    assert offset > 1e-4
    for t in (0.0, 0.05, 0.3, 2.0):
        simulator.AdvanceTo(t)
        bound = dict(zip(FIELDS, monitor.GetOutputPort("bound").Eval(context), strict=True))
        for name, rows in (("task", J), ("position", J[:3]), ("orientation", J[3:6]),
                           ("joints", J[6:])):
            gain = np.linalg.norm(rows @ np.diag(weights), 2)
            tube = resolved_tube(LAW.k, LAW.sigma, D_BOUND, gain)
            assert bound[name] == pytest.approx(rise(tube, t)[0], abs=1e-8)
        W, R = rise(resolved_preimage_tube(LAW.k, LAW.sigma, D_BOUND, mu), t)
        assert bound["r"] == pytest.approx(R, abs=1e-7)
        assert bound["z"] == pytest.approx(R + LAW.sigma * W + offset, abs=1e-7)


@pytest.mark.parametrize("period", [0.01, 0.0])
def test_exits_are_counted_and_said_and_the_first_one_is_dated(model, states, period, caplog):
    """Out of the set-wise tube twice, and of the disturbance's bound three times."""
    at_rest = np.concatenate([states["free"][0][:10], np.zeros(10)])

    def state(t):
        moved = at_rest.copy()
        moved[0] += 0.002 * (0.3 < t < 0.5) + 0.004 * (0.7 < t < 0.8)
        return moved

    def disturbance(t):
        return 0.15 * np.eye(10)[0] * (np.sin(2.0 * np.pi * t / 0.4) > 0.5)

    simulator, monitor, context = scripted(
        model, radii={"position": 0.001, "r": 1.0}, state=state, nominal=lambda t: at_rest,
        disturbance=disturbance, period=period)
    caplog.set_level(logging.WARNING, LOGGER.name)
    alarm = monitor.GetOutputPort("alarm")
    simulator.AdvanceTo(0.25)
    np.testing.assert_array_equal(alarm.Eval(context), [0.0, 0.0, 0.0])
    report = report_of(monitor, context)
    assert report["set_exits"] == report["trajectory_exits"] == 0.0
    assert report["set_first_exit"] == report["trajectory_first_exit"] == np.inf
    simulator.AdvanceTo(0.45)
    np.testing.assert_array_equal(alarm.Eval(context), [1.0, 1.0, 1.0])
    simulator.AdvanceTo(1.2)
    report = report_of(monitor, context)
    assert report["set_exits"] == 2.0
    assert report["set_first_exit"] == pytest.approx(0.305, abs=0.006)
    assert report["worst_set_position"] == pytest.approx(4.0)
    assert report["worst_set_orientation"] == 0.0  # not checked, and no deviation
    assert report["trajectory_exits"] > 0.0
    assert report["disturbance_exits"] == 3.0
    assert report["disturbance_first_exit"] == pytest.approx(0.04, abs=0.011)
    assert report["worst_disturbance"] == pytest.approx(1.5)
    for name, text in zip(ALARMS, SAID, strict=True):
        said = [message for message in caplog.messages if message.endswith(f" s: {text}")]
        assert len(said) == report[f"{name}_exits"]
        assert said[0] == f"t = {report[f'{name}_first_exit']:g} s: {text}"


def test_a_disturbance_is_measured_by_the_bounds_of_its_components(model, states):
    """0.03 m/s² is 3 times what a hull of 0.01 m/s² is bounded by, and nothing to a joint."""
    at_rest = np.concatenate([states["free"][0][:10], np.zeros(10)])
    for channel, ratio in ((0, 3.0), (9, 0.3)):
        simulator, monitor, context = scripted(
            model, state=lambda t: at_rest, nominal=lambda t: at_rest, weights=WEIGHTS,
            disturbance=lambda t, channel=channel: 0.03 * np.eye(10)[channel])
        simulator.AdvanceTo(0.1)
        report = report_of(monitor, context)
        assert report["worst_disturbance"] == pytest.approx(ratio)
        assert report["disturbance_exits"] == (ratio > 1.0)
