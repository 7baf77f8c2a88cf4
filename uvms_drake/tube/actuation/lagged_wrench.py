"""What thrusters that lag make of the vehicle's rows of `tip first`, with a proof.

The joints go by what the thrusters give now, τ_v, so that the tip's rows are what they are without
any lag (`control.laws.tip_first`), and the vehicle's obey

    η̈ = ÿ̄_η + w_η + A(τ_v − τ_c) + (J_y d')_η,    A = J_ηv M*⁻¹,                                (1)

d' = d + M⁻¹J_Eᵀ(F̂ − F), τ_c what (L) asks the vehicle for, A as in `row_loop`. Both are exact where
J_sq and J_g are regular, the arm's Jacobian with the vehicle held and with it free. The
thrusters sample τ_c at ticks, hold it, and follow behind a dead time D and a lag T. So τ_v is a
mean of what was commanded, τ_v(t) = ∫p(a)τ_c(t − a)da, over ages a of at most h + D, beside one
that is distributed by e^{−a/T}/T; before the start it is what holds the robot at rest. With (L),

    Aτ_c = w_η + A(τ_J + τ_w + τ_φ + J_Evᵀ F̂),    τ_J = (MJ_y⁻¹J̄_yζ̄̇)_v,
    τ_w = M_vqJ_sq⁻¹w_s,    τ_φ = (MJ_y⁻¹(J̄̇_yζ̄ − J̇_yζ) + b)_v.                                 (2)

τ_J jumps at knots, which are ticks; τ_w goes with the tip's feedback; τ_φ is as smooth as ζ. Age by
age A(t)(τ_c(t − a) − τ_c(t)) is of these parts, and each is bounded in the way that suits it:

- *w_η* by the loop itself: (G − 1)w_η is in `RowLoop`.
- *a level*, x = Aτ of τ_J or τ_w: A(t)(τ(r) − τ(t)) = x(r) − x(t) + (A(t)A(r)⁻¹ − 1)x(r). Of the
  first two all but h|ẋ| changes at ticks only, `feed_forward`. |ẋ| ≤ |Aτ̇| + K|x|.
- *a rate*, ρ = A(τ̇_φ + J̇_EvᵀF̂): −∫ᵣᵗ ρ + (A(t)A(r')⁻¹ − 1)ρ dr', of which the first is (G − 1) of
  the integral of ρ, `feed_forward_rate`.
- *the reading*, A(t)J_Ev(t)ᵀ(F̂(r) − F̂(t)) − ∫ᵣᵗ A(t)J̇_Evᵀ(F̂(r) − F̂(r')) dr': the force and the
  tip's axes change by their rates, and of ripples and errors there are two.

*What turns meanwhile.* ‖A(t)A(r)⁻¹ − 1‖ ≤ e^{K(t − r)} − 1 elementwise, for the norms K of the
blocks of ȦA⁻¹, position and attitude. The means over ages of that, and of ∫₀ᵃe^{Ku}du, are at most

    e^{K(h + D)}(1 − KT)⁻¹ − 1,    ∫₀^{h + D}e^{Ku}du + e^{K(h + D)}T(1 − KT)⁻¹,

if the spectral radius of KT is below 1. ∎

*Errors make more of it.* On the plan there are τ̄_J and τ̄_φ; what is off them, and how fast it
varies, follows from errors (x, ẋ, ẍ) of all rows, w_s and F̂. Those of the tip are known; those of
the vehicle follow from what it makes of them. As in `held_rows` bounds R are found to first order,
enlarged, and checked: if the errors that follow from R make no more than R, then R was right.

All suprema are estimates: searched, multiplied by the declared factor, and searched for again.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from uvms_drake.tube.actuation.lagged_wrench_feedforward import (
    LaggedWrenchProblem,
    PostureMap,
    arm_and_wrench,
    joints_for_vehicle,
    planned_feedforward,
    turning_map,
    turning_reading,
)
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.law_tube import Basis
from uvms_drake.tube.loops.row_loop import RowLoop
from uvms_drake.tube.loops.sampled_loop import exponential
from uvms_drake.tube.rows.disturbance_gains import (
    ATTITUDE,
    JOINTS,
    VEHICLE,
    DisturbanceInputs,
    Parts,
)
from uvms_drake.tube.search.ascent import by_part, first_order, supremum
from uvms_drake.tube.search.estimate import Check, largest_of, together
from uvms_drake.tube.search.search_problem import Part, SearchProblem
from uvms_drake.tube.search.second_search import second_search

PLAN, ARM, OFF, TURNING, CONTACT = (
    "the plan, late", "the arm, late", "off the plan, late", "what turns meanwhile",
    "the contact, late")
"""Sources of the vehicle's errors by thrusters that lag."""
BLOCKS = (VEHICLE, ATTITUDE)
HALVES = slice(0, 3), slice(3, 6)
ENLARGED, TRIES, ROUNDS = 1.25, 4, 300
"""Factor of R to first order, how often it is enlarged by what was found, and rounds in which it
converges to first order, or does not. The factor is as large as another search finds more."""


