"""Tests of `identify`: parameters of synthetic logs within their intervals, refusals, files."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from support.synthetic_logs import TRUTH, synthetic_logs

import uvms_drake as uv
from uvms_drake.common.errors import InvalidParameter, RunFailed
from uvms_drake.common.schema import load_typed, parse_yaml
from uvms_drake.identification import estimate
from uvms_drake.identification.checks import clock_shift, complaint
from uvms_drake.identification.estimate import (
    Estimate,
    Quadratic,
    constrained_step,
    estimated,
    student,
)
from uvms_drake.identification.identify import LEAST_FREEDOM, identify, with_velocities
from uvms_drake.identification.local_fit import local_quadratic
from uvms_drake.identification.log import GRID, Log, on_grid
from uvms_drake.identification.parameters import parameters_of
from uvms_drake.identification.robot_file import with_numbers
from uvms_drake.identification.windows import TURNING, windows_of
from uvms_drake.identification.written import format_hydrodynamics, format_unknowns
from uvms_drake.model.description.hydrodynamics_file import HydrodynamicParameters
from uvms_drake.model.robot import Robot
from uvms_drake.model.uvms_model import UvmsModel


@functools.cache
def one_log() -> Log:
    return synthetic_logs("bluerov2_alpha5", 2, 1)[0]


@pytest.fixture(scope="module")
def found():
    return identify("bluerov2_alpha5", synthetic_logs("bluerov2_alpha5", 1, 5))


@pytest.mark.slow
def test_parameters_of_a_wrong_robot_are_found_within_their_intervals(found):
    """Three quarters at least, in a single draw of intervals of 95 %."""
    by_name = {each.parameter.name: each for each in found.identified}
    assert {"vehicle.added_mass.roll", "vehicle.added_mass.pitch"} <= set(by_name)
    inside = [abs(each.theta - TRUTH.get(name, 0.0)) <= each.half
              for name, each in by_name.items()]
    assert np.mean(inside) >= 0.75
    for name in ("vehicle.added_mass.roll", "vehicle.added_mass.pitch"):
        assert by_name[name].theta == pytest.approx(0.3, abs=0.15)


@pytest.mark.slow
def test_what_the_logs_do_not_excite_is_not_identified(found):
    why = {each.parameter.name: each.why for each in found.results}
    for name in ("vehicle.added_mass.surge", "vehicle.quadratic_drag.heave", "displaced_volume"):
        assert why[name] == "the logs do not excite it"
    assert all(each.theta == 0.0 for each in found.results if each.why)


@pytest.mark.slow
def test_the_file_has_the_identified_numbers_and_the_rest_as_it_was(found):
    text = format_hydrodynamics(found, {"log0": "ab" * 32})
    read = load_typed(HydrodynamicParameters, parse_yaml(text))
    before = found.robot.uvms.hydrodynamics.bodies["vehicle"]
    after = read.bodies["vehicle"]
    result = next(each for each in found.results
                  if each.parameter.name == "vehicle.added_mass.roll")
    assert after.added_mass[0].matrix[3] == pytest.approx(result.value, rel=1e-5)
    assert after.added_mass[0].matrix[0] == before.added_mass[0].matrix[0]
    assert "log0 (SHA-256 abababab" in text and "# TUHH ID" in text
    assert text.count("not identified") == 0


@pytest.mark.slow
def test_the_unknowns_are_a_model_error_of_a_scenario(found, tmp_path):
    path = tmp_path / "with_unknowns.yaml"
    path.write_text(f"base: bluerov2_contact\n{format_unknowns(found, {'log0': 'ab'})}",
                    encoding="utf-8")
    scenario = uv.load_scenario(str(path))
    error, identified = scenario.model_error, scenario.identified
    assert identified.logs == ["log0 (SHA-256 ab)"]
    assert identified.qdot == found.excitation["qdot"] > 0.0 == identified.nu1
    half = next(each.half / (1.0 + each.theta) for each in found.results
                if each.parameter.name == "vehicle.added_mass.roll")
    assert error.by_axis("vehicle", "added_mass")[3] - 1.0 == pytest.approx(half, abs=1e-4)
    assert error.by_axis("vehicle", "added_mass")[0] == 1.0


def test_numbers_of_a_file_are_replaced_where_they_are():
    text = ("fluid_density: 1000.0\nbodies:\n  vehicle:\n    # why\n"
            "    displaced_volume: 0.01  # m3\n    added_mass:\n      - matrix:  # rows\n"
            + "".join(f"          - {[1.0 if i == j else 0.0 for j in range(6)]}\n"
                      for i in range(6)) + "    drag:\n      - {linear: [1, 1, 1, 1, 1, 1]}\n")
    before = load_typed(HydrodynamicParameters, parse_yaml(text))
    body = before.bodies["vehicle"]
    new = replace(body, displaced_volume=0.02, center_of_buoyancy=np.array([0.0, 0.0, -0.1]),
                  added_mass=[replace(body.added_mass[0], matrix=2.0 * np.eye(6))])
    changed = with_numbers(text, before, replace(before, bodies={"vehicle": new}))
    read = load_typed(HydrodynamicParameters, parse_yaml(changed)).bodies["vehicle"]
    np.testing.assert_array_equal(read.added_mass[0].matrix, 2.0 * np.eye(6))
    assert (read.displaced_volume, read.center_of_buoyancy[2]) == (0.02, -0.1)
    assert "# why" in changed and "# m3" in changed


def test_a_number_that_was_a_default_is_written_in_flow_style_too():
    """In front of the other keys of the body."""
    rows = "[" + ", ".join(str([float(i == j) for j in range(6)]) for i in range(6)) + "]"
    text = ("bodies:\n  vehicle: {displaced_volume: 0.01, added_mass: [{matrix: " + rows + "}], "
            "drag: [{linear: [1, 1, 1, 1, 1, 1]}]}\n")
    before = load_typed(HydrodynamicParameters, parse_yaml(text))
    new = replace(before.bodies["vehicle"], center_of_buoyancy=np.array([0.0, 0.0, -0.1]))
    changed = with_numbers(text, before, replace(before, bodies={"vehicle": new}))
    read = load_typed(HydrodynamicParameters, parse_yaml(changed)).bodies["vehicle"]
    assert (read.displaced_volume, read.center_of_buoyancy[2]) == (0.01, -0.1)


def test_a_missing_attitude_spoils_no_other_one():
    time = np.arange(0.0, 20.0, 0.02)
    rpy = np.column_stack([0.1 * np.sin(time), 0.1 * np.cos(time), 4.0 * np.pi * time / 20.0])
    wrapped = np.column_stack([rpy[:, :2], np.angle(np.exp(1j * rpy[:, 2]))])
    whole, gapped = ({"attitude": (time, attitude)} for attitude in (
        wrapped, np.where(np.arange(len(time))[:, None] == 600, np.nan, wrapped)))
    whole, gapped = (on_grid("log", signals, 0, 1.0) for signals in (whole, gapped))
    np.testing.assert_allclose(gapped.state[:, :2], whole.state[:, :2], atol=1e-4)
    np.testing.assert_allclose(gapped.attitude_rate, whole.attitude_rate, atol=1e-2)
    with pytest.raises(InvalidParameter, match=r"attitude.*no numbers"):
        on_grid("log", {"attitude": (time, np.full((len(time), 3), np.nan))}, 0, 1.0)


def test_without_a_gyro_a_turning_vehicle_is_at_no_rest():
    base, parameters = parameters_of("bluerov2_alpha5")
    model, log = UvmsModel(Robot.load("bluerov2_alpha5").uvms), one_log()
    still = replace(log, q_dot=np.zeros_like(log.q_dot))
    state = still.state.copy()
    state[:, 3:] = np.nan
    fast = log.time > np.median(log.time)
    for turning in (0.0, 2.0 * TURNING):
        rate = np.zeros_like(log.attitude_rate)
        rate[fast, 0] = turning
        blind = replace(still, state=state, attitude_rate=rate)
        resting = windows_of([blind], model, base, parameters).resting
        assert np.any(resting[~fast]) and np.any(resting[fast]) == (turning == 0.0)


def test_a_local_fit_has_the_derivatives_and_no_values_in_gaps():
    rng = np.random.default_rng(1)
    time = 0.025 * (np.arange(400) + rng.uniform(0.0, 0.9, 400))
    time = time[(time < 4.0) | (time > 5.0)]
    grid = np.arange(0.5, 9.5, GRID)
    x, x_dot, x_ddot = local_quadratic(time, (1.0 + 2.0 * time - 0.7 * time**2)[:, None], grid)
    gap = np.isnan(x[:, 0])
    assert np.all(gap[(grid > 4.2) & (grid < 4.8)])
    assert not np.any(gap[(grid < 3.7) | (grid > 5.3)])
    for found, exact in ((x, 1.0 + 2.0 * grid - 0.7 * grid**2), (x_dot, 2.0 - 1.4 * grid),
                         (x_ddot, np.full_like(grid, -1.4))):
        np.testing.assert_allclose(found[~gap, 0], exact[~gap], atol=1e-6)


@pytest.mark.parametrize(("change", "line"), [
    (lambda log: {"attitude_rate": -log.state[:, 6:]}, "contradicts the gyro"),
    (lambda log: {"q": np.rad2deg(log.q)}, "is it in degrees"),
    (lambda log: {"q": np.where(log.time[:, None] < 18.0, np.nan, log.q),
                  "q_ddot": np.where(log.time[:, None] < 18.0, np.nan, log.q)}, "gaps"),
    (lambda log: {"q": 0.0 * log.q, "state": 0.0 * log.state}, "no excitation"),
    (lambda log: {"touching": np.ones(len(log.time), dtype=bool)}, "contact"),
    (lambda log: {"wrench": np.clip(np.tile(np.sin(log.time)[:, None], 6), -0.5, 0.5)},
     "saturation"),
    (lambda log: {"specific_force": np.tile([0.0, 0.0, 9.81], (len(log.time), 1))}, "off up"),
    (lambda log: {"specific_force": np.tile([0.0, 0.0, -1.0], (len(log.time), 1))}, "1 m/s2")])
def test_a_log_that_is_not_as_declared_is_refused_with_a_line(change, line):
    log = one_log()
    assert complaint(log) is None
    assert line in complaint(replace(log, **change(log)))


def test_the_shift_of_a_clock_is_found():
    time = np.arange(0.0, 20.0, 0.1)
    x = np.column_stack([np.sin(0.7 * time) + 0.3 * np.sin(1.9 * time), np.cos(0.5 * time)])
    late = np.roll(x, 10, axis=0)
    assert clock_shift(late, x, 0.1) == pytest.approx(1.0)
    assert clock_shift(x, x, 0.1) == 0.0


def test_clocks_that_have_no_time_in_common_are_refused_with_a_line():
    """One since the start of a computer, and one of the epoch."""
    time = np.arange(0.0, 5.0, 0.1)
    signals = {"attitude": (time, np.zeros((50, 3))), "joints": (time + 1000.0, np.zeros((50, 4)))}
    with pytest.raises(InvalidParameter, match=r"run: times of attitude and joints = \[1000\.0, 4"):
        on_grid("run", signals, 4)


def test_a_decay_of_another_period_is_no_late_clock():
    """A tilt, and a decay whose phase is another one soon: a shift is better, but hardly."""
    time = np.arange(0.0, 16.0, 0.1)
    seen, model = (np.column_stack([0.1 * np.sin(0.3 * time), 0.05 * np.exp(-0.1 * time) * np.cos(
        2 * np.pi * time / period)]) for period in (2.5, 2.2))
    shifted = [np.corrcoef(seen[k:].ravel(), model[:len(time) - k].ravel())[0, 1] for k in (0, 2)]
    assert shifted[1] > shifted[0] and clock_shift(seen, model, 0.1) == 0.0


def test_a_log_given_twice_is_refused():
    with pytest.raises(InvalidParameter, match=r"log1.* it has the samples of log0"):
        identify("bluerov2_alpha5", [one_log(), replace(one_log(), name="log1")])


@pytest.mark.slow
def test_a_late_clock_and_too_few_windows_are_refused():
    with pytest.raises(InvalidParameter, match="at least 12 windows"):
        identify("bluerov2_alpha5", synthetic_logs("bluerov2_alpha5", 3, 2))
    logs = synthetic_logs("bluerov2_alpha5", 3, 5)
    logs = [replace(log, name="run") for log in logs]  # Names do not tell logs apart.
    shifted = [replace(log, **{name: np.roll(getattr(log, name), 20, axis=0)
                               for name in ("state", "rate")}) for log in logs[:1]]
    with pytest.raises(InvalidParameter, match=(
            r"'9 windows'.* run: clock: its attitude is \S+ s later")):
        identify("bluerov2_alpha5", [*shifted, *logs[1:4]])


@pytest.mark.slow
def test_the_estimate_converges_to_a_hundredth_of_a_standard_deviation(monkeypatch):
    """From the file's numbers, and to the same ones from elsewhere; velocities are not measured."""
    base, parameters = parameters_of("bluerov2_alpha5")
    chosen = [i for i, each in enumerate(parameters) if each.name in TRUTH]
    windows = windows_of(synthetic_logs("bluerov2_alpha5", 5, 4), UvmsModel(
        Robot.load("bluerov2_alpha5").uvms), base, [parameters[i] for i in chosen])
    monkeypatch.setattr(estimate, "ITERATIONS", 13)
    found = [estimated(windows, [parameters[i] for i in chosen], start * np.array(
        [parameters[i].scale for i in chosen])) for start in (0.0, 0.2)]
    sigma, _ = found[0].deviations(np.arange(len(windows.start)))
    assert np.all(np.abs(found[1].theta - found[0].theta) < 0.05 * sigma)
    unseen = np.isnan(windows.state[windows.start[0], 3:6])
    assert np.all(unseen) and not np.any(found[0].own[:, 3:6])


