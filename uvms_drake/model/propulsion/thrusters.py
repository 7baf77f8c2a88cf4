"""Thrusters as functions of arrays: curves, their inverses, and the wrench."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from uvms_drake.common.errors import require, vector
from uvms_drake.model.description import thruster_file


@dataclass(frozen=True)
class ThrustCurve:
    """Force by command and command by force of one thruster, piecewise linear."""

    command: np.ndarray
    """Commands (p,), rising."""
    force: np.ndarray
    """Forces at them [N], rising, zero over the dead band."""

    @cached_property
    def dead_band(self) -> tuple[float, float]:
        """Smallest and largest command without force."""
        still = self.command[self.force == 0.0]
        if still.size:
            return float(still[0]), float(still[-1])
        zero = float(np.interp(0.0, self.force, self.command))
        return zero, zero

    @cached_property
    def _inverse(self) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Forces and commands up to the dead band, and from it on."""
        start, end = self.dead_band
        back, forward = self.force < 0.0, self.force > 0.0
        return ((np.append(self.force[back], 0.0), np.append(self.command[back], start)),
                (np.append(0.0, self.force[forward]), np.append(end, self.command[forward])))

    def force_of(self, command: float) -> float:
        """Returns the force [N]; beyond the table, the largest."""
        return float(np.interp(command, self.command, self.force))

    def command_of(self, force: float) -> float:
        """Returns the command of a force [N], limited to the table; the inverse of `force_of`.

        The command of no force is the middle of the dead band; any other is out of it.
        """
        if force == 0.0:
            return 0.5 * sum(self.dead_band)
        back, forward = self._inverse
        return float(np.interp(force, *(forward if force > 0.0 else back)))


def curve_at(kind: thruster_file.ThrusterKind, voltage: float | None) -> ThrustCurve:
    """Returns the curve at a voltage [V]: at each command the force is linear in the voltage.

    Args:
        kind: Kind of thruster, with its curves.
        voltage: None stands for that of the only curve.
    """
    curves, volts = kind.curves, [curve.voltage for curve in kind.curves]
    if voltage is None:
        require(len(curves) == 1, "voltage", voltage, f"given, for curves of {volts} V")
        volts = [0.0]
    known = [each for each in volts if each is not None]
    at = 0.0 if voltage is None else voltage
    require(bool(known) and known[0] <= at <= known[-1], "voltage", voltage,
            f"within those of the curves, {volts} V")
    commands = np.unique(np.concatenate([curve.command for curve in curves]))
    forces = np.array([np.interp(commands, curve.command, curve.force) for curve in curves])
    return ThrustCurve(commands, np.array([np.interp(at, known, each) for each in forces.T]))


@dataclass(frozen=True)
class ThrusterModel:
    """All m thrusters of a robot at one voltage."""

    names: tuple[str, ...]
    B: np.ndarray
    """(6, m) the wrench of unit forces; see `thrust_map`."""
    curves: tuple[ThrustCurve, ...]
    lag: np.ndarray
    """Time constants of the forces (m,) [s]."""
    smallest: np.ndarray
    """Smallest reliable forces of the curves (m,) [N]."""
    dead_time: float
    """Dead time [s]."""
    bias: float
    """Bias of the allocation, see `ThrusterParameters` [N]."""
    driven: np.ndarray
    """Indices of the driven axes."""
    current: np.ndarray
    """Currents at the largest forces (m,) [A]; zero where unknown."""
    largest_current: float = np.inf
    """Largest current of all together [A]."""
    power_cut: bool = False
    """Whether the power of each can be cut."""

    @staticmethod
    def of(parameters: thruster_file.ThrusterParameters) -> "ThrusterModel":
        """Returns the model of the checked parameters of a robot's file."""
        thrusters = list(parameters.thrusters.values())
        kinds = [parameters.kinds[item.kind] for item in thrusters]
        curves = {name: curve_at(kind, parameters.voltage)
                  for name, kind in parameters.kinds.items()}
        return ThrusterModel(
            tuple(parameters.thrusters), thruster_file.thrust_map(thrusters),
            tuple(curves[item.kind] for item in thrusters),
            np.array([kind.lag for kind in kinds]), np.array([kind.smallest for kind in kinds]),
            parameters.dead_time, parameters.bias, thruster_file.driven_rows(parameters.undriven),
            np.array([kind.current for kind in kinds]), power_cut=parameters.power_cut)

    @property
    def size(self) -> int:
        """Number m of thrusters."""
        return len(self.names)

    @property
    def undriven(self) -> np.ndarray:
        """Indices of the undriven axes."""
        return np.setdiff1d(np.arange(len(thruster_file.AXES)), self.driven)

    @cached_property
    def lower(self) -> np.ndarray:
        """Least forces (m,) [N], zero or negative."""
        least = np.array([curve.force[0] for curve in self.curves])
        least.setflags(write=False)
        return least

    @cached_property
    def upper(self) -> np.ndarray:
        """Largest forces (m,) [N]."""
        most = np.array([curve.force[-1] for curve in self.curves])
        most.setflags(write=False)
        return most

    def forces_of(self, commands: np.ndarray) -> np.ndarray:
        """Returns the steady forces (m,) [N] for commands (m,), within the largest current."""
        return self.within_current(np.array([
            curve.force_of(command) for curve, command in zip(self.curves, commands, strict=True)]))

    def within_current(self, forces: np.ndarray) -> np.ndarray:
        """Returns forces (m,) [N] reduced by one factor until Σ I is the largest current at most.

        By momentum theory the power at a constant voltage is I ∝ |f|^{3/2}.
        """
        if self.largest_current == np.inf:
            return forces
        largest = np.maximum(-self.lower, self.upper)
        share = np.divide(np.abs(forces), largest, out=np.zeros(self.size), where=largest > 0.0)
        total = float(self.current @ share**1.5)
        return forces if total <= self.largest_current else forces * (
            self.largest_current / total) ** (2.0 / 3.0)

    def without(self, index: int) -> "ThrusterModel":
        """Returns the others, on the axes that they drive independently, from surge to yaw."""
        kept = np.delete(np.arange(self.size), index)
        B, driven = self.B[:, kept], self.driven[:0]
        for axis in self.driven:
            if np.linalg.matrix_rank(B[[*driven, axis]]) > len(driven):
                driven = np.append(driven, axis)
        return replace(
            self, B=B, driven=driven,
            names=tuple(self.names[i] for i in kept), curves=tuple(self.curves[i] for i in kept),
            lag=self.lag[kept], smallest=self.smallest[kept], current=self.current[kept])

    def commands_of(self, forces: np.ndarray) -> np.ndarray:
        """Returns the commands (m,) for forces (m,) [N]."""
        return np.array([curve.command_of(force) for curve, force
                         in zip(self.curves, forces, strict=True)])

    def off_by(self, error: np.ndarray | float) -> "ThrusterModel":
        """Returns the thrusters with forces larger by relative errors (), (1,) or (m,)."""
        shares = self.each(error)
        require(bool(np.all(shares >= -1.0)), "error", shares, "-1 or above")
        return replace(self, curves=tuple(
            replace(curve, force=(1.0 + share) * curve.force)
            for curve, share in zip(self.curves, shares, strict=True)))

    def each(self, error: np.ndarray | float) -> np.ndarray:
        """Returns relative errors (), (1,) or (m,) as those of each thruster (m,)."""
        shares = np.asarray(error, dtype=float)
        if shares.size == 1:
            shares = np.full(self.size, shares.item())
        return vector("error", shares, self.size)
