"""Tests of `tube.actuation.thruster_budget`: bounds by source, and what comes back of them."""

from dataclasses import replace

import numpy as np
import pytest

from uvms_drake.tube.actuation.thruster_budget import (
    ARM,
    CONTACT,
    OFF_PLAN,
    PLAN,
    TURNING,
    WRENCH,
    Errors,
    ThrusterBudget,
    least_bounds,
)
from uvms_drake.tube.actuation.thruster_feedforward import ThrusterFeedforward
from uvms_drake.tube.loops.actuator_path import Actuators, Path
from uvms_drake.tube.loops.row_loop import RowLoop

SHAPES = dict(zip(ThrusterFeedforward._fields, (
    *[(4,)] * 5, (4, 4), (4, 10), (4, 10), (4, 4), (4, 4),
    *[(4,)] * 4, (2, 20), (10,)), strict=True))
ZERO = ThrusterFeedforward(**{name: np.zeros(shape) for name, shape in SHAPES.items()})
NONE = Errors(np.zeros(10), np.zeros(10), np.zeros(4), np.zeros(4))
VEHICLE, JOINTS = Path(0.02, 0.03, 0.1), Path(0.02, 0.01)
K, SIGMA = 4.0, 2.0


LOOPS = [RowLoop(K, SIGMA, 0.0, path.lag, path.period, path.dead_time)
         for path in (VEHICLE, JOINTS)]


def parts(loads: ThrusterFeedforward, errors: Errors = NONE, force=(0.0, 0.0, 0.0)):
    return ThrusterBudget(Actuators(VEHICLE, JOINTS, True), *LOOPS, loads, force).parts(errors)


class Row:
    """The vehicle's row with a map A(t) and a load h(t) of its own, in small steps."""

    def __init__(self, A, h, y_ddot, step=2e-3):
        self.e = self.rate = 0.0
        tau, commands, self.error = (y_ddot(0.0) + h(0.0)) / A(0.0), [], []
        late, period = round(VEHICLE.dead_time / step), round(VEHICLE.period / step)
        waiting = [tau] * (late // period + 2)
        for i in range(round(9.0 / step)):
            t = i * step
            if i % period == 0:
                v = y_ddot(t) - (K + SIGMA) * self.rate - K * SIGMA * self.e
                commands.append((v + h(t)) / A(t))
            k = (i - late) // period
            tau += step / VEHICLE.lag * ((commands[k] if k >= 0 else waiting[0]) - tau)
            acceleration = A(t + step) * tau - h(t + step) - y_ddot(t)
            self.rate += step * acceleration
            self.e += step * self.rate
            self.error.append(self.e)


def test_no_plan_and_no_map_moves_a_row_further_than_its_lines():
    """A plan that jumps at the worst of times, loads that swing and a map that turns."""
    rng = np.random.default_rng(0)
    ratios = []
    for turning, level, load_rate in ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.15, 0.5, 0.4)):
        omega, phase = 2.2, rng.uniform(0.0, np.pi)
        swing = load_rate / omega

        def A(t, turning=turning, omega=omega):
            return float(np.exp(turning / omega * np.sin(omega * t)))

        def h(t, swing=swing, omega=omega, phase=phase):
            return swing * float(np.sin(omega * t + phase))

        def y_ddot(t, level=level):
            return level * (1.0 if int(t / 1.2) % 2 else -1.0)  # knots of a plan

        loads = ZERO._replace(
            plan=np.full(4, level + swing), plan_rate=np.full(4, load_rate),
            jump=np.full(4, level), smooth_rate=np.full(4, load_rate),
            turning=turning * np.eye(4))
        w = np.zeros(4)
        for _ in range(60):  # w by what it makes
            claim = sum(parts(loads, NONE._replace(w=w)).values())
            w = claim[:, 2]
        found = np.max(np.abs(Row(A, h, y_ddot).error))
        ratios.append(found / claim[0, 0])
    assert np.max(ratios) <= 1.0
    assert ratios[0] > 0.8, ratios
    assert np.min(ratios) > 0.3, ratios