@pytest.mark.parametrize(("confidence", "degrees", "value"), [
    (0.95, 11, 2.201), (0.95, 5, 2.571), (0.99, 30, 2.750), (0.95, 2, 4.303), (0.95, 1, 12.706),
    (0.99, 1, 63.66), (0.998, 2, 22.33), (0.998, 1, 318.3), (0.95, 1e4, 1.960)])
def test_the_quantiles_of_students_distribution_are_those_of_tables(confidence, degrees, value):
    assert student(confidence, degrees) == pytest.approx(value, rel=1e-3)
    assert student(confidence, np.array([degrees, degrees])).shape == (2,)


@pytest.mark.parametrize("order", [1, -1])
def test_of_two_logs_of_one_name_the_bad_one_alone_is_refused(order):
    bad = replace(one_log(), q=np.rad2deg(one_log().q))
    with pytest.raises(InvalidParameter, match=r"'3 windows'.* log0: joints has .* in degrees"):
        identify("bluerov2_alpha5", [bad, one_log()][::order])


@pytest.mark.parametrize("factor", [1.0, np.nan])
def test_an_estimate_that_does_not_converge_is_an_error_and_takes_no_useless_step(
        factor, monkeypatch):
    base, parameters = parameters_of("bluerov2_alpha5")
    windows = windows_of([one_log()], UvmsModel(Robot.load("bluerov2_alpha5").uvms), base,
                         parameters)
    seen = []

    def step(H, g, theta, parameters):
        seen.append(theta)
        return factor * constrained_step(H, g, theta, parameters)

    monkeypatch.setattr(estimate, "constrained_step", step)
    monkeypatch.setattr(estimate, "ITERATIONS", 2)
    with pytest.raises(RunFailed, match="no convergence after 2 steps"):
        estimated(windows, parameters, np.zeros(len(parameters)))
    assert len(seen) == 2 and np.any(seen[1]) == (factor == 1.0)


