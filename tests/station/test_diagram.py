"""The closed loop of a scenario, and what the ideal one achieves."""

import numpy as np
import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from support.runs import simulated

import uvms_drake as uv
from uvms_drake.plant.disturbance import RandomDisturbance
from uvms_drake.report.signals import constraints

SHORT = ["mpc.horizon=8"]
CLOSE = "start.eta=[-1.13, -0.05, -0.05, 0.02, 0.02, 0.05]"
"""The tip starts 4 cm off the wall and touches it within a second."""


def logs_of(scenario: uv.Scenario, duration: float) -> dict[str, np.ndarray]:
    """Returns the logs of a run, without the wall times."""
    station = uv.make_station(scenario)
    simulator = Simulator(station)
    ApplySimulatorConfig(uv.with_step(scenario).simulator, simulator)
    simulator.AdvanceTo(duration)
    return without_wall_times(uv.read_logs(station, simulator.get_context()))


def without_wall_times(logs: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: values for name, values in logs.items() if name != "step_seconds"}


def assert_identical(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> None:
    assert one.keys() == other.keys()
    for name, values in one.items():
        np.testing.assert_array_equal(other[name], values, err_msg=name)


# The ideal scenario -------------------------------------------------------------------------------


@pytest.fixture
def main() -> uv.Record:
    """The ideal scenario as it is: 20 s, disturbed, seed 0."""
    return simulated("girona500_ideal", 20.0)


@pytest.fixture
def undisturbed() -> uv.Record:
    return simulated("girona500_ideal", 12.0, "disturbance.bound=0")


def last_normal_forces(record: uv.Record) -> np.ndarray:
    """Returns the force on the wall over the last 5 s [N]."""
    assert record.time[-1] == pytest.approx(record.scenario.duration)
    return record.force[record.time >= record.time[-1] - 5.0, 0]


def test_it_starts_off_the_wall_and_makes_contact(main):
    assert main.chi[0, 0] == pytest.approx(-0.3, abs=0.01)
    assert np.all(main.penetration[main.time < 0.5] == 0.0)
    assert np.all(main.penetration[main.time > 5.0] > 0.0)


def test_it_holds_20_newtons_within_5_under_the_disturbance(main):
    np.testing.assert_allclose(last_normal_forces(main), 20.0, atol=5.0)
    size = np.linalg.norm(main.disturbance, axis=1)
    assert 0.09 < np.max(size) <= 0.1


def test_without_the_disturbance_it_holds_20_newtons_within_1(undisturbed):
    assert np.max(np.abs(undisturbed.disturbance)) == 0.0
    np.testing.assert_allclose(last_normal_forces(undisturbed), 20.0, atol=1.0)
    np.testing.assert_allclose(undisturbed.chi[-1], undisturbed.chi_des, atol=1e-3)


@pytest.mark.parametrize("run", ["main", "undisturbed"])
def test_no_limit_is_exceeded(request, run):
    record = request.getfixturevalue(run)
    limits, signals = record.scenario.limits, constraints(record)
    assert len(signals) == 3 + 8 + 3 + 1 + 10
    for i in range(4):  # The scenario's are narrower than the robot's.
        assert signals[f"q{i + 1}_min"][1] == limits.q_lower[i]
        assert signals[f"q{i + 1}_max"][1] == limits.q_upper[i]
    for name, each in signals.items():
        assert np.min(each.margin) >= 0.0, name


@pytest.mark.parametrize("run", ["main", "undisturbed"])
def test_every_solve_succeeds_and_reaches_the_terminal_set(request, run):
    record = request.getfixturevalue(run)
    np.testing.assert_array_equal(record.mpc_status, 0.0)
    np.testing.assert_allclose(record.mpc_terminal_slack, 0.0, atol=1e-9)
    np.testing.assert_allclose(record.mpc_violation, 0.0, atol=1e-6)


def test_the_real_state_stays_in_the_declared_tube(main):
    tube = main.scenario.tube
    config, zeta = main.config - main.nominal_config, main.zeta - main.nominal_zeta
    chi = uv.pose_difference(main.chi, main.chi_nominal)
    for name, vectors in (
        ("e", np.hstack([chi, config[:, 6:]])), ("z", zeta),
        ("position", chi[:, :3]), ("orientation", chi[:, 3:]), ("joints", config[:, 6:]),
        ("roll", config[:, 3:4]), ("pitch", config[:, 4:5]),
        ("nu1", zeta[:, :3]), ("nu2", zeta[:, 3:6]), ("qdot", zeta[:, 6:]),
    ):
        worst = np.max(np.linalg.norm(vectors, axis=1))
        assert 0.0 < worst <= getattr(tube, name), name
    assert np.all(np.max(np.abs(main.u - main.nominal_input), axis=0) <= tube.u)


def test_the_limits_are_used(main):
    """The run is fast enough for the tightened limits to matter, and keeps to them."""
    limits, tube, zeta = main.scenario.limits, main.scenario.tube, main.nominal_zeta
    speeds = [np.max(np.linalg.norm(zeta[:, block], axis=1)) / (limit - radius)
              for block, limit, radius in (
                  (slice(0, 3), limits.nu1, tube.nu1), (slice(3, 6), limits.nu2, tube.nu2),
                  (slice(6, 10), limits.qdot, tube.qdot))]
    inputs = np.max(np.abs(main.nominal_input), axis=0) / (limits.u - tube.u)
    for ratios in (speeds, inputs):
        assert np.max(ratios) == pytest.approx(1.0, rel=0.01)
        assert np.max(ratios) <= 1.0 + 1e-5


# Other scenarios ---------------------------------------------------------------------------------


def test_the_papers_spring_is_pressed_from_inside_the_contact():
    record = uv.simulate(uv.load_scenario("girona500_bilateral", ["duration=6"]))
    assert np.linalg.norm(record.force[0] - record.scenario.task.force) > 5.0
    late = record.force[record.time > 5.0]
    assert np.max(np.linalg.norm(late - record.scenario.task.force, axis=1)) < 5.0
    np.testing.assert_array_equal(record.mpc_status, 0.0)
    stiffness = record.scenario.surface.stiffness
    np.testing.assert_allclose(record.force, record.chi @ stiffness.T, atol=1e-9)


@pytest.mark.parametrize("water", ["current=[0, 0.05, 0]", "waves=[{amplitude: 0.05}]"])
def test_water_that_moves_without_the_controllers_knowing_is_felt(water):
    calm, flow = (logs_of(uv.load_scenario("girona500_ideal", [*SHORT, *more]), 0.6)
                  for more in ([], [water]))
    np.testing.assert_array_equal(calm["nominal_state"], flow["nominal_state"])
    assert 1e-5 < np.max(np.abs(flow["state"] - calm["state"])) < 0.05


def test_a_surface_that_is_elsewhere_is_felt_and_the_task_stays_what_it_was():
    overrides = ["duration=1.2", CLOSE]
    known, closer = (uv.simulate(uv.load_scenario("girona500_ideal", [*overrides, *more]))
                     for more in ([], ["surface_error.shift=[-0.005, 0, 0]"]))
    np.testing.assert_array_equal(closer.chi_des, known.chi_des)
    np.testing.assert_array_equal(closer.nominal_state, known.nominal_state)
    deeper = closer.penetration > 0.005
    np.testing.assert_allclose(
        closer.penetration[deeper], closer.chi[deeper, 0] + 0.005, atol=1e-12)
    first = [record.time[np.argmax(record.penetration > 0.0)] for record in (closer, known)]
    assert first[0] < first[1]


def test_inside_of_the_theory_the_input_limits_change_nothing(monkeypatch):
    """Bit for bit, with a law that is told the limits and with one that is not."""
    scenario = uv.load_scenario("girona500_ideal", [CLOSE])
    told = []

    def without_limits(ocp, ancillary, targets, limits, command_path, solver, press, safety):
        told.append(limits)
        return uv.make_tube_mpc(ocp, ancillary, targets, solver=solver)

    limited = logs_of(scenario, 2.0)
    monkeypatch.setattr("uvms_drake.station.controller.make_tube_mpc", without_limits)
    assert_identical(limited, logs_of(scenario, 2.0))
    assert told == [scenario.limits] * 2  # Of the station, and of that which its step is from.
    assert np.all(limited["input_limited"] == 0.0)


@pytest.mark.parametrize(("law", "scheme", "limited"), [
    ("Transpose {k: 10000, sigma: 11.5, joints: true}", "radau3", False),
    ("Resolved {k: 20, sigma: 5}", "implicit_euler", False),
    ("Resolved {k: 20, sigma: 5}", "runge_kutta3", True)])
def test_the_command_is_cut_unless_the_integrator_is_implicit(law, scheme, limited):
    """By the command of a robot that is far from the plan, on the way."""
    scenario = uv.load_scenario("paper_dynamic", [
        "mpc.horizon=8", f"ancillary=!{law}", f"simulator.integration_scheme={scheme}"])
    station = uv.make_station(scenario)
    simulator = Simulator(station)
    context = simulator.get_mutable_context()
    simulator.Initialize()
    uvms = station.GetSubsystemByName("uvms")
    state = station.GetOutputPort("state").Eval(context).copy()
    state[0] += 0.1
    uv.set_state(uvms, uvms.GetMyMutableContextFromRoot(context), state)
    u, flag = (station.GetOutputPort(name).Eval(context) for name in ("u", "input_limited"))
    assert bool(flag) == limited == bool(np.max(np.abs(u) / scenario.limits.u) <= 1.0)


# Repeatability -----------------------------------------------------------------------------------


def with_random_disturbance(seed: int = 0) -> uv.Scenario:
    scenario = uv.load_scenario("girona500_ideal", [*SHORT, CLOSE, f"seed={seed}"])
    scenario.disturbance = RandomDisturbance(bound=0.1, bandwidth=2.0)
    return scenario


@pytest.mark.parametrize("pause", [1.0, 0.93])
def test_a_clone_of_the_context_goes_on_as_the_original(pause):
    """Bit for bit, in a Simulator of its own, with the logs so far.

    1.0 s is a sampling instant of the MPC, where a pause does not cut a step of the integrator:
    then it also equals the run that was not interrupted.
    """
    end = pause + 1.0
    scenario = with_random_disturbance()
    station = uv.make_station(scenario)
    original = Simulator(station)
    ApplySimulatorConfig(uv.with_step(scenario).simulator, original)
    original.AdvanceTo(pause)
    clone = original.get_context().Clone()
    original.AdvanceTo(end)

    other = Simulator(station, clone)
    ApplySimulatorConfig(uv.with_step(scenario).simulator, other)
    clone.SetTime(pause)  # The configuration has a start time.
    other.Initialize()
    other.AdvanceTo(end)
    continued, expected = (without_wall_times(uv.read_logs(station, each.get_context()))
                           for each in (other, original))
    for logs in (continued, expected):
        np.testing.assert_allclose(logs["mpc_time"][:9], 0.2 * np.arange(9), atol=1e-9)
    sampled = [name for name in expected if len(expected[name]) == len(expected["time"])]
    assert {"state", "tau", "force", "tube_bound", "tube_deviation"} < set(sampled)
    for name in sampled:
        late = continued["time"] > pause, expected["time"] > pause
        assert np.sum(late[0]) >= 50
        np.testing.assert_array_equal(
            continued[name][late[0]], expected[name][late[1]], err_msg=name)
    if pause == 1.0:
        assert_identical(expected, logs_of(scenario, end))
