"""This project's own solvers on the two problems: the fast one and the reference.

ocp-k is `KinematicOcp` as it stands. In ocp-d the input is constant over a step; in `Ocp`
the acceleration is, and the input follows it. `ZeroOrderHoldOcp` takes the mean of the inputs at
both ends of the interval, by the trapezoidal rule for ζ̇ = f + u. Its error is seen in the closed
loop, whose plant is the RK4 step: in the cost, and in the speed limits that the plan touches.
"""

from dataclasses import replace

import numpy as np
from problems import (
    CHI_DES,
    HORIZON,
    JOINT_LOWER,
    JOINT_UPPER,
    PITCH_LIMIT,
    SPEED_LIMIT,
    STEP,
    U_EQ,
    Problem,
    load_model,
)
from pydrake.solvers import SnoptSolver

from uvms_drake.control.limits.inputs import Accelerations
from uvms_drake.control.limits.pose import Joints, VehicleAngle
from uvms_drake.control.limits.speeds import Speed
from uvms_drake.control.mpc.planner import FIRST_SOLVE_ITERATIONS
from uvms_drake.control.ocp.limit_stack import Inputs
from uvms_drake.control.ocp.ocp import MpcConfig, Ocp
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.control.ocp.solvers import NonlinearSolver
from uvms_drake.control.plan.plan import Plan
from uvms_drake.control.plan.points import Points


class ZeroOrderHoldOcp(Ocp):
    """The problem with ū constant on every interval."""

    def _inputs_at(self, plan: Plan, knots: Points) -> tuple[np.ndarray, np.ndarray]:
        """Returns the constant ū (N, 10), twice."""
        begin, end = super()._inputs_at(plan, knots)
        return 0.5 * (begin + end), 0.5 * (begin + end)

    def _inputs_by(self, plan: Plan, knots: Points, xi_z: np.ndarray) -> Inputs:
        """Returns the constant ū and its derivatives, twice."""
        at, y_z, zeta_z, u_z = super()._inputs_by(plan, knots, xi_z)
        begin, end = np.split(u_z, 2)
        return Inputs(at, y_z, zeta_z, np.tile(0.5 * (begin + end), (2, 1, 1)))


def make_ocp(problem: Problem) -> Ocp:
    """Returns the problem for this project's solvers."""
    y_des = np.concatenate([CHI_DES, np.zeros(4)])  # The joints weigh nothing.
    task = np.repeat([problem.task_weight, 0.0], [6, 4])
    terminal = np.concatenate([task, np.full(10, problem.terminal_velocity_weight)])
    config = MpcConfig(
        horizon=HORIZON, time_step=STEP, weight_y=task,
        weight_zeta=np.full(10, problem.velocity_weight),
        weight_u=np.full(10, problem.input_weight), terminal_weight=terminal, terminal_set=False)
    limits = {limit.name: limit for limit in [
        *(Speed(name, SPEED_LIMIT) for name in ("nu1", "nu2", "qdot")),
        VehicleAngle("pitch", PITCH_LIMIT), Joints(JOINT_LOWER, JOINT_UPPER),
        Accelerations(np.full(10, problem.input_limit))]}
    ocp = ZeroOrderHoldOcp(load_model(), config, y_des, limits)
    ocp.task_cost = replace(ocp.task_cost, u_ref=U_EQ)
    return ocp


class FastController:
    """The fast solver, warm-started by its shifted plan; the first step iterates to convergence.

    Args:
        problem: Problem to solve.
        iterations: At most so many convex programs a step.
        tolerance: Converged when a step improves the merit by less than this fraction of it.
    """

    def __init__(self, problem: Problem, iterations: int, tolerance: float = 1e-6):
        kind = "one iteration" if iterations == 1 else "converged"
        self.name = f"uvms_drake, {kind}"
        self.status = True
        self._ocp = make_ocp(problem)
        self._solver = SequentialConvexSolver(self._ocp)
        self._iterations, self._tolerance = iterations, tolerance
        self._plan: Plan | None = None

    def reset(self) -> None:
        """Forgets the last plan."""
        self._plan = None

    def step(self, x: np.ndarray) -> np.ndarray:
        """Returns u (10,) at the measured state x."""
        iterations = FIRST_SOLVE_ITERATIONS if self._plan is None else self._iterations
        guess = _guess(self._ocp, self._plan, x)
        solution = self._solver.solve(guess, iterations, self._tolerance)
        self.status = solution.converged or (self._iterations == 1 and solution.plan is not None)
        self._plan = solution.plan if solution.plan is not None else guess
        return self._ocp.inputs(self._plan)[0][0]


class ReferenceController:
    """The reference solver, SNOPT on the whole nonlinear program, warm-started likewise."""

    def __init__(self, problem: Problem):
        self.name = "uvms_drake, SNOPT on the whole problem"
        self.status = True
        self._ocp = make_ocp(problem)
        self._solver = NonlinearSolver(self._ocp, SnoptSolver())
        self._plan: Plan | None = None

    def reset(self) -> None:
        """Forgets the last plan."""
        self._plan = None

    def step(self, x: np.ndarray) -> np.ndarray:
        """Returns u (10,) at the measured state x."""
        guess = _guess(self._ocp, self._plan, x)
        solution = self._solver.solve(guess)
        self.status = solution.converged
        self._plan = solution.plan if solution.plan is not None else guess
        return self._ocp.inputs(self._plan)[0][0]


def _guess(ocp: Ocp, last: Plan | None, x: np.ndarray) -> Plan:
    """Returns the plan of the last step, shifted by one, from the measured state x."""
    if last is None:
        return ocp.resting_plan(0.0, x)
    shifted = ocp.continued(last)
    return shifted.redone(x, shifted.decision)
