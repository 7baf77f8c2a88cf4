"""One FHOCP for every target: its reference moves, and is decided with the plan.

Deep water is the same everywhere: without contact, drift and limits do not change under a
translation, so P, terminal controller and set of *one* posture serve at every place. With E the
position rows of y = (𝔭, 𝔬, q), a plan has an artificial translation a ∈ R³ of its reference, and

    min  Σ_{k<N} h (‖ξ_k‖²_Q + ‖ū_k − u_eq‖²_R) + ‖ξ_N‖²_P + V_o(E ᵀy_des + a − target) + ρ s,
         ξ = (y − y_des − E a, ζ)                                             (Limon et al. 2018)
    s.t. what `DynamicOcp` asks for, inputs for all contact forces if the limits are `UnderContact`,
         N·𝔭 ≤ x_N for all facets N, at all times                             (see `limits.safe_depth`)
         ‖ξ_N‖_P ≤ ρ(a) + s,   ρ(a) = min(ε, min_N (x_N − N·(E ᵀy_des + a))/r_x).

The bound on the tip's velocity, along n and across it, is none of these: it is `contact_speed`, a
limit of the real robot that the tube tightens as any other.

The x_N and the target, the `TrackingTarget`, may be others at every sample; the facets are n alone, or the
sides of a pyramid whose apex may move (`contact.safe_depth`), which is why the x_N may fall where no
plan goes. r_x is such that in F = {‖ξ‖_P ≤ ε} the tip, also half an interval ahead, is at most
r_x‖ξ‖_P beyond the reference along each N (`tube.terminal_set` looks for a ξ where it is not).

*Every problem is feasible.* Let the last plan keep all limits and end within ρ(a), and continue it
by the terminal controller with the same a. F is what `tube.terminal_set` looks for: there the
inputs are within limits at both ends of the next interval, for all forces; so is the state; and
‖ξ‖_P does not grow, so every set ‖ξ‖_P ≤ ρ ≤ ε is invariant, not only F. Hence ‖ξ_{N+1}‖_P ≤
‖ξ_N‖_P ≤ ρ(a), and N·𝔭_{N+1} ≤ N·(E ᵀy_des + a) + r_x‖ξ_{N+1}‖_P ≤ x_N, likewise half an interval
ahead. So it is feasible for this `TrackingTarget`. The target is in no limit: it is feasible for every later
`TrackingTarget` that leaves room for it, as x_N that do not fall do, and a pyramid that takes another's place
by `safe_depth.replaces`: it has all of the old one wherever the last plan goes, at the reference, too. A
fixed set, kept behind the front by its whole reach r_x ε, would be invariant as well, but nothing
could ever press within r_x ε of x_safe; a set that shrinks lets a go up to the front.

*It goes where it is asked to.* Let `TrackingTarget` be constant and a° the best admissible place, the least of
V_o over n·(E ᵀy_des + a) ≤ x_safe. As the continued plan costs less by h‖ξ_0‖²_Q at least, that
sum over all samples is finite, and ξ_0 → 0 (Q > 0): the motion comes to rest at y_des + E a. From
there a can move to a′ = a + λ(a° − a), for λ small and N ≥ 2, by a plan that is at rest at
y_des + E a′ after two intervals: with J_x, the map from two accelerations to (y_2, ζ_2) is
invertible. (The terminal controller would not do: at the front ρ is zero.) On its way n·𝔭 is
½(x_0 + ½hẋ_0 + x_2) at the first knot and, half an interval ahead of that, x_2: behind the front as
start and end are, but for terms of second order in ξ_0, by which a′ stays back. The other limits
have room for it, as they have at rest. It costs C(‖ξ_0‖ + λ‖a° − a‖)² + V_o(a′) at most, and
V_o(a′) ≤ (1 − λ)V_o(a) + λV_o(a°) + O(‖ξ_0‖²), for V_o is convex. A plan that is no worse has

    λ (V_o(a) − V_o(a°)) ≤ C (‖ξ_0‖ + λ‖a° − a‖)² + O(‖ξ_0‖²) → C λ² ‖a° − a‖²,

for every small λ: V_o(a) → V_o(a°). This asks of the solver a plan that is no worse than that one,
which a converged one from there is; for a single convex program per sample the sum is finite and
rest the only place to stay, and that it then finds a° is seen in tests, not proven.

*It turns, too.* Gravity is along the vertical, so motion does not change under a turn ψ of all of
the robot about it either, and ζ, f, u, q and two of the tool's ZYX angles stay as they are. With
`turn`, a ∈ R⁴ has ψ as its last component, E adds it to the tool's yaw, and in the axes of that
reference, T ξ = (R_z(−ψ)ξ_𝔭, ...), the loop is that of y_des: P, controller and decrease are those
of T ξ, for Q weighs both horizontal directions alike. What has a direction in Σ_I does change:
facets, forces of a contact, limits along n. So F is looked at, and r_x is the largest, for five
turns from −`turn` to `turn` (`turned`), and ρ(a) is at most 20 ε (1 − |ψ|/`turn`), too. What
continues a plan leaves ψ as it is, so with an F for all turns all of the above holds. What ψ is
asked to be, within 0.95 `turn`, has a V_o of its own; that J_x turns adds O(λ²) to the way from a
to a′, which Cλ² has.
"""