class LaggedWrenchTube:
    """The sources, and the table of blocks with them.

    Args:
        basis: The data.
        rows: The tip's task in (χ, q) (n,).
        vehicle: The loop of the vehicle's rows, with the lag.
        tip: That of the tip's, without.
        table: Parts of the blocks without these sources, by block and by source.
        slower: What a plan may do at most, ‖ν̄₁‖, ‖ν̄₂‖ and ‖q̄̇‖ (3,).
        inputs: Of the contact's force.
    """

    table: dict[str, Parts]
    """All parts; those of what is late are infinite if no R was found."""
    condition: Condition
    """That errors do not make more than was counted with."""
    beside: np.ndarray | float
    """What is to be added to the tube in u and τ: the joints go by what the thrusters give."""
    check: Check
    """Makes the second searches."""

    def __init__(self, basis: Basis, rows: np.ndarray, vehicle: RowLoop, tip: RowLoop,
                 table: Mapping[str, Parts], slower: np.ndarray, inputs: DisturbanceInputs):
        contact, path, n = basis.contact, basis.actuators.vehicle, basis.model.num_joints
        assert contact is not None
        self._basis, self._rows, self._known = basis, rows, dict(table)
        self._path, self._factor = path, basis.settings.safety_factor
        self._reading = contact.size + contact.error, contact.torque_error
        self._planned = replace(basis.declared, nu1=float(slower[0]), nu2=float(slower[1]),
                                qdot=float(slower[2]))
        self._rate = np.minimum(basis.largest_rate, 2.0 / basis.time_step * np.repeat(
            slower, [3, 3, n]))
        checks: list[Check] = []
        eye6, eye = np.eye(6), np.eye(n + 6)

        # What a plan carries, how A turns, and what arm, readings and lag make of vehicle and arm.
        plan = self._claim(checks, "forces of plans, late", planned_feedforward, [np.eye(1)], 3, 6)
        self._level, self._level_rate, self._smooth = plan[:, 0].reshape(3, 2)
        K = self._claim(checks, "‖ȦA⁻¹‖", turning_map, [eye6[:, half] for half in HALVES], 3, 2,
                        within=False)
        maps = self._claim(checks, "‖A M_vq‖ and ‖A J_Evᵀ‖", arm_and_wrench, [
            eye[:, :n], eye[:, n: n + 3], eye[:, n + 3:]], 3, 2, within=False)
        turns = self._claim(checks, "‖A J̇_Evᵀ‖", turning_reading,
                            [eye6[:, half] for half in HALVES], 3, 2, within=False)
        joints = self._claim(checks, "u and τ of joints that hold the tip", joints_for_vehicle,
                             [eye6[:, half] for half in HALVES], 1, 2 * basis.model.size,
                             within=False)

        hold, age = path.period, path.age
        self._turned, self._turned_rate = means_over_ages(K, age - path.lag, path.lag)
        self._K, self._hold = K, hold

        gains = vehicle.gains
        at_once = {"disturbance": 1.0, "feed_forward": 2.0, "feed_forward_rate": age}
        self._gains = {name: np.array([*gains[name], gains[name].command + most])
                       for name, most in at_once.items()}
        before = np.sum(list(table[JOINTS].values()), axis=0)
        self._tip_w = float(before[2])
        self._tip_w_rate = float((tip.k + tip.sigma) * before[3] + tip.k * tip.sigma * before[1])
        self._by_arm = maps[:, 0]
        rate = contact.rate + contact.tangential_rate + inputs.turning * contact.size
        moved = rate * (age + contact.period)
        twice = contact.error + contact.ripple + contact.tangential_ripple
        once, squared = moments_of_ages(K, age - path.lag, path.lag)
        self._contact = (maps[:, 1] * (min(moved, 2.0 * contact.size) + 2.0 * twice)
                         + 2.0 * maps[:, 2] * contact.torque_error
                         + rate * (squared + contact.period * once) @ turns[:, 0]
                         + 2.0 * once @ (
                             twice * turns[:, 0] + contact.torque_error * turns[:, 1]))

        found, ratio = self._fixed_point(checks)
        self.table = self._table(found)
        self.condition = Condition(
            "thrusters that lag, what errors make of loads over what is counted with", ratio,
            "<=", 1.0, theorem="tube/actuation/theory.md#vehicle-wrench-with-a-first-order-lag")
        self.beside = joints @ self._late(found)
        self.check = together(*checks)

    def _claim(self, checks: list[Check], name: str, of: Callable, columns: list[np.ndarray],
               each: int, count: int, within: bool = True) -> np.ndarray:
        """Returns claims for norms of blocks of a matrix (count, columns)."""
        basis, settings = self._basis, self._basis.settings
        out = []
        for part in columns:
            problem = PostureMap(
                basis.model, self._planned if within else basis.declared, [(part, 1.0)],
                self._rows, basis.u_limit, self._rate, of=of, each=each, count=count)
            x = problem.draw(settings.tube_samples, np.random.default_rng([settings.seed, 4]))
            claim = self._factor * supremum(problem, x, first_order(problem, x))
            checks.append(_check(problem, name, claim, settings.seed))
            out.append(claim)
        return np.column_stack(out)

    def _table(self, rest: np.ndarray) -> dict[str, Parts]:
        """Returns the table with R (6,) in the vehicle's blocks, and nothing in the tip's."""
        sources = self._sources(rest)
        return {name: parts | {source: each[BLOCKS.index(name)] if name in BLOCKS else np.zeros(4)
                               for source, each in sources.items()}
                for name, parts in self._known.items()}

    def _sources(self, rest: np.ndarray) -> dict[str, np.ndarray]:
        """Returns bounds of e, ė, w and ë by source (2, 4)."""
        K, turned, more, hold = self._K, self._turned, self._turned_rate, self._hold
        level_off, rate_off, smooth_off = rest.reshape(3, 2)
        arm, arm_rate = self._by_arm * self._tip_w, self._by_arm * self._tip_w_rate

        def by(name: str, sizes: np.ndarray) -> np.ndarray:
            return sizes[:, None] * self._gains[name]

        def of(level: np.ndarray, rate: np.ndarray) -> np.ndarray:
            """Returns the bounds by a level that varies at no more than a rate between ticks."""
            return by("feed_forward", level) + by(
                "disturbance", turned @ level + hold * (rate + K @ level))

        def of_rate(rate: np.ndarray) -> np.ndarray:
            return by("feed_forward_rate", rate) + by("disturbance", more @ rate)

        out = {PLAN: of(self._level, self._level_rate) + of_rate(self._smooth),
               ARM: of(arm, arm_rate), OFF: of(level_off, rate_off) + of_rate(smooth_off),
               CONTACT: by("disturbance", self._contact)}
        # The feedback that turns: w is what it makes, too.
        w = sum(part[:, 2] for part in out.values()) + np.array([
            sum(part[2] for part in self._known[name].values()) for name in BLOCKS])
        back = np.eye(2) - self._gains["disturbance"][2] * turned
        bounded = np.isfinite(back).all() and np.all(np.linalg.inv(back) >= 0.0)
        w = np.linalg.solve(back, w) if bounded else np.full(2, np.inf)
        return out | {TURNING: by("disturbance", turned @ w)}

    def _late(self, rest: np.ndarray) -> np.ndarray:
        """Returns a bound of A(τ_v − τ_c) by block (2,)."""
        table = self._table(rest)
        w = np.array([sum(part[2] for part in table[name].values()) for name in BLOCKS])
        level_off, _, smooth_off = rest.reshape(3, 2)
        level = w + self._level + level_off + self._by_arm * self._tip_w
        rate = self._smooth + smooth_off
        out: np.ndarray = (2.0 * level + self._turned @ level + self._path.age * rate
                           + self._turned_rate @ rate + self._contact)
        return out

    def _radii(self, rest: np.ndarray) -> np.ndarray:
        """Returns the radii of the errors of `LaggedWrenchProblem` by part (12,)."""
        table = self._table(rest)
        sums = np.array([np.sum(list(table[name].values()), axis=0)
                         for name in (*BLOCKS, JOINTS)])
        return np.array([*sums[:, [0, 1, 3]].T.ravel(), self._tip_w, *self._reading])

    def _problem(self, radii: np.ndarray) -> LaggedWrenchProblem:
        size = self._basis.model.size
        eye, blocks = np.eye(4 * size), np.split(np.arange(size), [3, 6])
        columns = [eye[:, block + i * size] for i in range(3) for block in blocks]
        columns += [eye[:, 3 * size: -6], eye[:, -6:-3], eye[:, -3:]]
        parts: list[Part] = list(zip(columns, map(float, radii), strict=True))
        return LaggedWrenchProblem(self._basis.model, self._planned, parts, self._rows,
                             self._basis.u_limit, self._rate)

    def _fixed_point(self, checks: list[Check]) -> tuple[np.ndarray, float]:
        """Returns R (6,), and how much of it is found of errors within its bounds."""
        settings = self._basis.settings
        problem = self._problem(np.ones(12))
        x = problem.draw(settings.tube_samples, np.random.default_rng([settings.seed, 5]))
        slopes = by_part(problem, x)
        more, rest, ratio = np.full(6, self._factor * ENLARGED), np.full(6, np.inf), np.inf
        for _ in range(TRIES):
            rest = self._first_order(slopes, more)
            if not np.isfinite(rest).all():
                break
            radii = self._radii(rest)
            problem = self._problem(radii)
            claim = self._factor * supremum(problem, x, slopes @ radii)
            ratio = float(np.max(claim / rest))
            if ratio <= 1.0:
                checks.append(_check(problem, "what errors make of late loads", rest,
                                     settings.seed))
                return rest, ratio
            more = more * ENLARGED * np.maximum(claim / rest, 1.0)
        return rest, np.inf

    def _first_order(self, slopes: np.ndarray, more: np.ndarray) -> np.ndarray:
        """Returns the least R (6,) by slopes (m, 6, parts) at samples; inf if there is none."""
        rest = np.zeros(6)
        for _ in range(ROUNDS):
            last, rest = rest, more * np.max(slopes @ self._radii(rest), axis=0)
            if np.all(rest <= 1.001 * last):
                return rest
            if not np.max(rest) < 1e6:
                break
        return np.full(6, np.inf)


