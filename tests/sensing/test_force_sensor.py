"""Tests of `uvms_drake.sensing.force_sensor` and its bound: frames, closed forms, adversaries."""

from dataclasses import replace
from math import erf, exp, pi, sqrt

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from support.scripts import Script, use_fixed_steps

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.uvms import add_uvms
from uvms_drake.sensing.force_sensor import ForceSensor, error_bound, in_tip_axes, readable_force
from uvms_drake.sensing.measurements import TipPose
from uvms_drake.sensing.wrist_sensor import Imperfection, Tool, WristSensor, cut_noise, transfer

ZERO = np.zeros(6)
MOUNTING = np.array([0.02, -0.03, -0.11, 0.4, -0.7, 2.1])
TURNED = np.array([0.3, -0.2, 0.5, 0.4, -0.3, 1.9, 0.15, 0.9, 0.57, 0.3])
"""A configuration with nothing along an axis."""
PERFECT = ForceSensor(lag=0.0, noise=ZERO, resolution=ZERO, bias=ZERO, drift=ZERO, tare=0.0)
TOOL = Tool(mass=3.0, centre=np.array([0.01, 0.02, 0.2]), displaced=1.2,
            buoyancy=np.array([-0.02, 0.01, 0.15]))
TURNING = 0.15
"""Angular velocity of `rolling` at most [rad/s]."""


@pytest.fixture(params=[(0.0, 0.0, 0.0), (0.3, -0.9, 0.5)], ids=["world", "task"])
def any_model(request, uvms, plane):
    """Models whose Euler angles are about the world's axes, and about those of a task."""
    return ContactModel(uvms, check_surface(plane), np.array(request.param))


def at_rest(time):
    return np.concatenate([TURNED, np.zeros(10)])


def rolling(time):
    state = at_rest(time)
    state[3] += TURNING / 0.5 * np.sin(0.5 * time)
    state[4] = state[5] = 0.0
    return state


class Bench:
    """A sensor that is shown a wrench and a state, both functions of time."""

    def __init__(self, model, settings, off=None, *, wrench=lambda time: ZERO, state=at_rest,
                 measured=None):
        """`wrench` is F_S in the sensor's axes; `off` is the copy of seed 0 if it is left out."""
        self.model, self.settings = model, settings
        self._X = transfer(np.asarray(settings.mounting, dtype=float))
        self._wrench, self._state = wrench, state
        builder = DiagramBuilder()
        shown = builder.AddSystem(Script(
            force=self.force, state=state, measured=measured or state))
        self.sensor = WristSensor.AddToBuilder(
            builder, model, settings, off or settings.imperfection(0),
            force=shown.GetOutputPort("force"),
            chi=self._pose(builder, shown.GetOutputPort("state")),
            measured_chi=self._pose(builder, shown.GetOutputPort("measured")))
        self.simulator = self.simulator_of(builder.Build())

    def _pose(self, builder, state):
        pose = builder.AddSystem(TipPose(self.model))
        builder.Connect(state, pose.get_input_port())
        return pose.get_output_port()

    @staticmethod
    def simulator_of(diagram, context=None):
        simulator = Simulator(diagram) if context is None else Simulator(diagram, context)
        use_fixed_steps(simulator)
        simulator.Initialize()
        return simulator

    def A_E(self, time):
        return self.model.kinematics(self._state(time)[:10]).A_E

    def force(self, time):
        """𝔉, with A(𝔬)ᵀ𝔉 = X F_S."""
        return np.linalg.solve(self.A_E(time).T, self._X @ self._wrench(time))

    def context_of(self, simulator=None):
        root = (simulator or self.simulator).get_mutable_context()
        return self.sensor.GetMyMutableContextFromRoot(root)

    def port(self, name, simulator=None):
        return self.sensor.GetOutputPort(name).Eval(self.context_of(simulator)).copy()

    def error(self, time):
        """A(𝔬)ᵀ(𝔉_s − 𝔉) (6,) at a time to which it advances."""
        self.simulator.AdvanceTo(time)
        return (self.port("force_measured") - self.force(time)) @ self.A_E(time)