from copy import copy
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from uvms_drake.common.errors import require, vector
from uvms_drake.control.convex.staged_program import RadiusBound, StagedProgram
from uvms_drake.control.convex.tracking_program import with_place
from uvms_drake.control.costs.offset_cost import OffsetCost
from uvms_drake.control.costs.task_cost import TaskCost
from uvms_drake.control.limits import Limit
from uvms_drake.control.limits.safe_depth import SafeDepth, SafeDepthBetweenKnots
from uvms_drake.control.ocp.dynamic_ocp import DynamicOcp
from uvms_drake.control.ocp.ocp import Evaluation, MpcConfig, PlanPoints
from uvms_drake.control.plan.plan import DynamicPlan
from uvms_drake.control.plan.points import Points
from uvms_drake.control.plan.tracking_plan import TrackingPlan
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.uvms_model import UvmsModel

HEADROOM = 1.05
"""r_x over that of the linearisation at the reference."""
FAR = 1000.0
"""Distance over which model and limits are looked at for being the same everywhere [m]."""
YAW = 5
"""Which component of y is the tool's yaw."""
TURNS = 5
"""For how many turns the terminal set is looked at."""
TURNED_FREELY = 0.95
"""Part of the largest turn up to which nothing of the terminal set is taken for it."""


@dataclass(frozen=True)
class TrackingTarget:
    """What a plan is asked for at one instant."""

    target: np.ndarray
    """Where the end-effector is to be, 𝔭 (3,) in Σ_I [m]."""
    safe_depth: np.ndarray | float = np.inf
    """x_N, largest N·𝔭 of each facet (m,) [m], less what the tube takes; see `TrackingOcp`."""
    turn: float = 0.0
    """By how much the reference is to be turned about the vertical [rad], if it may be."""


