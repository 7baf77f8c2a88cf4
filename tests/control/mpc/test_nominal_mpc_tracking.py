"""Tests of `uvms_drake.control.mpc.nominal_mpc` with a problem whose target is an input."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from support.tracking import DIRECTION, POSITION, at_rest, tracking_ocp

from uvms_drake.common.errors import RunFailed
from uvms_drake.control.mpc.nominal_mpc import NominalMpc
from uvms_drake.control.mpc.planner import FAILED, MPC_REPORT, SOLVED
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.control.ocp.tracking_ocp import TrackingOcp, TrackingTarget

H = 0.2  # s
PORTS = {"target": 3, "safe_depth": 1}


@pytest.fixture(scope="module")
def ocp() -> TrackingOcp:
    return tracking_ocp(overrides=("mpc.horizon=3", "mpc.iterations=2"))


class Loop:
    """A planner with its aim; the measured state never changes."""

    def __init__(self, ocp: TrackingOcp, start: np.ndarray, **given: object):
        builder = DiagramBuilder()
        source = builder.AddSystem(ConstantVectorSource(start))
        self.mpc = NominalMpc.AddToBuilder(
            builder, SequentialConvexSolver(ocp), state=source.get_output_port())
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.give(**given)

    def give(self, **given: object) -> None:
        context = self.mpc.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())
        for name, value in given.items():
            self.mpc.GetInputPort(name).FixValue(context, np.atleast_1d(value))

    def read(self, name: str, context=None):
        return self.mpc.GetOutputPort(name).Eval(self.mpc.GetMyContextFromRoot(
            context or self.simulator.get_context()))

    def report(self) -> dict[str, float]:
        return dict(zip(MPC_REPORT, self.read("report"), strict=True))


def test_without_an_aim_it_stays_at_the_reference(ocp):
    loop = Loop(ocp, at_rest(ocp, POSITION))
    loop.simulator.AdvanceTo(2.5 * H)
    assert loop.report()["cost"] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(
        loop.read("nominal_state"), at_rest(ocp, POSITION), atol=1e-9)


def test_every_plan_is_that_of_the_problem_for_what_is_given_at_the_sample(ocp):
    """From the last plan continued, with the iterations of a sample."""
    loop = Loop(ocp, at_rest(ocp, POSITION), target=POSITION + 0.1,
                safe_depth=POSITION[0] + 0.05)
    loop.simulator.Initialize()
    plan = loop.read("plan")
    for k, (target, depth) in enumerate([
            (POSITION - 0.1, 0.05), (POSITION + 0.3, 0.05), (POSITION + 0.3, 0.1)], start=1):
        aim = TrackingTarget(target, POSITION[0] + depth)
        loop.give(target=target, safe_depth=aim.safe_depth)
        loop.simulator.AdvanceTo((k + 0.5) * H)
        problem = ocp.aimed(aim)
        expected = SequentialConvexSolver(problem).solve(problem.continued(plan), 2)
        plan, report = loop.read("plan"), loop.report()
        np.testing.assert_array_equal(plan.zeta_dot, expected.plan.zeta_dot)
        np.testing.assert_array_equal(plan.a, expected.plan.a)
        assert report["status"] == SOLVED
        assert report["cost"] == expected.evaluation.cost
        assert max(report["violation"], report["terminal_slack"]) <= 1e-6


def test_a_target_that_is_no_number_fails_the_sample_and_nothing_else(ocp):
    loop = Loop(ocp, at_rest(ocp, POSITION), target=POSITION + 0.1, safe_depth=POSITION[0] + 0.05)
    loop.simulator.AdvanceTo(1.5 * H)
    plan = loop.read("plan")
    loop.give(target=np.full(3, np.nan))
    loop.simulator.AdvanceTo(2.5 * H)
    assert loop.report()["status"] == FAILED
    np.testing.assert_array_equal(loop.read("plan").zeta_dot, ocp.continued(plan).zeta_dot)
    np.testing.assert_array_equal(loop.read("plan").a, plan.a)
    loop.give(target=POSITION)
    loop.simulator.AdvanceTo(3.5 * H)
    assert loop.report()["status"] == SOLVED


def test_a_start_whose_plan_cannot_end_in_the_set_is_refused(ocp):
    """The proof begins with a plan that does: here the arm is too far from its posture."""
    start = at_rest(ocp, POSITION)
    start[6:10] += 0.4 * (ocp.limits["q"].upper - start[6:10])
    start[3:5] = 0.0
    with pytest.raises(RunFailed, match=r"no solution at the start, t = 0 s: .*out of the reach"):
        Loop(ocp, start, target=POSITION).simulator.Initialize()


def test_a_start_beyond_the_safe_region_is_refused(ocp):
    with pytest.raises(RunFailed, match=r"at rest, limits\.safe_depth is exceeded by 0\.1"):
        Loop(ocp, at_rest(ocp, POSITION), target=POSITION,
             safe_depth=POSITION @ DIRECTION - 0.1).simulator.Initialize()
