"""The rows of the law `tip first` on the robot's full dynamics, behind thrusters that lag."""

from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem
from support.hovering import Hovering, Lag
from support.lagging import CONFIG, Motion, run
from support.transfer import impulse
from uvms_drake.tube.loops.row_loop import RowLoop

from uvms_drake.actuation.ideal import SampledCommand
from uvms_drake.control.laws import Resolved, TipFirst
from uvms_drake.control.laws.law import pair_of
from uvms_drake.control.laws.outputs import outputs_of
from uvms_drake.control.laws.tip_first import BlockGains
from uvms_drake.control.laws.tip_rows import tip_rows
from uvms_drake.model.signals.sensor_actuator import VEHICLE_WRENCH
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.plant.disturbance import (
    DirectedDisturbance,
    OpenLoopDisturbance,
    SinusoidalDisturbance,
)

pytestmark = pytest.mark.slow
VEHICLE, TIP = (4.0, 2.0), (20.0, 10.0)  # k, σ [1/s]; the vehicle's fast, to be short
STEP = 0.025


def law_of(vehicle_rate: float = 0.0, tip_rate: float = 0.0) -> TipFirst:
    return TipFirst(BlockGains(*VEHICLE, vehicle_rate), BlockGains(*TIP, tip_rate))


def by_disturbance(k, sigma, rate, lag):
    """Returns numerator and denominator of e/δ, formula (2) of `row_loop`."""
    D = [lag, 1.0, k + sigma, k * sigma] if lag else [1.0, k + sigma, k * sigma]
    numerator = [lag, 1.0] if lag else [1.0]
    if rate:
        numerator = [lag, 1.0 + rate * lag, 0.0] if lag else [1.0, 0.0]
        D = np.polymul([1.0, rate], D)
    return numerator, D


@pytest.mark.parametrize(("lag", "rate"), list(product((0.0, 0.15, 0.3), (0.0, 2.0))))
def test_an_adversary_takes_every_row_to_its_bound_and_none_beyond(model, lag, rate):
    """All rows at once: d = J_y⁻¹δ, |δᵢ| the bound of each, of the signs that move it furthest.

    After 3 s the slowest rows, those behind 0.3 s, are still on their way. What moves the vehicle's
    rows besides δ is what the posture feeds forward late, which has lines of its own: the righting
    moment of roll and pitch helps against this adversary.
    """
    end, bound = 3.0, np.repeat([0.03, 0.1], [6, 4])
    filters = [by_disturbance(*VEHICLE, rate, lag), by_disturbance(*TIP, rate, 0.0)]

    def adversary(time: float, J: np.ndarray) -> np.ndarray:
        left = np.array([max(end - time, 0.5 * STEP)])
        signs = [np.sign(impulse(*each, left)[0]) for each in filters]
        return np.linalg.solve(J, np.repeat(signs, [6, 4]) * bound)

    motion = run(model, law_of(rate, rate), adversary, end, lag=lag, step=STEP)
    vehicle, tip = RowLoop(*VEHICLE, rate, lag).gains, RowLoop(*TIP, rate).gains
    largest = np.max(np.abs(motion.error), axis=0)
    on_tip = largest[6:] / (tip["disturbance"].position * bound[6:])
    assert np.all((on_tip > 0.95) & (on_tip <= 1.0 + 1e-4)), "exact, but for the integrator's step"
    line = vehicle["disturbance"].position * bound[:6]
    reached = largest[:6] / line
    assert np.all(reached[[0, 1, 2, 5]] > (0.95 if lag < 0.3 else 0.88))
    assert np.all(reached[3:5] > (0.9 if lag < 0.3 else 0.78))
    f, c = late(motion, lag)
    late_lines = 0.5 * vehicle["feed_forward"].position * np.ptp(f, axis=0) + (
        vehicle["disturbance"].position * np.max(np.abs(c), axis=0))
    assert np.all(largest[:6] <= line + late_lines)
    assert np.all(late_lines < 0.3 * line)