class TrackingOcp(DynamicOcp):
    """The FHOCP for every target, at first that of y_des with no front.

    Args:
        model: Kinematics and dynamics, without contact.
        mpc: Horizon and weights.
        y_des: Posture of the reference, anywhere (6+n,).
        limits: Those that are left to the nominal trajectory, by name, the same everywhere; on the
            input, `UnderContact` if there may be any.
        direction: Unit vector n (3,) in Σ_I, into the surface.
        facets: N (m, 3); n alone if None.
        offset: V_o.
        turn: Largest turn of the reference about the vertical [rad]; zero, and there is none.
    """

    strict: ClassVar[bool] = True
    tolerance: ClassVar[float] = 1e-6

    def __init__(self, model: UvmsModel, mpc: MpcConfig, y_des: np.ndarray,
                 limits: dict[str, Limit], direction: np.ndarray, facets: np.ndarray | None = None,
                 offset: OffsetCost | None = None, turn: float = 0.0):
        super().__init__(model, mpc, y_des, limits)
        for key, wanted in (("terminal_weight", mpc.terminal_weight is None),
                            ("terms", not mpc.terms)):
            require(wanted, key, getattr(mpc, key), "left out, where the reference moves")
        require(mpc.input_reference == "equilibrium", "input_reference", mpc.input_reference,
                "equilibrium, where the reference moves")
        require(mpc.terminal_set, "terminal_set", mpc.terminal_set, "true, where the target moves")
        self.direction = vector("direction", direction, 3)
        require(bool(abs(np.linalg.norm(self.direction) - 1.0) < 1e-9), "direction", direction,
                "a unit vector")
        self.facets = self.direction[None] if facets is None else np.asarray(facets, dtype=float)
        self.offset = offset or OffsetCost()
        self.offset.check()
        self.turn = turn
        self._moved = np.array([0, 1, 2, YAW] if turn else [0, 1, 2])
        self._require_the_same_everywhere()
        self._lasting = limits
        self.depth_reach = max([self._reach(), *(other._reach(T) for T, other in self.turned())])
        self.aim = TrackingTarget(y_des[:3])

    def following_lag(self, committed: int = 0) -> float:
        """Returns n·h(1 − Φ)⁻¹n on 𝔭, how late a tip is behind a reference along n [s].

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
        if not self.turn:
            return
        require(0.0 < self.turn < np.pi / 2.0, "turn", self.turn, "from 0 to a right angle")
        require(bool(np.allclose(model.R_WT[2], [0.0, 0.0, 1.0])), "turn", self.turn,
                "zero, where the end-effector's yaw (task.frame) is not about the vertical")
        require(self.Q[0, 0] == self.Q[1, 1], "weight_y", np.diag(self.Q)[:2],
                "the same for both horizontal directions, where the reference turns")
        turned = model.configuration(y + 0.3 * np.eye(len(y))[YAW])
        require(np.allclose(model.drift(turned, zeta), model.drift(config, zeta)), "turn",
                self.turn, "zero, where the drift changes with the heading")

    def _axes(self, turn: float) -> np.ndarray:
        """Returns T of a reference that is turned [rad]."""
        T = np.eye(self.state_size)
        T[:3, :3] = rotation_matrix(np.array([0.0, 0.0, -turn]))
        return T

    def turned(self) -> tuple[tuple[np.ndarray, Self], ...]:
        """Returns the problems of some turns of the reference."""
        out = []
        for turn in np.linspace(-self.turn, self.turn, TURNS) if self.turn else ():
            other = copy(self)
            other.turn, other.y_des = 0.0, self.y_des + turn * np.eye(self.model.size)[YAW]
            other.task_cost = replace(self.task_cost, y_des=other.y_des)
            out.append((self._axes(turn), other))
        return tuple(out)

    def terminal_axes(self, plan: DynamicPlan) -> np.ndarray:
        """Returns T."""
        assert isinstance(plan, TrackingPlan)
        return self._axes(plan.a[3] if self.turn else 0.0)

    def _reach(self, axes: np.ndarray | None = None) -> float:
        """Returns r_x [m], with the T of a turned problem."""
        T = np.eye(self.state_size) if axes is None else axes
        size = self.model.size
        J_x = self.model.task_jacobian(self.model.configuration(self.y_des))
        here = np.pad(self.facets, ((0, 0), (0, 2 * size - 3)))
        between = here + 0.5 * self.time_step * np.pad(self.facets @ J_x[:3], ((0, 0), (size, 0)))
        inverse = T.T @ np.linalg.inv(self.terminal.P) @ T
        return HEADROOM * max(float(np.sqrt(np.max(np.sum(each @ inverse * each, axis=1))))
                              for each in (here, between))

    @property
    def inputs_given(self) -> dict[str, int]:
        """Sizes of the parts of an `TrackingTarget`, by the names of ports."""
        turn = {"turn": 1} if self.turn else {}
        return {"target": 3, "safe_depth": len(self.facets), **turn}

    @property
    def reach_names(self) -> tuple[str, ...]:
        """Those of `SafeDepth` and `SafeDepthBetweenKnots`."""
        count = len(self.facets)
        parts = [""] if count == 1 else [f"[{i}]" for i in range(count)]
        return tuple(f"{name}{part}" for name in ("safe_depth", "safe_depth_between_knots") for part in parts)

    def aimed(self, aim: TrackingTarget) -> Self:
        """Returns the problem of another aim; it shares all that does not depend on it."""
        out = copy(self)
        out.aim = aim
        depths = np.broadcast_to(np.asarray(aim.safe_depth, dtype=float), (len(self.facets),))
        out.limits = {
            **self._lasting, "safe_depth": SafeDepth(self.facets, depths),
            "safe_depth_between_knots": SafeDepthBetweenKnots(self.facets, depths, self.time_step)}
        return out

    def given(self, values: dict[str, np.ndarray]) -> Self:
        """Returns the problem of what is asked for: target, safe depth and turn."""
        (turn,) = values.get("turn", np.array([self.aim.turn]))
        return self.aimed(TrackingTarget(values.get("target", self.aim.target),
                              values.get("safe_depth", np.inf), turn))

    @property
    def lasting_limits(self) -> dict[str, Limit]:
        """All but those of the front."""
        return self._lasting

    def reached(self, at: Points) -> tuple[np.ndarray, np.ndarray]:
        """Returns how deep the tip is, here and half an interval ahead, and r_x of each."""
        here, nowhere = self.facets @ self.y_des[:3], np.full(len(self.facets), np.inf)
        depth = SafeDepth(self.facets, nowhere).values(at) - here
        between = SafeDepthBetweenKnots(self.facets, nowhere, self.time_step).values(at) - here
        return (np.concatenate([depth, between], axis=-1),
                np.full(2 * len(here), self.depth_reach))

    def resting_plan(self, time: float, state: np.ndarray, coasting: int = 0) -> TrackingPlan:
        """Returns a first guess: coast, then come to rest, with the reference there."""
        plan = super().resting_plan(time, state, coasting)
        a, most = self._error(plan.config[-1])[self._moved], TURNED_FREELY * self.turn
        a[3:] = np.clip(a[3:], -most, most)
        return TrackingPlan(**vars(plan), a=a)

    def reference(self, plan: DynamicPlan) -> np.ndarray:
        """Returns y_des + E a (6+n,)."""
        assert isinstance(plan, TrackingPlan)
        out = self.y_des.copy()
        out[self._moved] += plan.a
        return out

    def errors(self, plan: DynamicPlan, y: np.ndarray) -> np.ndarray:
        """Returns ξ = (y − y_des − E a, ζ) at the knots (N+1, 2(6+n))."""
        return np.concatenate([y - self.reference(plan), plan.zeta], axis=1)

    def terminal_radius(self, plan: DynamicPlan) -> float:
        """Returns ρ(a)."""
        return float(np.min(self._radius_bound(plan).size, initial=self.terminal.radius))

    def _radius_bound(self, plan: DynamicPlan) -> RadiusBound:
        """Returns what bounds ρ(a), but for ε, and how it changes with a: fronts, and turns."""
        assert isinstance(plan, TrackingPlan)
        sizes = (self.aim.safe_depth - self.facets @ self.reference(plan)[:3]) / self.depth_reach
        rows = np.pad(-self.facets / self.depth_reach, ((0, 0), (0, len(self._moved) - 3)))
        if self.turn:
            per = self.terminal.radius / ((1.0 - TURNED_FREELY) * self.turn)
            turns = per * np.array([[0.0, 0.0, 0.0, -1.0], [0.0, 0.0, 0.0, 1.0]])
            sizes = np.append(sizes, per * self.turn + turns @ plan.a)
            rows = np.concatenate([rows, turns])
        there = np.isfinite(sizes)
        return RadiusBound(sizes[there], rows[there])

    def _stage_cost(self, plan: DynamicPlan) -> TaskCost:
        return replace(self.task_cost, y_des=self.reference(plan))

    def _missing(self, plan: DynamicPlan) -> np.ndarray:
        """Returns E ᵀy_des + a − target (3,) [m]."""
        return self.reference(plan)[:3] - self.aim.target

    def _unturned(self, plan: DynamicPlan) -> np.ndarray:
        """Returns ψ less what is asked for (1,) [rad]; (0,) if it does not turn."""
        assert isinstance(plan, TrackingPlan)
        most = TURNED_FREELY * self.turn
        return plan.a[3:] - np.clip(self.aim.turn, -most, most)

    def evaluate(self, plan: DynamicPlan, points: PlanPoints | None = None) -> Evaluation:
        """Returns the objective, V_o in it, and the violations of a plan."""
        value = super().evaluate(plan, points)
        missing, turn = self._missing(plan), self._unturned(plan)
        return replace(value, cost=(
            value.cost + self.offset.value(missing) + self.offset.value(turn)))

    def staged_program(self, plan: DynamicPlan) -> StagedProgram:
        """Returns the convex program about a plan; its w are the changes of a and of ζ̄̇."""
        program, radius_bound = super().staged_program(plan), self._radius_bound(plan)
        program = replace(program, terminal=program.terminal._replace(radius=self.terminal.radius))
        radius_bound = radius_bound._replace(rows=np.pad(radius_bound.rows, ((0, 0), (self.state_size, 0))))
        H, g = np.zeros((len(self._moved), len(self._moved))), np.zeros(len(self._moved))
        H[:3, :3], g[:3] = self.offset.quadratic(self._missing(plan))
        H[3:, 3:], g[3:] = self.offset.quadratic(self._unturned(plan))
        program = with_place(program, self._moved, H, g, radius_bound if len(radius_bound.size) else None)
        return self._with_turning_end(program, plan) if self.turn else program

    def _with_turning_end(self, program: StagedProgram, plan: DynamicPlan) -> StagedProgram:
        """Returns the program with what T ξ_N changes as T turns, too."""
        assert isinstance(plan, TrackingPlan)
        xi = self.errors(plan, self.unwrapped(self.model.task_pose(plan.config)))[-1]
        across = np.cross([0.0, 0.0, -1.0], (self._axes(plan.a[3]) @ xi)[:3])  # ∂(R_z(−ψ) ξ_𝔭)/∂ψ
        end = program.terminal
        T = end.T.copy()
        T[:, -1] = self.terminal.root[:, :3] @ across
        return replace(program, H_end=2.0 * T.T @ T, g_end=2.0 * T.T @ end.value,
                       terminal=end._replace(T=T))

    def revalued(self, program: StagedProgram, plan: DynamicPlan, points: PlanPoints
                 ) -> StagedProgram:
        """Returns a program with its own slopes, and what is limited and room at another plan."""
        out, radius_bound = super().revalued(program, plan, points), program.terminal.radius_bound
        return replace(out, terminal=out.terminal._replace(
            radius_bound=radius_bound and radius_bound._replace(size=self._radius_bound(plan).size)))