def test_a_plan_known_ahead_costs_less():
    loads = ZERO._replace(plan=np.ones(4), jump=np.ones(4))
    paths = [replace(path, preview=path.age - 0.5 * path.period) for path in (VEHICLE, JOINTS)]
    loops = [replace(loop, preview=path.preview) for loop, path in zip(LOOPS, paths, strict=True)]
    known = ThrusterBudget(Actuators(*paths, True), *loops, loads, (0.0, 0.0, 0.0)).parts(NONE)
    assert known[PLAN][0, 0] < 0.5 * parts(loads)[PLAN][0, 0]


def test_a_hold_alone_has_finite_bounds_of_what_the_vehicle_gets():
    """Nothing says how fast a wrench without a lag varies."""
    path, row = Path(0.02, 0.01), RowLoop(K, SIGMA, 0.0, 0.0, 0.02, 0.01)
    across = np.zeros((4, 4))
    across[2:, :2] = 1.0
    loads = ZERO._replace(by_wrench=across, by_tip=across.T, plan=np.ones(4))
    found = ThrusterBudget(Actuators(path, path), row, row, loads, (0.0, 0.0, 0.0)).parts(NONE)
    assert all(np.isfinite(value).all() for value in found.values())
    assert found[WRENCH][2, 0] == pytest.approx(4.0 * row.gains["free_feed_forward"].position)
    assert found[ARM][0, 0] > 0.0


def test_every_source_counts_where_it_pushes_and_nowhere_else():
    one = np.ones(4)
    across = np.zeros((4, 4))
    across[:2, 2:] = 1.0
    x, w = Errors(np.ones(10), np.ones(10), one, one), NONE._replace(w=one)
    for source, loads, errors, force, rows in (
            (PLAN, {"plan": one, "jump": one}, NONE, (0, 0, 0), range(4)),
            (OFF_PLAN, {"by_error": np.ones((4, 10))}, x, (0, 0, 0), range(4)),
            (OFF_PLAN, {"by_error_rate": np.ones((4, 10))}, x, (0, 0, 0), range(4)),
            (TURNING, {"turning": np.eye(4)}, w, (0, 0, 0), range(4)),
            (WRENCH, {"by_wrench": across.T}, w, (0, 0, 0), (2, 3)),
            (ARM, {"by_tip": across}, x, (0, 0, 0), (0, 1)),
            (CONTACT, {"by_force": one}, NONE, (1.0, 1.0, 0.0), (0, 1))):
        found = parts(ZERO._replace(**loads), errors, force)
        pushed = np.flatnonzero(found[source][:, 0])
        assert list(pushed) == list(rows), source
        others = {name for name, value in found.items() if name != source and value.any()}
        assert others <= {OFF_PLAN, TURNING}, (source, others)


def test_a_contact_is_late_by_no_more_than_all_of_it():
    slow, fast = (parts(ZERO._replace(by_force=np.ones(4)), force=(10.0, rate, 1.0))[CONTACT]
                  for rate in (10.0, 1e6))
    late = VEHICLE.age - JOINTS.age
    assert fast[0, 0] == pytest.approx(slow[0, 0] * 20.0 / (10.0 * late + 2.0))


def test_bounds_of_each_other_are_the_least_ones():
    """That is z = a + B z by its series, and none if the series does not end."""
    rng = np.random.default_rng(1)
    a, B = rng.uniform(size=6), rng.uniform(size=(6, 6))
    B /= np.max(np.abs(np.linalg.eigvals(B)))
    z, share = least_bounds(lambda z: (a + 0.8 * B @ z.ravel()).reshape(2, 3), (2, 3))
    assert share == pytest.approx(0.8)
    series = sum(np.linalg.matrix_power(0.8 * B, i) @ a for i in range(200))
    np.testing.assert_allclose(z.ravel(), series)
    z, share = least_bounds(lambda z: a + 1.01 * B @ z, (6,))
    assert np.isinf(z).all()
    assert share == pytest.approx(1.01)
