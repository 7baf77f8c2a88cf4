"""Effect of thrusters that lag on the vehicle's rows of `tip first`, with a proof.

The joints go by the present wrench of the thrusters, τ_v, so that the tip's rows are those without
any lag, and the vehicle's obey, with d' = d + M⁻¹J_Eᵀ(F̂ − F), A as in `row_loop` and τ_c that
of the law,

    η̈ = ÿ̄_η + w_η + A(τ_v − τ_c) + (J_y d')_η,    A = J_ηv M*⁻¹,                               (1)
    Aτ_c = w_η + A(τ_J + τ_w + τ_φ + J_Evᵀ F̂),    τ_J = (MJ_y⁻¹J̄_yζ̄̇)_v,
    τ_w = M_vqJ_sq⁻¹w_s,    τ_φ = (MJ_y⁻¹(J̄̇_yζ̄ − J̇_yζ) + b)_v.                                (2)

τ_v is a mean of past commands over ages of a hold h, a dead time D and a lag T. Each part of
A(τ_v − τ_c) is bounded by its level or its rate, and by the norms K of the blocks of ȦA⁻¹. The
parts off the plan follow from errors, and errors from them: bounds R are found to first order,
enlarged, and checked. All suprema are estimates. Proof:
tube/actuation/theory.md#vehicle-wrench-with-a-first-order-lag.
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
from uvms_drake.tube.actuation.remainder_bound import remainder_bound, second_search_of
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.law_tube import Basis
from uvms_drake.tube.loops.row_loop import ACCELERATION, RATE, E, RowLoop, W
from uvms_drake.tube.loops.sampled_loop import exponential
from uvms_drake.tube.rows.disturbance_gains import (
    ATTITUDE,
    JOINTS,
    VEHICLE,
    DisturbanceInputs,
    Parts,
)
from uvms_drake.tube.search.ascent import first_order, supremum
from uvms_drake.tube.search.estimate import Check, together
from uvms_drake.tube.search.search_problem import Part

PLAN, ARM, OFF, TURNING, CONTACT = (
    "delayed plan", "delayed arm", "delayed feedforward off the plan", "rotation within the delay",
    "delayed contact")
"""Sources of the vehicle's errors by thrusters that lag."""
BLOCKS = (VEHICLE, ATTITUDE)
HALVES = slice(0, 3), slice(3, 6)
ENLARGED = 1.25
"""Factor of R to first order, which covers the excess of another search."""