def fit(A, errors, prior=0.0):
    """The estimate of a linear model with H_w = AᵀA."""
    H = np.einsum("wki,wkj->wij", A, A)
    prior = np.full(H.shape[-1], prior)
    theta = np.linalg.solve(np.sum(H, axis=0) + np.diag(prior), np.einsum("wki,wk->i", A, errors))
    g, none = np.einsum("wki,wk->wi", A, errors - A @ theta), np.zeros(0)
    return Estimate(theta, none, none, Quadratic(H, g, none, none, none), prior)


def test_the_covariance_of_few_windows_has_no_bias():
    """Of a linear model with independent errors: 14 windows with 6 outputs for 8 parameters.

    Without the correction it has a fifth to a third less than the truth.
    """
    rng = np.random.default_rng(3)
    A = rng.normal(size=(14, 6, 8)) * rng.uniform(0.2, 2.0, (14, 1, 1))
    truth = np.linalg.inv(np.einsum("wki,wkj->ij", A, A))
    found, plain = np.zeros(8), np.zeros(8)
    for _ in range(400):
        estimate = fit(A, rng.normal(size=(14, 6)))
        found += estimate.deviations(np.arange(14))[0]**2 / 400
        plain += np.diag(truth @ (estimate.quadratic.g.T @ estimate.quadratic.g) @ truth) / 400
    assert found / np.diag(truth) == pytest.approx(1.0, abs=0.12)
    assert np.mean(plain / np.diag(truth)) < 0.8


