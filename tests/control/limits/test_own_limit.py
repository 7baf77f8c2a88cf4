"""Limits of one's own: shipped kinds and one that a script makes up, at all that ask a limit."""

import copy
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.solvers import SnoptSolver

import uvms_drake as uv
from uvms_drake.certificate.certify import between_knots, tightening_margins
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.control.ocp.solvers import NonlinearSolver
from uvms_drake.report.signals import constraints
from uvms_drake.station.diagram import setting_of
from uvms_drake.station.problem import limits_of
from uvms_drake.tube.terminal_set import TerminalLoop

BOX = "{lower_corner: [-3, -3, -3], upper_corner: [3, 3, 3]}"
VELOCITY = "!TipVelocity {bound: [0.1, 0.2, 0.2]}"


@dataclass
class Elbow(uv.Limit):
    """|q₁ + q₂² − centre| ≤ bound: a limit of a script's own."""

    name = "elbow"

    bound: float = 3.0
    centre: float = 0.0

    def values(self, at: uv.Points) -> np.ndarray:
        return at.config[..., 6:7] + at.config[..., 7:8] ** 2 - self.centre

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.array([-self.bound]), np.array([self.bound])


class KnownElbow(Elbow):
    """The same for small radii, with its tightening."""

    def tube_takes(self, tube: uv.limits.TubeRadii) -> np.ndarray:
        return np.array([5.0 * tube.joints])


class Nameless(uv.Limit):
    """The same, of which its author forgot the name."""

    values, bounds = Elbow.values, lambda self: (np.array([-1.0]), np.array([1.0]))


class Scalar(Elbow):
    """The same, with numbers where arrays are wanted."""

    def bounds(self):
        return -1.0, 1.0


@pytest.fixture(scope="module")
def scenario() -> uv.Scenario:
    return uv.load_scenario("girona500_ideal", [
        "mpc.horizon=5", f"limits.more=[{BOX}, {VELOCITY}]"])


def with_own(scenario: uv.Scenario, *limits: uv.Limit) -> uv.Scenario:
    return replace(scenario, limits=replace(scenario.limits, more=list(limits)))


@pytest.mark.parametrize(("own", "key"), [
    (uv.limits.TipBox(), "limits.more[0].lower_corner"),
    (uv.limits.TipBox(np.zeros(3), np.zeros(3)), "limits.more[0].bounds"),
    (uv.limits.TipVelocity(np.array([0.1, 0.0, 0.1])), "limits.more[0].bounds"),
    (Nameless(), "limits.more[0].name"),
    (Scalar(), "limits.more[0].bounds"),
])
def test_a_further_limit_without_meaning_is_refused(own, key):
    with pytest.raises(uv.InvalidParameter) as caught:
        uv.limits.make_limits(uv.limits.Limits(u=np.ones(10), more=[own]), np.full(4, -1.0),
                              np.ones(4), uv.UnilateralPlane())
    assert caught.value.key == key


@pytest.mark.slow
def test_fast_solver_and_reference_agree_where_they_are_active(scenario):
    """With 7/10 of the speed, the way and the turn that a plan without them takes."""
    ocp = uv.make_ocp(with_own(scenario))
    guess = ocp.resting_plan(0.0, uv.start_state(scenario, ocp))
    free = SequentialConvexSolver(ocp).solve(guess, 50, 1e-10)
    config = free.plan.config
    at = uv.Points(ocp.model, config, ocp.model.task_pose(config), free.plan.zeta)
    start = at.y[0, :3]
    reached, fastest = (np.max(np.abs(each), axis=0) for each in (
        at.y[:, :3] - start, uv.limits.TipVelocity(np.ones(3)).values(at)))
    elbow = Elbow().values(at)[:, 0]
    for own in (uv.limits.TipBox(start - 0.7 * reached, start + 0.7 * reached),
                uv.limits.TipVelocity(0.7 * fastest),
                Elbow(0.7 * float(np.max(np.abs(elbow - elbow[0]))), float(elbow[0]))):
        limited = copy.copy(ocp)
        limited.limits = ocp.limits | {own.name: own}
        assert limited.evaluate(free.plan).violation > 1e-3, "else it says nothing"
        one = SequentialConvexSolver(limited).solve(guess, 100, 1e-12)
        other = NonlinearSolver(limited, SnoptSolver()).solve(guess)
        assert other.converged
        assert one.evaluation.violation < 1e-6
        assert one.evaluation.cost == pytest.approx(other.evaluation.cost, rel=1e-3)
        assert one.evaluation.cost > free.evaluation.cost


