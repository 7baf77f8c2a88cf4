"""Effect of delayed actuators on the blocks of `tip first`: thrusters, or a zero-order hold.

See tube/theory.md#tube-of-the-law-tip-first and
tube/actuation/theory.md#error-budget-under-thrusters.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, astuple, replace

import numpy as np

from uvms_drake.control.laws.tip_first import TipFirst
from uvms_drake.tube.actuation.thruster_budget import Errors, ThrusterBudget, least_bounds
from uvms_drake.tube.actuation.thruster_feedforward import (
    ATTITUDE_ROWS,
    TASK_ROWS,
    TIP_ROWS,
    VEHICLE_ROWS,
    Plans,
    thruster_feedforward,
)
from uvms_drake.tube.actuation.zoh_command import ZohCommandTube
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.law_tube import Basis
from uvms_drake.tube.loops.actuator_path import Actuators, Path
from uvms_drake.tube.loops.row_loop import ACCELERATION, RATE, E, RowLoop, W
from uvms_drake.tube.rows.disturbance_gains import ATTITUDE, DEPTH, JOINTS, TIP, VEHICLE, Parts
from uvms_drake.tube.rows.image import BlockBounds, least_speeds
from uvms_drake.tube.search.estimate import Check

MODEL = "the thrusters' model"
"""Source of the errors of the thrusters' model."""
HALVINGS = 6
"""Number of times that all delays are halved to find sufficient ones."""


class ActuationTube:
    """Effect of delayed thrusters; see tube/actuation/theory.md#error-budget-under-thrusters.

    Args:
        law: The law.
        basis: The data.
        rows: The tip's task in (χ, q) (n,).
        loops: Loops of the vehicle's rows and of the tip's.
        table: Parts of the blocks without it.
    """

    table: dict[str, Parts]
    """All parts; without any feedback of errors, if the condition does not hold."""
    condition: Condition
    """Small-gain condition of errors and the feedforward that they make."""
    extra_input: np.ndarray
    """Addition to u and τ, as the joints take the wrench as it is (2(6+n),)."""
    check: Check
    """Makes the second search."""

    def __init__(self, law: TipFirst, basis: Basis, rows: np.ndarray,
                 loops: tuple[RowLoop, RowLoop], table: dict[str, Parts]):
        assert basis.contact is not None  # or `_unknown`
        # Suprema of the feedforward, over plans that are slower than the robot by the tube.
        slower = slower_plans(basis, rows, table)
        rate = np.minimum(basis.largest_rate, 2.0 / basis.time_step * np.repeat(
            slower, [3, 3, basis.model.num_joints]))
        driven = np.setdiff1d(np.arange(6), law.undriven_rows)
        self._feedforward, self.check = thruster_feedforward(
            basis.model, basis.declared, rows, Plans(
                float(slower[0]), float(slower[1]), float(slower[2]), basis.u_limit, rate), driven,
            basis.actuators.off, basis.settings)
        self._known = {name: np.sum(list(parts.values()), axis=0) for name, parts in table.items()}
        self._set_loops(basis, loops)

        # The least fixed point of the small-gain loop, and the parts at it.
        z, radius = self._least_bounds(self._rows)
        self.condition = Condition(
            "delayed actuators, spectral radius of errors by their own feedforward", radius, "<",
            1.0, theorem="tube/actuation/theory.md#error-budget-under-thrusters",
            topic="delayed actuators",
            obstacle="" if radius < 1.0 else self._sufficient_delays(basis.actuators))
        if not np.isfinite(z).all():  # A lower bound: the parts without any feedback of errors.
            z = np.zeros((4, 4))
        parts, into = self._parts(z, self._rows), self._feedforward.into_joints[:, None]
        of: dict[str, Callable[[np.ndarray], np.ndarray]] = {
            VEHICLE: lambda part: part[VEHICLE_ROWS], ATTITUDE: lambda part: part[ATTITUDE_ROWS],
            TIP: lambda part: part[TIP_ROWS], DEPTH: lambda part: part[TIP_ROWS],
            JOINTS: lambda part: np.sum((into * part)[TIP_ROWS:], axis=0)}
        self.table = {name: known | {source: of[name](part) for source, part in parts.items()}
                      for name, known in table.items()}
        self.extra_input = self._rows.extra_input(
            self._errors(z), float(sum(part[E] for part in self.table[JOINTS].values())),
            float(slower[2]))

    def _set_loops(self, basis: Basis, loops: tuple[RowLoop, RowLoop]) -> None:
        """Sets the budget of rows without observers, and their parts by the thrusters' model."""
        contact = basis.contact
        assert contact is not None
        self._loops = tuple(replace(loop, observer=0.0) for loop in loops)
        self._force = (contact.size, float(np.hypot(contact.rate, contact.tangential_rate)),
                       float(np.hypot(contact.ripple, contact.tangential_ripple)))
        vehicle, tip = self._loops
        self._rows = ThrusterBudget(basis.actuators, vehicle, tip, self._feedforward, self._force)
        gains = np.repeat([np.array(loop.gains["disturbance"]) for loop in loops], 2, axis=0)
        # ë is the feedback and the disturbance.
        gains = np.column_stack([gains, 1.0 + gains[:, W]])
        self._by_model = gains * self._feedforward.by_thrusters[:, None]
        self._feedback = np.repeat(
            [[loop.k * loop.sigma, loop.k + loop.sigma] for loop in loops], 2, axis=0)

    def _least_bounds(self, rows: ThrusterBudget) -> tuple[np.ndarray, float]:
        """Returns the delayed part of the rows (4, 4), and the spectral radius."""
        return least_bounds(
            lambda z: np.sum(list(self._parts(z, rows).values()), axis=0), (4, 4))

    def _sufficient_delays(self, actuators: Actuators) -> str:
        """Returns delays that suffice with these gains and this feedforward."""
        for halved in range(1, HALVINGS + 1):
            paths = [Path(*(0.5**halved * time for time in astuple(path)))
                     for path in (actuators.vehicle, actuators.joints)]
            vehicle, tip = (replace(loop, **asdict(path))
                            for loop, path in zip(self._loops, paths, strict=True))
            rows = ThrusterBudget(replace(actuators, vehicle=paths[0], joints=paths[1]), vehicle,
                                  tip, self._feedforward, self._force)
            if self._least_bounds(rows)[1] < 1.0:
                wrench = paths[0]
                return ("the delay of its wrench and torques is too long for these gains; "
                        f"1/{2**halved} of all periods, dead times and lags would do: of the wrench"
                        f" {wrench.period:.3g}, {wrench.dead_time:.3g} and {wrench.lag:.3g} s")
        return ""

    def _errors(self, delayed: np.ndarray) -> Errors:
        """Returns the errors for a delayed part of the rows, e, ė, w and ë by block (4, 4)."""
        known, J_q = self._known, self._feedforward.by_joints[TASK_ROWS]
        vehicle = known[VEHICLE] + delayed[VEHICLE_ROWS]
        attitude = known[ATTITUDE] + delayed[ATTITUDE_ROWS]
        x = np.array([vehicle, attitude, known[JOINTS], delayed[TIP_ROWS], delayed[TASK_ROWS]])
        of_rows = np.array([vehicle, attitude, known[TIP] + delayed[TIP_ROWS],
                            J_q * known[JOINTS] + delayed[TASK_ROWS]])
        return Errors(
            x=x[:, [E, RATE]].T.ravel(), rate=x[:, [RATE, ACCELERATION]].T.ravel(),
            w=of_rows[:, W],
            w_rate=np.sum(of_rows[:, [RATE, ACCELERATION]] * self._feedback, axis=1))

    def _parts(self, delayed: np.ndarray, rows: ThrusterBudget) -> dict[str, np.ndarray]:
        """Returns bounds of e, ė, w and ë by source (4, 4), for a delayed part of the rows."""
        return {MODEL: self._by_model} | rows.parts(self._errors(delayed))