@pytest.mark.parametrize("some", [slice(None), np.arange(14) < 9])
def test_the_deviations_are_those_by_the_whole_covariance_of_the_clusters(some):
    """Beside sums over all pairs, with a prior and at the estimate of some of the windows."""
    rng = np.random.default_rng(5)
    A = rng.normal(size=(14, 3, 2)) * rng.uniform(0.2, 2.0, (14, 1, 1))
    errors, cluster = rng.normal(size=(14, 3)), np.array([0, 0, 1, 1, 1, 2, 3, 3, 3, 4, 4, 5, 5, 5])
    sigma, freedom = fit(A, errors, 0.7).deviations(cluster, some)
    alone = fit(A[some], errors[some], 0.7)
    kept, (H, g) = cluster[some], alone.quadratic[:2]
    inverse = np.linalg.inv(np.sum(H, axis=0) + 0.7 * np.eye(2))
    for i in range(2):
        parts, rows = [], []
        for each in np.unique(kept):
            H_c, g_c = np.sum(H[kept == each], axis=0), np.sum(g[kept == each], axis=0)
            L = np.linalg.cholesky(inverse)
            left, axes = np.linalg.eigh(np.eye(2) - L.T @ H_c @ L)
            row = (L @ axes @ np.diag(left**-0.5) @ axes.T @ L.T)[i]
            parts.append(row @ g_c)
            rows.append((row, H_c))
        omega = np.array([[a @ ((H_c if c == d else 0.0) - H_c @ inverse @ H_d) @ b
                           for d, (b, H_d) in enumerate(rows)] for c, (a, H_c) in enumerate(rows)])
        assert sigma[i] == pytest.approx(np.linalg.norm(parts))
        assert freedom[i] == pytest.approx(np.trace(omega) ** 2 / np.sum(omega**2))