@dataclass
class Signs(OpenLoopDisturbance):
    """d = J⁻¹δ, |δᵢ| = `size`ᵢ (10,), of the signs that move each row furthest at the end."""

    end: float = 4.0
    size: np.ndarray = field(default_factory=lambda: np.repeat([0.03, 0.1], [6, 4]))
    filters: list = field(default_factory=list)
    J: np.ndarray = field(default_factory=lambda: np.eye(10))

    def system(self, size: int, seed: int = 0) -> LeafSystem:
        return DirectedDisturbance(np.ones(size), self.at)

    def at(self, time: float) -> np.ndarray:
        left = np.array([max(self.end - time, 1e-6)])
        signs = [np.sign(impulse(*each, left)[0]) for each in self.filters]
        return np.linalg.solve(self.J, np.repeat(signs, [6, 4]) * self.size)


@pytest.mark.long
@pytest.mark.parametrize(("lag", "rate"), list(product((0.0, 0.15, 0.3), (0.0, 2.0))))
def test_on_drakes_plant_every_row_is_taken_to_its_bound_and_none_beyond(model, lag, rate):
    """The Diagram of plant, law, observer with its ticks and lag; δ is what J_y makes of d there.

    By δ alone a vehicle's row would not be beyond its line. It is by up to 3 %, yaw the most, at a
    lag of 0.15 s with an observer: the thrusters carry what the arm needs to hold the tip,
    A M_vq J_sq⁻¹ w_s, too late. That is of the f in `row_loop`, the `ARM` of `lagged_wrench`.
    """
    motion, arm, gains = disturbed_on_drake(model, lag, rate, 0.1)
    delta = np.max(np.abs(np.einsum("tij,tj->ti", motion.J, motion.d)), axis=0)
    line, error = gains["disturbance"] * delta, motion.error
    on_tip = np.max(np.abs(error[:, 6:]), axis=0) / line[6:]
    assert np.all((on_tip > 0.95) & (on_tip <= 1.0 + 1e-2)), "exact, but for what is sampled"
    reached, line = np.max(np.abs(error[:, :6]), axis=0), 1.001 * line[:6]  # the observer's clock
    assert np.all(reached[[0, 1, 2, 5]] > 0.9 * line[[0, 1, 2, 5]])
    assert np.all(reached[3:5] > 0.75 * line[3:5])
    f, c = late(motion, lag)
    assert np.all(reached <= line + gains["disturbance"][:6] * np.max(np.abs(c), axis=0)
                  + 0.5 * gains["feed_forward"][:6] * np.ptp(f, axis=0))

    D = [lag, 1.0, sum(VEHICLE), np.prod(VEHICLE)]
    by_arm = -np.array([np.convolve(impulse([lag, 0.0], D, motion.time), each)[: len(each)]
                        for each in (arm - arm[0]).T]).T * (motion.time[1] - motion.time[0])
    assert np.all(np.max(np.abs(error[:, :6] - by_arm), axis=0) <= line)
    beyond = np.max(reached / line) - 1.0
    if (lag, rate) == (0.15, 2.0):
        assert 0.02 < beyond < np.max(np.abs(by_arm) / line)
        quiet, arm, gains = disturbed_on_drake(model, lag, rate, 0.0)
        delta = np.max(np.abs(np.einsum("tij,tj->ti", quiet.J, quiet.d)), axis=0)[:6]
        ratio = np.max(np.abs(quiet.error[:, :6]), axis=0) / (gains["disturbance"][:6] * delta)
        assert 0.99 < np.max(ratio) <= 1.0, "nothing pushes the tip, so the arm needs nothing"
    else:
        assert beyond <= 0.0