def test_a_plan_that_leaves_it_between_two_knots_is_found_out(scenario):
    ocp = uv.make_ocp(scenario)
    guess = ocp.resting_plan(0.0, uv.start_state(scenario, ocp))
    plan = SequentialConvexSolver(ocp).solve(guess, 20).plan
    inside = between_knots(ocp, plan).excess
    ocp.limits["tip_velocity"] = uv.limits.TipVelocity(np.full(3, 1e-3))
    found = between_knots(ocp, plan)
    assert found.excess > inside + 1e-3
    assert found.label.startswith("tip_velocity")


def test_the_terminal_set_knows_them(scenario):
    loop = TerminalLoop(uv.make_ocp(with_own(scenario, *scenario.limits.more, Elbow())))
    assert {"tip_x", "tip_y", "tip_z"} <= set(loop.closed_form_limits())
    assert {"tip_velocity[0]", "tip_velocity[2]", "elbow"} <= set(loop.names)


def test_only_a_known_tightening_leaves_a_margin(scenario):
    model = uv.make_ocp(scenario).model
    found = SimpleNamespace(radii=scenario.tube, estimated=())
    margins = {name: condition.holds for own in (Elbow(), KnownElbow())
               for condition in tightening_margins(found, limits_of(
        with_own(scenario, *scenario.limits.more, own), model))
        for name in [condition.name] if "elbow" in name or "tip_" in name}
    unknown = "limits.{}, no tightening by the tube is defined"
    assert margins == {
        "tube in limits.tip_pitch": True, "tube in limits.tip_x": True,
        "tube in limits.tip_y": True, "tube in limits.tip_z": True,
        unknown.format("tip_velocity"): False, unknown.format("elbow"): False,
        "tube in limits.elbow": True}


def test_a_run_with_them_has_their_signals_and_their_bars(scenario):
    own = with_own(replace(scenario, duration=0.4), *scenario.limits.more, Elbow())
    record = uv.simulate(own)
    signals = constraints(record)
    np.testing.assert_allclose(signals["tip_x_max"][0], record.chi[:, 0], atol=1e-12)
    values, bound, *_ = signals["elbow_max"]
    np.testing.assert_allclose(values, record.config[:, 6] + record.config[:, 7] ** 2)
    assert bound == 3.0
    limit_use = setting_of(own, record.model).limit_use
    names = limit_use.names
    assert [name.split("  ")[0] for name in names[-7:-4]] == ["tip x", "tip y", "tip z"]
    assert names[-4] == "tip speed x  ≤ 0.1 m/s"
    used, _ = limit_use(
        record.state[0], record.u[0], record.nominal_state[0], record.nominal_input[0])
    assert used[-1] == pytest.approx(values[0] / 3.0, abs=0.05)


def test_a_tube_that_knows_how_fast_the_tip_leaves_the_plan_tightens_its_velocity():
    limit = uv.limits.TipVelocity(np.array([0.1, 0.2, 0.3]))
    assert limit.tube_takes(uv.limits.TubeRadii()) is None
    less = limit.tightened(uv.limits.TubeRadii(tip_speed=0.04)).upper
    assert less == pytest.approx([0.06, 0.16, 0.26])