class LaggedWrenchTube:
    """Sources of a lagging wrench, and the table of blocks with them.

    Args:
        basis: The data.
        rows: The tip's task in (χ, q) (n,).
        vehicle: The loop of the vehicle's rows, with the lag.
        tip: That of the tip's, without.
        table: Parts of the blocks without these sources, by block and by source.
        slower: Speed limits of plans, ‖ν̄₁‖, ‖ν̄₂‖ and ‖q̄̇‖ (3,).
        inputs: Disturbance inputs, of the contact's force.
    """

    table: dict[str, Parts]
    """All parts; those of the lag are infinite if no R was found."""
    condition: Condition
    """Condition that the feedforward of errors is within its bound."""
    extra_input: np.ndarray | float
    """Addition to the tube in u and τ: the joints go by the present wrench."""
    check: Check
    """Makes the second searches."""

    def __init__(self, basis: Basis, rows: np.ndarray, vehicle: RowLoop, tip: RowLoop,
                 table: Mapping[str, Parts], slower: np.ndarray, inputs: DisturbanceInputs):
        contact, path, n = basis.contact, basis.command_path, basis.model.num_joints
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

        # Feedforward of plans, rate of A, and maps of arm and readings to the vehicle.
        plan = self._claim(
            checks, "delayed forces of plans", planned_feedforward, [np.eye(1)], 3, 6)
        self._level, self._level_rate, self._smooth = plan.reshape(3, 2)
        K = self._claim(checks, "‖ȦA⁻¹‖", turning_map, [eye6[:, half] for half in HALVES], 3, 2,
                        within=False)
        maps = self._claim(checks, "‖A M_vq‖ and ‖A J_Evᵀ‖", arm_and_wrench, [
            eye[:, :n], eye[:, n: n + 3], eye[:, n + 3:]], 3, 2, within=False)
        turns = self._claim(checks, "‖A J̇_Evᵀ‖", turning_reading,
                            [eye6[:, half] for half in HALVES], 3, 2, within=False)
        joints = self._claim(checks, "u and τ of joints that hold the tip", joints_for_vehicle,
                             [eye6[:, half] for half in HALVES], 1, 2 * basis.model.size,
                             within=False)

        # Means over the ages of the acting command, and gains to e, ė, w and ë.
        hold, age = path.vehicle_period, path.vehicle_age
        self._turned, self._turned_rate = means_over_ages(K, age - path.lag, path.lag)
        self._K, self._hold = K, hold

        gains = vehicle.gains
        at_once = {"disturbance": 1.0, "feed_forward": 2.0, "feed_forward_rate": age}
        self._gains = {name: np.array([*gains[name], gains[name].command + most])
                       for name, most in at_once.items()}

        # The tip's feedback on the vehicle, and the delayed contact.
        before = np.sum(list(table[JOINTS].values()), axis=0)
        self._tip_w = float(before[W])
        self._tip_w_rate = float((tip.k + tip.sigma) * before[ACCELERATION]
                                 + tip.k * tip.sigma * before[RATE])
        self._by_arm, by_force, by_torque = maps.T
        force_turning, torque_turning = turns.T
        rate = contact.rate + contact.tangential_rate + inputs.turning * contact.size
        moved = rate * (age + contact.period)
        twice = contact.error + contact.ripple + contact.tangential_ripple
        once, squared = moments_of_ages(K, age - path.lag, path.lag)
        self._contact = (by_force * (min(moved, 2.0 * contact.size) + 2.0 * twice)
                         + 2.0 * by_torque * contact.torque_error
                         + rate * (squared + contact.period * once) @ force_turning
                         + 2.0 * once @ (
                             twice * force_turning + contact.torque_error * torque_turning))

        # The feedforward off the plan, by a fixed point with the errors.
        found, ratio = remainder_bound(
            self._problem, self._radii, 12, ENLARGED, basis.settings, 5)
        if ratio <= 1.0:
            checks.append(second_search_of(
                self._problem(self._radii(found)), "delayed feedforward by errors", found,
                basis.settings.seed, 6))
        self.table = self._table(found)
        self.condition = Condition(
            "thrusters that lag, feedforward by errors over its bound", ratio, "<=", 1.0,
            theorem="tube/actuation/theory.md#vehicle-wrench-with-a-first-order-lag")
        self.extra_input = joints @ self._wrench_error(found)
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
            checks.append(second_search_of(problem, name, claim, settings.seed, 6))
            out.append(claim)
        return np.column_stack(out)

    def _table(self, remainder: np.ndarray) -> dict[str, Parts]:
        """Returns the table with R (6,) in the vehicle's blocks, and zeros in the tip's."""
        sources = self._sources(remainder)
        return {name: parts | {source: each[BLOCKS.index(name)] if name in BLOCKS else np.zeros(4)
                               for source, each in sources.items()}
                for name, parts in self._known.items()}

    def _sources(self, remainder: np.ndarray) -> dict[str, np.ndarray]:
        """Returns bounds of e, ė, w and ë by source (2, 4)."""
        K, turned, more, hold = self._K, self._turned, self._turned_rate, self._hold
        level_off, rate_off, smooth_off = remainder.reshape(3, 2)
        arm, arm_rate = self._by_arm * self._tip_w, self._by_arm * self._tip_w_rate

        def by(name: str, sizes: np.ndarray) -> np.ndarray:
            return sizes[:, None] * self._gains[name]

        def of(level: np.ndarray, rate: np.ndarray) -> np.ndarray:
            """Returns the bounds by a level with a bounded rate between ticks."""
            return by("feed_forward", level) + by(
                "disturbance", turned @ level + hold * (rate + K @ level))

        def of_rate(rate: np.ndarray) -> np.ndarray:
            return by("feed_forward_rate", rate) + by("disturbance", more @ rate)

        out = {PLAN: of(self._level, self._level_rate) + of_rate(self._smooth),
               ARM: of(arm, arm_rate), OFF: of(level_off, rate_off) + of_rate(smooth_off),
               CONTACT: by("disturbance", self._contact)}
        # The feedback within the rotation: w is an effect of it, too.
        w = sum(part[:, W] for part in out.values()) + np.array([
            sum(part[W] for part in self._known[name].values()) for name in BLOCKS])
        back = np.eye(2) - self._gains["disturbance"][W] * turned
        bounded = np.isfinite(back).all() and np.all(np.linalg.inv(back) >= 0.0)
        w = np.linalg.solve(back, w) if bounded else np.full(2, np.inf)
        return out | {TURNING: by("disturbance", turned @ w)}

    def _wrench_error(self, remainder: np.ndarray) -> np.ndarray:
        """Returns a bound of A(τ_v − τ_c) by block (2,)."""
        table = self._table(remainder)
        w = np.array([sum(part[W] for part in table[name].values()) for name in BLOCKS])
        level_off, _, smooth_off = remainder.reshape(3, 2)
        level = w + self._level + level_off + self._by_arm * self._tip_w
        rate = self._smooth + smooth_off
        out: np.ndarray = (2.0 * level + self._turned @ level + self._path.vehicle_age * rate
                           + self._turned_rate @ rate + self._contact)
        return out

    def _radii(self, remainder: np.ndarray) -> np.ndarray:
        """Returns the radii of the errors of `LaggedWrenchProblem` by part (12,)."""
        table = self._table(remainder)
        sums = np.array([np.sum(list(table[name].values()), axis=0)
                         for name in (*BLOCKS, JOINTS)])
        return np.array([*sums[:, [E, RATE, ACCELERATION]].T.ravel(), self._tip_w, *self._reading])

    def _problem(self, radii: np.ndarray) -> LaggedWrenchProblem:
        size = self._basis.model.size
        eye, blocks = np.eye(4 * size), np.split(np.arange(size), [3, 6])
        columns = [eye[:, block + i * size] for i in range(3) for block in blocks]
        columns += [eye[:, 3 * size: -6], eye[:, -6:-3], eye[:, -3:]]
        parts: list[Part] = list(zip(columns, map(float, radii), strict=True))
        return LaggedWrenchProblem(self._basis.model, self._planned, parts, self._rows,
                                   self._basis.u_limit, self._rate)