def test_the_degrees_of_freedom_of_a_mean_are_those_of_the_textbook():
    """Of a mean of C clusters of equal size they are C − 1, of unequal ones fewer."""
    rng = np.random.default_rng(1)
    equal, unequal = np.repeat(np.arange(6), 4), np.repeat(np.arange(6), [1, 1, 1, 1, 4, 16])
    for cluster, due in ((equal, 5.0), (unequal, 1.701)):
        _, freedom = fit(np.ones((24, 1, 1)), rng.normal(size=(24, 1))).deviations(cluster)
        assert freedom[0] == pytest.approx(due, rel=1e-3)


@pytest.mark.parametrize(("by_log", "covered"), [(True, 0.95), (False, 0.68)])
def test_a_constant_error_of_a_log_is_in_its_interval_if_logs_are_clusters(by_log, covered):
    """24 windows of eight logs, each with an error of its own; 1,000 draws."""
    rng, inside = np.random.default_rng(2), 0
    log_of = np.repeat(np.arange(8), [6, 1, 2, 3, 3, 2, 1, 6])
    A = rng.uniform(0.5, 1.5, (24, 1, 1))
    for _ in range(1000):
        errors = 0.3 * rng.normal(size=(24, 1)) + rng.normal(size=(8, 1))[log_of]
        estimate = fit(A, errors)
        sigma, freedom = estimate.deviations(log_of if by_log else np.arange(24))
        inside += abs(estimate.theta[0]) <= (student(0.95, freedom) * sigma)[0]
    assert inside / 1000 == pytest.approx(covered, abs=0.03)