# Frames ------------------------------------------------------------------------------------------


def test_the_reading_does_the_power_of_the_force_on_the_surface(any_model):
    """F_Sᵀ V_S = 𝔉ᵀ χ̇, with V_S of a frame that Drake moves; and 𝔉_s is 𝔉 again."""
    model, plant = any_model, MultibodyPlant(time_step=0.1)
    uvms = add_uvms(plant, "girona500_arm5e")
    frame = plant.AddFrame(FixedOffsetFrame("wrist", uvms.tip, RigidTransform(
        RollPitchYaw(MOUNTING[3:]), MOUNTING[:3])))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    rng = np.random.default_rng(1)
    for _ in range(5):
        config = TURNED + rng.uniform(-0.3, 0.3, 10)
        wrench, zeta = rng.normal(size=6), rng.normal(size=10)
        state = np.concatenate([config, zeta])
        plant.SetPositionsAndVelocities(context, Coordinates(uvms).to_drake(state))
        V = frame.CalcSpatialVelocity(context, plant.world_frame(), frame)
        bench = Bench(model, replace(PERFECT, mounting=MOUNTING), wrench=lambda t, w=wrench: w,
                      state=lambda t, state=state: state)
        bench.simulator.AdvanceTo(0.01)
        reading, measured = bench.port("reading"), bench.port("force_measured")
        chi_dot = model.kinematics(config).J_chi @ zeta
        power = reading[:3] @ V.translational() + reading[3:] @ V.rotational()
        assert power == pytest.approx(measured @ chi_dot, rel=1e-10)
        np.testing.assert_allclose(measured, bench.force(0.0), rtol=1e-10, atol=1e-12)


def test_a_wrong_attitude_is_not_in_what_the_inverse_dynamics_ask_for(model):
    """A(𝔬)ᵀ𝔉_s at the measured attitude is the wrench at the tip, wherever the model has it."""
    wrench = np.array([3.0, -2.0, 20.0, 0.1, 0.2, -0.3])
    wrong = at_rest(0.0)
    wrong[3:6] += 0.2
    bench = Bench(model, PERFECT, wrench=lambda t: wrench, measured=lambda t: wrong)
    bench.simulator.AdvanceTo(0.01)
    A_E = model.kinematics(wrong[:10]).A_E
    np.testing.assert_allclose(bench.port("force_measured") @ A_E, wrench, rtol=1e-12)


# The tool ----------------------------------------------------------------------------------------


def test_holding_the_tool_does_the_work_of_its_weight_and_buoyancy(model):
    """L · V_S = d/dt (−m g · p_c + m_w g · p_b), by differences along a motion of the sensor."""
    g, rng = model.gravity, np.random.default_rng(2)
    for _ in range(5):
        rpy, v_S, w_S = rng.uniform(-1.0, 1.0, (3, 3))
        R_WS = rotation_matrix(rpy)

        def energy(s, R_WS=R_WS, v_S=v_S, w_S=w_S):
            turned = R_WS @ rotation_matrix(s * w_S)  # To first order, as any angles.
            moved = s * R_WS @ v_S
            return (-TOOL.mass * g @ (moved + turned @ TOOL.centre)
                    + TOOL.displaced * g @ (moved + turned @ TOOL.buoyancy))

        power = (energy(1e-6) - energy(-1e-6)) / 2e-6
        hold = TOOL.hold(g @ R_WS)
        assert hold @ np.concatenate([v_S, w_S]) == pytest.approx(power, rel=1e-6)
        assert np.all(np.abs(hold) <= TOOL.largest_hold(9.81) + 1e-12)