def zoh_command_tube(basis: Basis, rows: np.ndarray, loops: tuple[RowLoop, ...],
                     table: Mapping[str, Parts], turning: float, regular: float) -> ZohCommandTube:
    """Returns the effect of a command under zero-order hold."""
    contact = basis.contact
    assert contact is not None  # or `_unknown`
    return ZohCommandTube(basis, rows, loops, table, slower_plans(basis, rows, table),
                          turning, regular, (contact.size + contact.error, contact.torque_error))


def slower_plans(basis: Basis, rows: np.ndarray, table: Mapping[str, Parts]) -> np.ndarray:
    """Returns the speed limits of plans, ‖ν̄₁‖, ‖ν̄₂‖ and ‖q̄̇‖ (3,).

    They are those of the robot less the least radii of a tube of these parts, if that is positive.
    """
    declared, sums = basis.declared, {
        name: np.sum(list(parts.values()), axis=0) for name, parts in table.items()}
    limits = np.array([declared.nu1, declared.nu2, declared.qdot])
    least = least_speeds(
        basis.model, declared, rows, block_bounds(sums, basis.model.size), basis.settings.seed)
    return np.where(least < limits, limits - least, limits)


def block_bounds(sums: Mapping[str, np.ndarray], size: int) -> list[BlockBounds]:
    """Returns the bounds for `tip_first_image`."""
    return [BlockBounds(where, *map(float, sums[name][:3])) for name, where in (
        (VEHICLE, np.arange(3)), (ATTITUDE, np.arange(3, 6)), (JOINTS, np.arange(6, size)))]
