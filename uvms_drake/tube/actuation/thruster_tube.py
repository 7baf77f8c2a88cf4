"""What actuators that are late add to the blocks of `tip first`: thrusters, or a held command.

See the last part of `tube.laws.tip_first`.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, astuple, replace

import numpy as np

from uvms_drake.control.laws.tip_first import TipFirst
from uvms_drake.tube.actuation.held_command import HeldCommandTube
from uvms_drake.tube.actuation.thruster_budget import Errors, ThrusterBudget, least_bounds
from uvms_drake.tube.actuation.thruster_feedforward import Plans, thruster_feedforward
from uvms_drake.tube.conditions import BEYOND, Condition
from uvms_drake.tube.law_tube import Basis
from uvms_drake.tube.loops.actuator_path import Actuators, Path
from uvms_drake.tube.loops.row_loop import RowLoop
from uvms_drake.tube.rows.disturbance_gains import ATTITUDE, DEPTH, JOINTS, TIP, VEHICLE, Parts
from uvms_drake.tube.rows.image import BlockBounds, least_speeds
from uvms_drake.tube.search.estimate import Check

MODEL = "the thrusters' model"
"""Source of what their model is off by."""
HALVINGS = 6
"""Times that all that is late is halved to find what would do."""


class ActuationTube:
    """What late actuators add; see `late_rows`.

    Args:
        law: The law.
        basis: The data.
        rows: The tip's task in (χ, q) (n,).
        loops: Of the vehicle's rows and of the tip's.
        table: Parts of the blocks without it.
    """

    table: dict[str, Parts]
    """All parts."""
    condition: Condition
    """That less comes back of errors, by the loads that they make, than there was; the parts are of
    what comes back of none, if it does not hold."""
    beside: np.ndarray
    """What the joints' taking the wrench as it is makes of u and τ (2(6+n),)."""
    check: Check

    def __init__(self, law: TipFirst, basis: Basis, rows: np.ndarray,
                 loops: tuple[RowLoop, RowLoop], table: dict[str, Parts]):
        model, declared, contact = basis.model, basis.declared, basis.contact
        assert contact is not None  # or `_unknown`
        before = {name: np.sum(list(parts.values()), axis=0) for name, parts in table.items()}
        slower = slower_plans(basis, rows, table)
        rate = np.minimum(basis.largest_rate, 2.0 / basis.time_step * np.repeat(
            slower, [3, 3, model.num_joints]))
        driven = np.setdiff1d(np.arange(6), law.undriven_rows)
        self._loads, self.check = thruster_feedforward(
            model, declared, rows, Plans(
                float(slower[0]), float(slower[1]), float(slower[2]), basis.u_limit, rate), driven,
            basis.actuators.off, basis.settings)
        vehicle, tip = (replace(loop, observer=0.0) for loop in loops)
        self._force = (contact.size, float(np.hypot(contact.rate, contact.tangential_rate)),
                       float(np.hypot(contact.ripple, contact.tangential_ripple)))
        self._rows = ThrusterBudget(basis.actuators, vehicle, tip, self._loads, self._force)
        wrong = np.repeat([np.array(loop.gains["disturbance"]) for loop in loops], 2, axis=0)
        wrong = np.column_stack([wrong, 1.0 + wrong[:, 2]])  # ë as in `_loop`
        self._wrong = wrong * self._loads.by_thrusters[:, None]
        self._before = before
        self._feedback = np.repeat(
            [[loop.k * loop.sigma, loop.k + loop.sigma] for loop in loops], 2, axis=0)

        z, share = self._least_bounds(self._rows)
        self.condition = Condition(
            "late actuators, part of errors that comes back by loads", share, "<", 1.0,
            "" if share < 1.0 else self._needed(basis.actuators, vehicle, tip),
            theorem="tube/actuation/theory.md#error-budget-under-thrusters")
        endless = not np.isfinite(z).all()
        if endless:  # What there is before anything comes back, at least.
            z = np.zeros((4, 4))
        parts, into = self._parts(z, self._rows), self._loads.into_joints[:, None]
        of: dict[str, Callable[[np.ndarray], np.ndarray]] = {
            VEHICLE: lambda part: part[0], ATTITUDE: lambda part: part[1],
            TIP: lambda part: part[2], DEPTH: lambda part: part[2],
            JOINTS: lambda part: np.sum((into * part)[2:], axis=0)}
        self.table = {name: known | {source: of[name](part) for source, part in parts.items()}
                      for name, known in table.items()}
        self.beside = self._rows.beside(
            self._errors(z), float(sum(part[0] for part in self.table[JOINTS].values())),
            float(slower[2]))

    def _least_bounds(self, rows: ThrusterBudget) -> tuple[np.ndarray, float]:
        """Returns what is late of the rows (4, 4), and the part of errors that comes back."""
        return least_bounds(
            lambda z: np.sum(list(self._parts(z, rows).values()), axis=0), (4, 4))

    def _needed(self, actuators: Actuators, *loops: RowLoop) -> str:
        """Returns how late the commands may be, with these gains and loads."""
        for halved in range(1, HALVINGS + 1):
            paths = [Path(*(0.5**halved * time for time in astuple(path)))
                     for path in (actuators.vehicle, actuators.joints)]
            vehicle, tip = (replace(loop, **asdict(path))
                            for loop, path in zip(loops, paths, strict=True))
            rows = ThrusterBudget(replace(actuators, vehicle=paths[0], joints=paths[1]), vehicle, tip,
                            self._loads, self._force)
            if self._least_bounds(rows)[1] < 1.0:
                wrench = paths[0]
                return (f"{BEYOND}its wrench and torques are too late for these gains; "
                        f"1/{2**halved} of all periods, dead times and lags would do: of the wrench"
                        f" {wrench.period:.3g}, {wrench.dead_time:.3g} and {wrench.lag:.3g} s")
        return ""

    def _errors(self, late: np.ndarray) -> Errors:
        """Returns the errors of which those by what is late are e, ė, w and ë of rows (4, 4)."""
        before, J_q = self._before, self._loads.by_joints[3]
        vehicle, attitude = before[VEHICLE] + late[0], before[ATTITUDE] + late[1]
        x = np.array([vehicle, attitude, before[JOINTS], late[2], late[3]])
        of_rows = np.array([vehicle, attitude, before[TIP] + late[2],
                            J_q * before[JOINTS] + late[3]])
        return Errors(x[:, :2].T.ravel(), x[:, [1, 3]].T.ravel(), of_rows[:, 2], np.sum(
            of_rows[:, [1, 3]] * self._feedback, axis=1))

    def _parts(self, late: np.ndarray, rows: ThrusterBudget) -> dict[str, np.ndarray]:
        """Returns bounds of e, ė, w and ë by source (4, 4), if those of what is late are these."""
        return {MODEL: self._wrong} | rows.parts(self._errors(late))