def test_the_tool_is_taken_off_in_every_attitude(any_model):
    model = any_model
    bench = Bench(model, replace(PERFECT, tool=TOOL, mounting=MOUNTING), state=rolling)
    for time in (0.5, 3.0):
        bench.simulator.AdvanceTo(time)
        np.testing.assert_allclose(bench.port("reading"), 0.0, atol=1e-12)
    heavier = Bench(model, replace(PERFECT, tool=replace(TOOL, error=0.1)))
    heavier.simulator.AdvanceTo(0.01)
    g_S = model.gravity @ heavier.A_E(0.0)[:3, :3]
    np.testing.assert_allclose(heavier.port("reading"), -0.1 * TOOL.hold(g_S), rtol=1e-12)


# Time --------------------------------------------------------------------------------------------


def test_a_step_response_is_that_of_a_first_order_lag(model):
    """F (1 − exp(−t/T)) at the samples, from x = 0."""
    wrench, T = np.array([20.0, -3.0, 1.0, 0.5, 0.1, -0.2]), 0.03
    bench = Bench(model, replace(PERFECT, lag=T, rate=200.0), wrench=lambda t: wrench)
    bench.context_of().SetContinuousState(ZERO)
    for k in range(1, 30):
        time = k / 200.0
        bench.simulator.AdvanceTo(time + 0.001)
        np.testing.assert_allclose(
            bench.port("reading"), wrench * (1.0 - exp(-time / T)), rtol=1e-4)


def test_the_tare_takes_the_bias_and_the_tool_off_and_says_nothing_meanwhile(model):
    settings = replace(PERFECT, bias=np.full(6, 5.0), tare=0.2, rate=50.0,
                       tool=replace(TOOL, error=0.3))
    wrench = np.array([20.0, 1.0, 2.0, 0.1, 0.2, 0.3])
    off = Imperfection(np.arange(-3.0, 3.0), ZERO, lambda k: ZERO)
    bench = Bench(model, settings, off, wrench=lambda t: wrench * (t > 0.19))
    bench.simulator.AdvanceTo(0.195)
    np.testing.assert_array_equal(bench.port("reading"), 0.0)
    bench.simulator.AdvanceTo(0.21)
    np.testing.assert_allclose(bench.port("reading"), wrench, rtol=1e-12)


@pytest.mark.parametrize(("until", "said"), [
    (1.0, ["t = 0.19 s: in touch at the end of the tare, which takes that force off"]), (0.1, [])])
def test_a_tare_in_touch_is_said_and_takes_the_force_off(model, caplog, until, said):
    settings, wrench = replace(PERFECT, tare=0.2), np.arange(6.0)
    bench = Bench(model, settings, wrench=lambda t: wrench * (t < until))
    bench.simulator.AdvanceTo(0.205)
    assert caplog.messages == said
    expected = 0.0 if said else -0.5 * wrench  # Ten or eleven of its twenty samples.
    np.testing.assert_allclose(bench.port("reading"), expected, atol=0.3)


def test_a_force_that_is_readable_is_in_the_range_whatever_comes_to_it(model):
    """At the bounds of bias, drift and noise, and with the tool hanging along the force."""
    settings = replace(ForceSensor(), range=np.array([60.0, 70.0, 80.0, 40.0, 40.0, 30.0]),
                       drift=np.full(6, 0.1), tool=TOOL)
    most = readable_force(settings, 30.0)
    other_errors = 5.0 + 3.0 + 3.0 * 0.25 + 0.5 * 0.0625 + TOOL.largest_hold(9.81)[0]
    assert most == pytest.approx(60.0 - other_errors)
    assert settings.reading(30.0, 1.0).largest == most
    assert readable_force(replace(settings, range=np.ones(6)), 30.0) == 0.0