def means_over_ages(K: np.ndarray, held: float, lag: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns bounds of the means of e^{Ka} − 1 and of ∫₀ᵃe^{Ku}du − a, inf if there are none.

    Args:
        K: Norms of blocks of ȦA⁻¹ (b, b) [1/s].
        held: h + D, largest age but for the lag's [s].
        lag: T [s].
    """
    size, age = len(K), held + lag
    if not np.max(np.abs(np.linalg.eigvals(K))) * lag < 1.0:
        return np.full((size, size), np.inf), np.full((size, size), np.inf)
    lagged = np.linalg.inv(np.eye(size) - K * lag)
    late = exponential(K * held)
    integral = exponential(held * np.block(
        [[K, np.eye(size)], [np.zeros((size, 2 * size))]]))[:size, size:]
    return late @ lagged - np.eye(size), integral + lag * late @ lagged - age * np.eye(size)


def moments_of_ages(K: np.ndarray, held: float, lag: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns bounds of the means of a e^{Ka} and of a²e^{Ka}; the arguments are as above."""
    eye = np.eye(len(K))
    if not np.max(np.abs(np.linalg.eigvals(K))) * lag < 1.0:
        return np.full(K.shape, np.inf), np.full(K.shape, np.inf)
    L, late = np.linalg.inv(eye - K * lag), exponential(K * held)
    return (late @ L @ (held * eye + lag * L),
            late @ L @ (held**2 * eye + 2.0 * held * lag * L + 2.0 * lag**2 * L @ L))


def _check(problem: SearchProblem, name: str, claim: np.ndarray, seed: int) -> Check:
    """Returns the second search for claims (c,)."""
    wanted = np.flatnonzero(claim > 0.0)
    return lambda: (largest_of(name, claim[wanted], second_search(
        problem, wanted, np.random.default_rng([seed, 6]))),)
