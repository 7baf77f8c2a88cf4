"""FHOCP for tracking: one problem for all targets, with an artificial reference.

Without contact, drift and limits do not change under a translation, so P, terminal controller and
set of one posture serve at every place. With E the position rows of y = (𝔭, 𝔬, q), a plan has a
translation a ∈ R³ of its reference, ξ = (y − y_des − E a, ζ), and

    min  Σ_{k<N} h (‖ξ_k‖²_Q + ‖ū_k − u_eq‖²_R) + ‖ξ_N‖²_P + V_o(E ᵀy_des + a − target) + ρ s
    s.t. the limits of `Ocp`, inputs for all contact forces if they are `UnderContact`,
         N·𝔭 ≤ x_N for all facets N of the safe region, at all times     (see `SafeDepth`)
         ‖ξ_N‖_P ≤ ρ(a) + s,   ρ(a) = min(ε, min_N (x_N − N·(E ᵀy_des + a))/r_x).

x_N and target, the `TrackingTarget`, may change at every sample. r_x bounds the tip's depth beyond
the reference over ‖ξ‖_P. Proofs in control/ocp/theory.md: recursive feasibility
(#every-problem-is-feasible), convergence (#convergence-to-the-target).
"""

from copy import copy
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from uvms_drake.common.errors import require, unit_vector
from uvms_drake.common.schema import check_values
from uvms_drake.control.convex.staged_program import RadiusBound, StagedProgram
from uvms_drake.control.convex.tracking_program import with_place
from uvms_drake.control.costs.costs import OffsetCost, TaskCost
from uvms_drake.control.limits import Limit
from uvms_drake.control.limits.speeds import SafeDepth, SafeDepthBetweenKnots
from uvms_drake.control.ocp.ocp import Evaluation, MpcConfig, Ocp, PlanPoints
from uvms_drake.control.plan.plan import Plan, TrackingPlan
from uvms_drake.control.plan.points import Points
from uvms_drake.model.uvms_model import UvmsModel

HEADROOM = 1.05
"""Factor of r_x over that of the linearisation at the reference."""
FAR = 1000.0
"""Distance of the check that model and limits are the same everywhere [m]."""


@dataclass(frozen=True)
class TrackingTarget:
    """Target and safe region that a plan is made for."""

    target: np.ndarray
    """Desired position 𝔭 of the end-effector (3,) in Σ_I [m]."""
    safe_depth: np.ndarray | float = np.inf
    """Largest N·𝔭 of each facet, x_N (m,) [m], tightened by the tube."""