def test_a_sensor_that_is_mounted_away_from_the_tip_has_torques_in_its_range():
    """An ATI Mini45 0.15 m behind the tip: at 33 N across its axis the torque is 5 N m."""
    bare = replace(ForceSensor(), range=np.array([145.0, 145.0, 290.0, 5.0, 5.0, 5.0]),
                   mounting=[-0.15, 0.0, 0.0, 0.0, 0.0, 0.0], tool=Tool(), bias=np.zeros(6),
                   drift=np.zeros(6), noise=np.zeros(6), resolution=np.zeros(6))
    most = readable_force(bare, 30.0)
    assert most == pytest.approx(5.0 / 0.15)
    sensed = np.linalg.inv(transfer(np.array(bare.mounting))) @ [0.0, 0.0, most, 0.0, 0.0, 0.0]
    assert np.all(np.abs(sensed) <= bare.range * (1.0 + 1e-12))
    assert np.max(np.abs(sensed) / bare.range) == pytest.approx(1.0)


def test_the_rounding_of_a_tare_is_alike_in_all_of_its_samples():
    """Where the noise is less than the resolution a mean of fifty is no better than one."""
    coarse = replace(ForceSensor(), tare=0.5, noise=np.full(6, 0.001), resolution=np.full(6, 0.1))
    assert np.all(coarse.reading(30.0, 1.0).likely_constant >= 0.05)


def test_without_an_attitude_the_last_sample_goes_on(model):
    """Also while it is tared: the tare has a sample less."""
    def measured(time):
        gone = 0.05 < time < 0.1 or 0.3 < time < 0.4
        return np.full(20, np.nan) if gone else at_rest(time)

    settings = replace(PERFECT, tare=0.2, tool=replace(TOOL, error=0.1))
    bench = Bench(model, settings, wrench=lambda t: np.full(6, max(t - 0.26, 0.0)),
                  measured=measured)
    for time, expected in ((0.295, 0.03), (0.395, 0.04), (0.415, 0.15)):
        bench.simulator.AdvanceTo(time)
        np.testing.assert_allclose(bench.port("reading"), expected, atol=1e-9)
        assert np.all(np.isnan(bench.port("force_measured"))) == (0.3 < time < 0.4)


# Errors ------------------------------------------------------------------------------------------


def test_the_noise_is_gaussian_cut_and_white():
    """Mean 0 and the variance of a normal number cut at ±m; neighbours have nothing in common."""
    m, sigma, count = 1.5, np.array([0.25, 1.0, 2.0, 0.005, 0.01, 3.0]), 4000
    unit = np.array([cut_noise(sigma, m, 3, k) for k in range(count)]) / sigma
    inside = erf(m / sqrt(2.0))
    density = exp(-0.5 * m * m) / sqrt(2.0 * pi)
    variance = inside - 2.0 * m * density + m * m * (1.0 - inside)
    np.testing.assert_allclose(np.mean(unit, axis=0), 0.0, atol=4.0 / sqrt(count))
    np.testing.assert_allclose(np.var(unit, axis=0), variance, rtol=0.06)
    assert np.max(np.abs(unit)) == m
    assert np.mean(np.abs(unit) == m) == pytest.approx(1.0 - inside, abs=0.01)
    between = np.mean(unit[1:] * unit[:-1], axis=0)
    np.testing.assert_allclose(between, 0.0, atol=4.0 / sqrt(count))
    across = np.corrcoef(unit.T) - np.eye(6)
    assert np.max(np.abs(across)) < 4.0 / sqrt(count)


RATE = np.array([30.0, 20.0, 50.0, 1.0, 2.0, 0.5])
"""ρ [N/s, N m/s]."""


@pytest.mark.parametrize("settings", [
    ForceSensor(), ForceSensor(tare=0.0), ForceSensor(lag=0.0, rate=25.0, resolution=ZERO),
    ForceSensor(drift=np.full(6, 0.5), noise=ZERO, resolution=ZERO)])