def held_rows(basis: Basis, rows: np.ndarray, loops: tuple[RowLoop, ...],
          table: Mapping[str, Parts], turning: float, regular: float) -> HeldCommandTube:
    """Returns what a command that is held adds."""
    contact = basis.contact
    assert contact is not None  # or `_unknown`
    return HeldCommandTube(basis, rows, loops, table, slower_plans(basis, rows, table),
                    turning, regular,
                    (contact.size + contact.error, contact.torque_error))


def slower_plans(basis: Basis, rows: np.ndarray, table: Mapping[str, Parts]) -> np.ndarray:
    """Returns what plans may do at most, ‖ν̄₁‖, ‖ν̄₂‖ and ‖q̄̇‖ (3,).

    Less than the robot may by the least that a tube of these parts takes, if they can.
    """
    declared, sums = basis.declared, {
        name: np.sum(list(parts.values()), axis=0) for name, parts in table.items()}
    limits = np.array([declared.nu1, declared.nu2, declared.qdot])
    least = least_speeds(
        basis.model, declared, rows, block_bounds(sums, basis.model.size), basis.settings.seed)
    return np.where(least < limits, limits - least, limits)


def block_bounds(sums: Mapping[str, np.ndarray], size: int) -> list[BlockBounds]:
    """Returns the bounds that `tip_first_image` takes."""
    return [BlockBounds(where, *map(float, sums[name][:3])) for name, where in (
        (VEHICLE, np.arange(3)), (ATTITUDE, np.arange(3, 6)), (JOINTS, np.arange(6, size)))]