class TrackingOcp(Ocp):
    """FHOCP for every target, at first that of y_des without facets.

    Args:
        model: Kinematics and dynamics, without contact.
        mpc: Horizon and weights.
        y_des: Posture of the reference, anywhere (6+n,).
        limits: Tightened limits of the nominal trajectory, by name, the same everywhere; on the
            input, `UnderContact` if there may be any.
        direction: Unit vector n (3,) in Σ_I, into the surface.
        facets: N (m, 3); n alone if None.
        offset: Offset cost V_o.
    """

    strict: ClassVar[bool] = True
    tolerance: ClassVar[float] = 1e-6

    def __init__(self, model: UvmsModel, mpc: MpcConfig, y_des: np.ndarray,
                 limits: dict[str, Limit], direction: np.ndarray, facets: np.ndarray | None = None,
                 offset: OffsetCost | None = None):
        super().__init__(model, mpc, y_des, limits)
        for key, wanted in (("terminal_weight", mpc.terminal_weight is None),
                            ("terms", not mpc.terms)):
            require(wanted, key, getattr(mpc, key), "left out, where the reference moves")
        require(mpc.terminal_set, "terminal_set", mpc.terminal_set, "true, where the target moves")
        self.direction = unit_vector("direction", direction)
        self.facets = self.direction[None] if facets is None else np.asarray(facets, dtype=float)
        self.offset = offset or OffsetCost()
        check_values(self.offset)
        self.moved = np.arange(3)
        self._require_the_same_everywhere()
        self._lasting = limits
        self._stacked_aimed = self._stack_of(self._aimed_limits(TrackingTarget(y_des[:3])))
        self.depth_reach = self._reach()
        self.aim = TrackingTarget(y_des[:3])

    def following_lag(self, committed: int = 0) -> float:
        """Returns n·h(1 − Φ)⁻¹n on 𝔭, the lag of the tip behind a moving reference along n [s].

        Φ is the matrix of the loop with the terminal controller.

        Args:
            committed: Number of intervals at the beginning of a plan that are not decided.
        """
        h, size = self.time_step, self.model.size
        J_x = self.model.task_jacobian(self.model.configuration(self.y_des))
        turned = np.concatenate([0.5 * h**2 * J_x, h * np.eye(size)]) @ self.terminal.gain
        left = -turned  # 1 − Φ
        left[:size, size:] -= h * J_x
        n = np.pad(self.direction, (0, 2 * size - 3))
        return float(h * n @ np.linalg.solve(left, n)) + committed * h

    def _require_the_same_everywhere(self) -> None:
        """Raises `InvalidParameter` unless model and limits do not change under a translation."""
        model, y = self.model, self.y_des
        config = model.configuration(y)
        zeta, u = 0.1 * np.sin(np.arange(2 * model.size)).reshape(2, -1)
        here = Points(model, config, y, zeta, u)
        for shift in FAR * np.concatenate([np.eye(3), -np.eye(3)]):
            by = np.pad(shift, (0, model.size - 3))
            there = Points(model, config + by, y + by, zeta, u)
            require(np.allclose(model.drift(there.config, zeta), model.drift(config, zeta)),
                    "model", type(model).__name__, "without contact, for the reference moves")
            for limit in self.limits.values():
                require(np.allclose(limit.values(there), limit.values(here)),
                        f"limits.{limit.name}", type(limit).__name__,
                        "left out, or the same everywhere, for the reference moves")
    def _reach(self) -> float:
        """Returns r_x [m]."""
        size = self.model.size
        J_x = self.model.task_jacobian(self.model.configuration(self.y_des))
        here = np.pad(self.facets, ((0, 0), (0, 2 * size - 3)))
        between = here + 0.5 * self.time_step * np.pad(self.facets @ J_x[:3], ((0, 0), (size, 0)))
        inverse = np.linalg.inv(self.terminal.P)
        return HEADROOM * max(float(np.sqrt(np.max(np.sum(each @ inverse * each, axis=1))))
                              for each in (here, between))

    @property
    def inputs_given(self) -> dict[str, int]:
        """Sizes of the parts of a `TrackingTarget`, by the names of ports."""
        return {"target": 3, "safe_depth": len(self.facets)}

    @property
    def reach_names(self) -> tuple[str, ...]:
        """Names of the values of `SafeDepth` and `SafeDepthBetweenKnots`."""
        count = len(self.facets)
        parts = [""] if count == 1 else [f"[{i}]" for i in range(count)]
        return tuple(f"{limit.name}{part}" for limit in (SafeDepth, SafeDepthBetweenKnots)
                     for part in parts)

    def aimed(self, aim: TrackingTarget) -> Self:
        """Returns the problem of another target; it shares all that does not depend on it."""
        out = copy(self)
        out.aim, out.limits = aim, self._aimed_limits(aim)
        out._stacked = self._stacked_aimed.with_bounds(out.limits) or self._stacked_aimed
        return out

    def _aimed_limits(self, aim: TrackingTarget) -> dict[str, Limit]:
        """Returns the limits with those of a safe region."""
        depths = np.broadcast_to(np.asarray(aim.safe_depth, dtype=float), (len(self.facets),))
        return {**self._lasting, SafeDepth.name: SafeDepth(self.facets, depths),
                SafeDepthBetweenKnots.name: SafeDepthBetweenKnots(
                    self.facets, depths, self.time_step)}

    def given(self, values: dict[str, np.ndarray]) -> Self:
        """Returns the problem of the given target and safe depth."""
        return self.aimed(TrackingTarget(
            values.get("target", self.aim.target),
            values.get("safe_depth", self.aim.safe_depth)))

    @property
    def lasting_limits(self) -> dict[str, Limit]:
        """Limits other than those of the safe region."""
        return self._lasting

    def reached(self, at: Points) -> tuple[np.ndarray, np.ndarray]:
        """Returns depths of the tip at the knot and half an interval later, and r_x of each."""
        here, nowhere = self.facets @ self.y_des[:3], np.full(len(self.facets), np.inf)
        depth = SafeDepth(self.facets, nowhere).values(at) - here
        between = SafeDepthBetweenKnots(self.facets, nowhere, self.time_step).values(at) - here
        return (np.concatenate([depth, between], axis=-1),
                np.full(2 * len(here), self.depth_reach))

    def resting_plan(self, time: float, state: np.ndarray, coasting: int = 0) -> TrackingPlan:
        """Returns a first guess: coast, then come to rest, with the reference there."""
        plan = super().resting_plan(time, state, coasting)
        return TrackingPlan(**vars(plan), a=self._error(plan.config[-1])[:3])

    def reference(self, plan: Plan) -> np.ndarray:
        """Returns y_des + E a (6+n,)."""
        assert isinstance(plan, TrackingPlan)
        out = self.y_des.copy()
        out[:3] += plan.a
        return out

    def errors(self, plan: Plan, y: np.ndarray) -> np.ndarray:
        """Returns ξ = (y − y_des − E a, ζ) at the knots (N+1, 2(6+n))."""
        return np.concatenate([y - self.reference(plan), plan.zeta], axis=1)

    def terminal_radius(self, plan: Plan) -> float:
        """Returns the radius ρ(a)."""
        return float(np.min(self.radius_bound(plan).size, initial=self.terminal.radius))

    def radius_bound(self, plan: Plan) -> RadiusBound:
        """Returns the bounds of ρ(a) other than ε, those of the facets, with gradients by a."""
        sizes = (self.aim.safe_depth - self.facets @ self.reference(plan)[:3]) / self.depth_reach
        there = np.isfinite(sizes)
        return RadiusBound(sizes[there], (-self.facets / self.depth_reach)[there])

    def stage_cost(self, plan: Plan) -> TaskCost:
        """Returns the cost about the plan's reference."""
        return replace(self.task_cost, y_des=self.reference(plan))

    def _missing(self, plan: Plan) -> np.ndarray:
        """Returns the offset E ᵀy_des + a − target (3,) [m]."""
        return self.reference(plan)[:3] - self.aim.target

    def evaluate(self, plan: Plan, points: PlanPoints | None = None) -> Evaluation:
        """Returns the objective, V_o in it, and the violations of a plan."""
        value = super().evaluate(plan, points)
        return replace(value, cost=value.cost + self.offset.value(self._missing(plan)))

    def offset_cost(self, plan: Plan) -> tuple[float, np.ndarray]:
        """Returns V_o and its gradient by a."""
        missing = self._missing(plan)
        return self.offset.value(missing), self.offset.quadratic(missing)[1]

    def staged_program(self, plan: Plan, points: PlanPoints | None = None) -> StagedProgram:
        """Returns the convex program about a plan; its w is the change of a and of ζ̄̇."""
        bound = self.radius_bound(plan)
        by_state_and_a = np.pad(bound.rows, ((0, 0), (self.state_size, 0)))
        return with_place(
            super().staged_program(plan, points), self.moved,
            *self.offset.quadratic(self._missing(plan)),
            bound._replace(rows=by_state_and_a) if len(bound.size) else None)

    def revalued(self, program: StagedProgram, plan: Plan, points: PlanPoints
                 ) -> StagedProgram:
        """Returns a program with its own slopes, limited values and radii at another plan."""
        out, bound = super().revalued(program, plan, points), program.terminal.radius_bound
        return replace(out, terminal=out.terminal._replace(
            radius_bound=bound and bound._replace(size=self.radius_bound(plan).size)))