def test_the_worst_case_reaches_the_bound_and_does_not_exceed_it(model, settings):
    """Noise, drift and a falling force of one sign, and the opposite noise during the tare."""
    largest, tared = settings.noise_multiple * settings.noise, settings.tare_samples
    off = Imperfection(
        settings.bias, settings.drift, lambda k: np.where(k < tared, -1, 1) * largest)
    touch = settings.tare + 0.1
    bench = Bench(model, settings, off, wrench=lambda t: -RATE * max(t - touch, 0.0))
    worst = np.zeros(6)
    for time in np.linspace(settings.tare + 0.001, touch + 0.5, 400):
        ratio = bench.error(time) / error_bound(settings, time, RATE).total
        worst = np.maximum(worst, np.abs(ratio))
    assert np.all(worst <= 1.0 + 1e-9)
    assert np.all(worst > 0.97)


@pytest.mark.parametrize("seed", range(3))
def test_no_copy_and_no_force_of_that_rate_exceeds_the_bound(model, seed):
    """Drawn errors, a force that turns about at random, a tool of the wrong weight, a motion."""
    settings = ForceSensor(tool=replace(TOOL, error=0.1), mounting=MOUNTING, tare=0.3)
    rng = np.random.default_rng(seed)
    frequency, phase = rng.uniform(1.0, 40.0, (2, 6))

    def wrench(time):
        swing = np.sin(frequency * time + phase) - np.sin(frequency * 0.3 + phase)
        return RATE / frequency * swing * (time > 0.3)

    bench = Bench(model, settings, settings.imperfection(seed), wrench=wrench, state=rolling)
    ratios = []
    for time in np.linspace(0.301, 1.0, 100):
        total = error_bound(settings, time, RATE, turning=TURNING).total
        ratios.append(np.abs(bench.error(time)) / in_tip_axes(settings, total))
    assert np.max(ratios) <= 1.0
    assert np.max(ratios) > 0.1


@pytest.mark.parametrize("tare", [0.0, 0.2])
def test_a_reading_is_a_multiple_of_the_resolution_and_off_by_its_bound_at_most(model, tare):
    """Half a step, and half a step more of the mean of the tare; both are attained."""
    r = np.array([0.5, 0.2, 0.01, 0.02, 0.003, 0.0])
    settings = replace(PERFECT, resolution=r, tare=tare, bias=np.full(6, 5.0))
    bound = error_bound(replace(settings, bias=ZERO), 9.0, ZERO)
    np.testing.assert_allclose(bound.total, r * (1.0 if tare else 0.5))
    off = Imperfection(0.499 * r * (tare > 0.0), ZERO, lambda k: ZERO)
    bench = Bench(model, settings, off, wrench=lambda t: -0.499 * r * (t > 0.2) + r * t * (t > 0.2))
    readings, errors = [], []
    for time in np.arange(0.215, 2.0, 0.01):
        errors.append(np.abs(bench.error(time)))
        readings.append(bench.port("reading"))
    steps = np.array(readings)[:, :5] / r[:5]
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert np.all(np.max(errors, axis=0)[:3] <= bound.total[:3] + 0.011 * r[:3])
    assert np.all(np.max(errors, axis=0)[:3] > 0.9 * bound.total[:3])


# State and settings ------------------------------------------------------------------------------


def test_a_cloned_context_goes_on_identically(model):
    settings = ForceSensor(tool=TOOL)
    for start in (0.25, 0.8):  # During the tare, and after it.
        bench = Bench(model, settings, wrench=lambda t: np.full(6, t), state=rolling)
        bench.simulator.AdvanceTo(start)
        other = Simulator(bench.simulator.get_system(), bench.simulator.get_context().Clone())
        use_fixed_steps(other)
        for simulator in (bench.simulator, other):
            simulator.AdvanceTo(0.9)
        for name in ("reading", "force_measured"):
            assert np.all(bench.port(name) != 0.0)
            np.testing.assert_array_equal(bench.port(name), bench.port(name, other))