def test_a_parameter_that_one_log_alone_excites_has_no_degrees_of_freedom_to_speak_of():
    rng, log_of = np.random.default_rng(4), np.repeat(np.arange(8), 3)
    A = np.ones((24, 5, 1)) * np.where(log_of == 3, 1.0, 0.002)[:, None, None]
    _, freedom = fit(A, rng.normal(size=(24, 5)), 1.0).deviations(log_of)
    assert freedom[0] < LEAST_FREEDOM
    sigma, nothing = fit(0.0 * A, rng.normal(size=(24, 5)), 1.0).deviations(log_of)
    assert nothing[0] == sigma[0] == 0.0


@pytest.mark.slow
def test_a_parameter_of_which_the_halves_disagree_stays_in_the_fit():
    """With the file's value in its place, three others were off by 3 to 7 of their half-widths."""
    found = identify("girona500_arm5e", synthetic_logs("girona500_arm5e", 29, 8))
    (why,) = [each.why for each in found.results if each.parameter.name == (
        "vehicle.added_mass.pitch")]
    assert "the halves of the logs disagree" in why
    assert "vehicle.added_mass.pitch" in [each.name for each in found.fitted]
    for each in found.identified:
        assert each.parameter.name != "vehicle.added_mass.pitch"
        assert abs(each.theta - TRUTH.get(each.parameter.name, 0.0)) < 1.5 * each.half


def test_a_window_without_a_measured_velocity_begins_as_the_one_before_ends():
    """A vehicle that is released at rest and is not trimmed; its velocities are not in the log."""
    logs = synthetic_logs("girona500_arm5e", 1, 2)
    base, parameters = parameters_of("girona500_arm5e")
    windows = windows_of(logs, UvmsModel(Robot.load("girona500_arm5e").uvms), base, parameters)
    assert list(windows.place_in_run()) == [0, 1, 2, 0, 1, 2]
    assert list(windows.of(np.array([0, 2, 3, 4])).place_in_run()) == [0, 0, 0, 1]
    begun = with_velocities(windows, np.zeros(len(parameters)))
    rises = -begun.velocity[:, 2]
    assert np.all(begun.velocity[[0, 3]] == 0.0)
    assert np.all(np.diff(rises.reshape(2, 3)) > 0.0) and rises[2] == pytest.approx(0.09, abs=0.02)
    assert begun.first_state()[:, 3:6] == pytest.approx(begun.velocity)
    seen = windows._replace(state=np.nan_to_num(windows.state))
    assert np.all(seen._replace(velocity=begun.velocity).first_state()[:, 3:6] == 0.0)