def disturbed_on_drake(model, lag: float, rate: float, on_tip: float
                       ) -> tuple[Motion, np.ndarray, dict[str, np.ndarray]]:
    """Returns the motion, what the arm has the vehicle carry (T, 6), and the rows' gains (10,)."""
    law = replace(law_of(rate, rate), observer_period=0.01)
    k, sigma = law.gains("k", 4), law.gains("sigma", 4)
    rows, nominal = tip_rows(model), np.concatenate([CONFIG, np.zeros(10)])
    adversary = Signs(
        bound=1.0, J=outputs_of(pair_of(model, nominal, nominal), rows).J[0],
        size=np.repeat([0.03, on_tip], [6, 4]),
        filters=[by_disturbance(*VEHICLE, rate, lag), by_disturbance(*TIP, rate, 0.0)])
    robot = Hovering(model, law, step=0.0125, disturbance=adversary,
                     actuation=[Lag(lag)] if lag else [])

    def read():
        now = pair_of(model, robot.read("uvms", "state"), nominal)
        out, asked = outputs_of(now, rows), robot.read("feedback", "tau")
        feedback = -(k + sigma) * (out.rate[0] - out.rate[1]) - k * sigma * out.error - (
            robot.read("observer", "estimate") if rate else 0.0)
        J, M = out.J[0], model.mass_matrix(now.kinematics.at(0))
        held = M[:6, 6:] @ np.linalg.inv(J[6:, 6:])
        carried = J[:6, :6] @ np.linalg.inv(M[:6, :6] - held @ J[6:, :6])
        wrench = robot.signals.get(VEHICLE_WRENCH)
        return (robot.context.get_time(), out.error, J, robot.read("uvms", "disturbance"), asked,
                asked[:6] if wrench is None else wrench.Eval(
                    wrench.get_system().GetMyContextFromRoot(robot.context)),
                carried, feedback, carried @ held @ feedback[6:])

    samples = [read()]
    robot.every(0.025, adversary.end, lambda: samples.append(read()))
    *motion, arm = (np.array(each) for each in zip(*samples, strict=True))
    loops = [RowLoop(*VEHICLE, rate, lag).gains, RowLoop(*TIP, rate).gains]
    return Motion(*motion), arm, {name: np.repeat(
        [gains[name].position for gains in loops], [6, 4]) for name in loops[0]}