def means_over_ages(K: np.ndarray, hold_age: float, lag: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns bounds of the means of e^{Ka} − 1 and of ∫₀ᵃe^{Ku}du − a, inf if there are none.

    Args:
        K: Norms of blocks of ȦA⁻¹ (b, b) [1/s].
        hold_age: h + D, largest age without the lag's [s].
        lag: T [s].
    """
    size, age = len(K), hold_age + lag
    if not np.max(np.abs(np.linalg.eigvals(K))) * lag < 1.0:
        return np.full((size, size), np.inf), np.full((size, size), np.inf)
    lagged = np.linalg.inv(np.eye(size) - K * lag)
    after_hold = exponential(K * hold_age)
    integral = exponential(hold_age * np.block(
        [[K, np.eye(size)], [np.zeros((size, 2 * size))]]))[:size, size:]
    return (after_hold @ lagged - np.eye(size),
            integral + lag * after_hold @ lagged - age * np.eye(size))


def moments_of_ages(K: np.ndarray, hold_age: float, lag: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns bounds of the means of a e^{Ka} and of a²e^{Ka}; the arguments are as above."""
    eye = np.eye(len(K))
    if not np.max(np.abs(np.linalg.eigvals(K))) * lag < 1.0:
        return np.full(K.shape, np.inf), np.full(K.shape, np.inf)
    L, after_hold = np.linalg.inv(eye - K * lag), exponential(K * hold_age)
    return (after_hold @ L @ (hold_age * eye + lag * L),
            after_hold @ L @ (hold_age**2 * eye + 2.0 * hold_age * lag * L + 2.0 * lag**2 * L @ L))
