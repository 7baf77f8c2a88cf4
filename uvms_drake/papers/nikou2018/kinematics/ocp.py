"""FHOCP of the kinematics, as in the paper's simulation: ξ = y − y_des, the input is ζ̄.

    ȳ_{k+1} = Φ(ȳ_k, ζ̄_k, 0),  ζ̄ constant on N intervals of length h              (eq:diff_mpc)

Joints of weight zero are free, as in the paper, which weighs only χ − χ_des.
"""

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.control.convex.staged_program import StagedProgram
from uvms_drake.control.costs.task_cost import TaskCost
from uvms_drake.control.limits import Limit
from uvms_drake.control.ocp.limit_stack import Inputs
from uvms_drake.control.ocp.ocp import MpcConfig, Ocp, PlanPoints, weight
from uvms_drake.control.plan.plan import advance
from uvms_drake.control.plan.points import Points, Slopes
from uvms_drake.control.plan.terminal import declared_terminal
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.papers.nikou2018.kinematics.plan import (
    KinematicPlan,
    kinematic_terminal_ingredients,
)


class KinematicOcp(Ocp[KinematicPlan]):
    """FHOCP of one task for the kinematics of one model; see `Ocp` for the arguments."""

    given_speed = -1
    has_accelerations = False
    input_ends = 1

    def __init__(self, model: UvmsModel, mpc: MpcConfig, y_des: np.ndarray,
                 limits: dict[str, Limit]):
        super().__init__(model, mpc, y_des, limits)
        weight_y = weight(mpc, "weight_y", model.size, zeros=True)
        weighted = bool(np.all(weight_y[:6] > 0.0) and (
            np.all(weight_y[6:] > 0.0) or np.all(weight_y[6:] == 0.0)))
        require(weighted, "weight_y", weight_y,
                "6 positive numbers, and for the joints positive ones or zeros only")
        Q, R = np.diag(weight_y), np.diag(weight(mpc, "weight_zeta", model.size))
        self.task_cost = TaskCost(Q, R, y_des, np.zeros(model.size))
        if mpc.terminal_weight is not None:
            self.terminal = declared_terminal(
                weight(mpc, "terminal_weight", model.size, zeros=True), model.size, self._radius)
            return
        self.terminal = kinematic_terminal_ingredients(
            model.task_jacobian(model.configuration(y_des)), Q, R, mpc.time_step,
            self._radius)

    @property
    def state_size(self) -> int:
        """Size 6+n of 𝔮."""
        return self.model.size

    def resting_plan(self, time: float, state: np.ndarray, coasting: int = 0) -> KinematicPlan:
        """Returns a first guess: stay at 𝔮 (6+n,)."""
        return KinematicPlan.from_velocities(
            time, self.time_step, state, np.zeros((coasting + self.horizon, self.model.size)))

    def errors(self, plan: KinematicPlan, y: np.ndarray) -> np.ndarray:
        """Returns ξ = y − y_des at the knots (N+1, 6+n)."""
        return y - self.y_des

    def inputs(self, plan: KinematicPlan) -> tuple[np.ndarray, np.ndarray]:
        """Returns ζ̄ (N, 6+n), the same at the beginning and at the end of every interval."""
        return plan.zeta, plan.zeta

    def _inputs_at(self, plan: KinematicPlan, knots: Points) -> tuple[np.ndarray, np.ndarray]:
        return plan.zeta, plan.zeta

    def nominal_input(self, at: tuple[np.ndarray, ...]) -> np.ndarray:
        """Returns ζ̄ (6+n,)."""
        return at[1]

    def move(self, xi: np.ndarray, decision: np.ndarray
             ) -> tuple[np.ndarray, np.ndarray, Points, Points]:
        """Returns ξ⁺ (..., 6+n), the decision ζ̄, and both ends."""
        model, y = self.model, self.y_des + xi
        config = model.configuration(y)
        end = advance(config, decision, np.zeros_like(decision), self.time_step)
        error = self._error(end)
        return (error, decision, Points(model, config, y, decision, decision),
                Points(model, end, self.y_des + error, decision, decision))

    def state_rows(self) -> Slopes:
        """Returns ξ itself, and ζ̄ = gain · ξ."""
        return Slopes(np.eye(self.state_size), self.terminal.gain)

    def velocities(self, plan: KinematicPlan) -> np.ndarray:
        """Returns ζ̄, and zero at the last knot."""
        return np.concatenate([plan.zeta, np.zeros((1, self.model.size))])

    def staged_program(self, plan: KinematicPlan, points: PlanPoints | None = None
                       ) -> StagedProgram:
        """Returns the convex program about a plan; its w is the change of ζ̄."""
        points = points or self.points(plan)
        model = self._transitions(points.knots, plan.zeta, np.zeros_like(plan.zeta))
        return self._program(plan, model.dy_dy, model.dy_dzeta, points,
                             self._inputs_by(points.begin, 2 * self.model.size))

    def interval_inputs(self, plan: KinematicPlan, knots: Points) -> Inputs:
        """Returns ζ̄ and its derivatives by y at the first knot, ζ̄, and y at the last."""
        return self._inputs_by(self._ends(plan, knots), 3 * self.model.size)

    def _inputs_by(self, begin: Points, width: int) -> Inputs:
        """Returns ζ̄ and its derivatives by z (`width`,), which starts with y and ζ."""
        y_z, zeta_z = np.repeat(self._state_z(width)[:, None], len(begin.config), axis=1)
        return Inputs(begin, y_z, zeta_z, zeta_z)