def late(motion: Motion, lag: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns f = ÿ̄ + h and TȦτ_v of the vehicle's rows (T, 6).

    By h = Aτ_c − v, and by differences.
    """
    def through(wrenches):
        return np.einsum("tij,tj->ti", motion.carried, wrenches)

    f = through(motion.asked[:, :6]) - motion.feedback[:, :6]
    A_rate = np.gradient(motion.carried, motion.time, axis=0)
    return f, lag * np.einsum("tij,tj->ti", A_rate, motion.wrench)


def swaying(time: float) -> tuple[np.ndarray, np.ndarray]:
    """A plan that accelerates all the time: sines of two frequencies in all coordinates."""
    amplitude = np.array([0.1, 0.08, 0.05, 0.05, 0.05, 0.1, 0.1, 0.1, 0.1, 0.1])
    omega = np.where(np.arange(10) % 2, 1.5, 2.5)
    config = CONFIG + amplitude * (1.0 - np.cos(omega * time))
    rate, acceleration = amplitude * omega * np.sin(omega * time), (
        amplitude * omega**2 * np.cos(omega * time))
    step = 1e-4
    zeta, zeta_dot = body_velocity(config, rate), (
        body_velocity(config + step * rate, rate + step * acceleration)
        - body_velocity(config - step * rate, rate - step * acceleration)) / (2.0 * step)
    return np.concatenate([config, zeta]), zeta_dot


def body_velocity(config: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Returns ζ of 𝔮̇."""
    Gamma = np.column_stack([configuration_rate(config, unit) for unit in np.eye(10)])
    return np.linalg.solve(Gamma, rate)


def test_the_vehicle_is_moved_by_what_is_listed_and_by_nothing_else(model):
    """(1) of `row_loop` with recorded sources, integrated row by row, is what the robot does."""
    lag, rate, (k, sigma) = 0.3, 2.0, VEHICLE
    motion = run(model, law_of(rate), lambda time, J: 0.05 * np.sin(np.arange(10) + 2.0 * time),
                 2.0, lag=lag, plan=swaying, step=STEP)
    delta = np.einsum("tij,tj->ti", motion.J[:, :6], motion.d)
    f, c = late(motion, lag)

    def flow(states, delta, f, c):
        e, e_dot, a, c_late, estimate = states  # a = G[v − ÿ̄ + f], c_late = G[c]
        v = -(k + sigma) * e_dot - k * sigma * e - estimate
        return np.array([e_dot, a - f + c_late + delta, (v + f - a) / lag, (c - c_late) / lag,
                         rate * (delta - estimate)])

    def left(*sources):
        """Returns what the sources leave of the largest errors unexplained (6,)."""
        states, e = np.zeros((5, 6)), []
        states[2] = sources[1][0]
        for i in range(len(motion.time)):
            e.append(states[0])
            now, then = ([each[min(i + j, len(e_real) - 1)] for each in sources] for j in (0, 1))
            k1 = flow(states, *now)
            states = states + 0.5 * STEP * (k1 + flow(states + STEP * k1, *then))
        return np.max(np.abs(np.array(e) - e_real), axis=0) / np.max(np.abs(e_real), axis=0)

    e_real = motion.error[:, :6]
    assert np.all(left(delta, f, c) < 0.01)
    for less in ((0.0 * delta, f, c), (delta, 0.0 * f, c), (delta, f, 0.0 * c)):
        assert np.max(left(*less)) > 0.05


def test_behind_a_lag_the_tip_stays_where_resolved_lets_it_swing(model):
    """`resolved` with k = 20, σ = 5 is unstable beyond a lag of (k + σ)/(kσ) = 0.25 s."""
    def sensor_effect(time, J):
        return np.repeat([0.05, 0.0], [6, 4]) * (time < 0.3)

    def tip(motion, start, end):
        when = (motion.time >= start) & (motion.time < end)
        return np.max(np.linalg.norm(motion.error[when, 6:9], axis=1))

    swing = run(model, Resolved(), sensor_effect, 2.4, lag=0.4)
    assert tip(swing, 1.6, 2.4) > 1.5 * tip(swing, 0.4, 1.2)
    held = {lag: run(model, TipFirst(), sensor_effect, 1.6, lag=lag) for lag in (0.0, 0.4)}
    assert tip(held[0.4], 0.0, 1.6) == pytest.approx(tip(held[0.0], 0.0, 1.6), rel=0.01)
    assert tip(held[0.4], 1.2, 1.6) < 0.01 * tip(held[0.4], 0.0, 1.2)
    moved = [np.max(np.abs(held[lag].error[:, :3])) for lag in (0.0, 0.4)]
    assert moved[0] < moved[1] < 0.1


def test_a_sampled_loop_answers_a_wave_as_its_rows_do(model):
    """The shipped systems: a held and late command, an observer with its ticks, a lag."""
    omega, clock, late, lag = 4.0, 0.04, 0.01, 0.1
    law = replace(law_of(2.0, 3.0), tip=BlockGains(10.0, 5.0, 3.0), observer_period=clock)
    robot = Hovering(model, law, step=0.02, actuation=[SampledCommand(clock, late), Lag(lag)],
                     disturbance=SinusoidalDisturbance(bound=0.1, frequency=omega))
    vehicle = RowLoop(*VEHICLE, 2.0, lag, clock, late).wave(omega).position
    tip = RowLoop(10.0, 5.0, 3.0, 0.0, clock, late).wave(omega).position
    outputs = law.observed(model).outputs

    def read():
        now = pair_of(model, robot.read("uvms", "state"), robot.nominal)
        return outputs(now).error

    error = robot.every(0.02, 3.5, read)[-79:]  # the last period of the wave
    J = outputs(pair_of(model, robot.nominal, robot.nominal)).J[0]
    delta = np.abs(J @ np.full(10, 0.1 / np.sqrt(10.0)))
    found = 0.5 * np.ptp(error, axis=0)
    ratio = found / (delta * np.repeat([vehicle, tip], [6, 4]))
    np.testing.assert_allclose(ratio[[0, 1, 2, 5]], 1.0, atol=0.03)
    # The rest is fed forward late: righting moments, and to the held tip the vehicle's wrench.
    assert np.all((ratio[3:5] > 0.85) & (ratio[3:5] < 1.0))
    np.testing.assert_allclose(ratio[6:], 1.0, atol=0.2)
