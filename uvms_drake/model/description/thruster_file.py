"""The thrusters of a robot: an optional YAML file `thrusters.yaml` beside its SDFormat file.

Positions and axes are in the vehicle's frame B (FRD). The force of a thruster follows its
command by a table, a first-order lag later and after a dead time.
"""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from uvms_drake.common.constraints import Constraint, NotNegative, Positive, Vector
from uvms_drake.common.errors import require, vector
from uvms_drake.model.description.hydrodynamics_file import Place
from uvms_drake.model.frames.spatial import cross

FILE = "thrusters.yaml"
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
"""Names of the components of a wrench on the vehicle in axes of B about its origin."""
NotZero = Constraint("not zero", lambda x: np.linalg.norm(x) > 0.0)
MOST = 16
"""Largest number of thrusters: the signs of a bias are found by trying all of them."""


@dataclass
class CurveData:
    """Static force of a thruster, at rest in still water, by its command."""

    voltage: float | None = None
    """Supply voltage [V], where it is known."""
    command: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Commands in the driver's own unit, rising."""
    force: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Forces at them along the thruster's axis [N], linear in between. They rise, except over the
    dead band, where they are zero; at the first and the last command they are the largest."""

    def check(self) -> None:
        """Raises `InvalidParameter` unless it is the curve of a thruster."""
        size = int(np.size(self.command))
        require(size >= 2, "command", self.command, "two numbers or more")
        command, force = vector("command", self.command, size), vector("force", self.force, size)
        require(bool(np.all(np.diff(command) > 0.0)), "command", command, "rising")
        still = (force[:-1] == 0.0) & (force[1:] == 0.0)
        require(bool(np.all((np.diff(force) > 0.0) | still)), "force", force,
                "rising, or zero over the dead band")
        require(bool(force[0] <= 0.0 <= force[-1]), "force", force,
                "zero at some command, where the thruster stands still")


@dataclass
class ThrusterKind:
    """Data that thrusters of one make share."""

    lag: Annotated[float, Positive] = 0.0
    """Time constant T of the force, Tḟ + f = the curve's [s]."""
    smallest: Annotated[float, NotNegative] = 0.0
    """Size of force below which the curve is not to be trusted [N]: a propeller that starts jumps
    to it."""
    current: Annotated[float, NotNegative] = 0.0
    """Current at the largest force [A]; zero: unknown. It is needed for `largest_current` of
    `!Thrusters` only."""
    curves: list[CurveData] = field(default_factory=list)
    """One, or several for rising voltages, between which forces are linear in the voltage."""

    def check(self) -> None:
        """Raises `InvalidParameter` unless its curves belong together."""
        require(len(self.curves) > 0, "curves", self.curves, "one curve or more")
        voltages = [curve.voltage for curve in self.curves]
        known = [voltage for voltage in voltages if voltage is not None]
        require(known == sorted(set(known)) and all(0.0 < voltage < np.inf for voltage in known)
                and len(voltages) in (1, len(known)), "curves.voltage", voltages,
                "positive and rising, and given for each of several curves")
        for i, curve in enumerate(self.curves):
            force = np.asarray(curve.force)
            require(bool(max(-force[0], force[-1]) > self.smallest), f"curves[{i}].force", force,
                    f"beyond the smallest, {self.smallest:g} N")
        ends = [tuple(np.asarray(curve.command)[[0, -1]]) for curve in self.curves]
        require(len(set(ends)) == 1, "curves.command", ends, "from the same to the same command")


@dataclass
class ThrusterData:
    """Position and axis of a thruster."""

    kind: str = ""
    """Its `ThrusterKind`."""
    position: Place = field(default_factory=lambda: np.zeros(3))
    """p_BoT_B [m]."""
    axis: Annotated[np.ndarray, Vector(3), NotZero] = field(default_factory=lambda: np.zeros(3))
    """Direction of a positive force, in B; of any length."""


@dataclass
class ThrusterParameters:
    """All thrusters of a robot."""

    dead_time: Annotated[float, NotNegative] = 0.0
    """Dead time from a command to the first change of a force [s]."""
    voltage: Annotated[float, Positive] | None = None
    """Supply voltage that the controller assumes [V]; needed for curves of several voltages."""
    bias: Annotated[float, NotNegative] = 0.0
    """Smallest size of force [N] with which thrusters work against each other while no wrench is
    asked for, so that they stay out of their dead bands; those that can."""
    undriven: list[str] = field(default_factory=list)
    """Axes that are given up, of `AXES`: the others are driven exactly, whatever it does to them.
    As many as the thrusters leave undriven."""
    power_cut: bool = False
    """Whether the vehicle can cut the power of each thruster alone."""
    kinds: dict[str, ThrusterKind] = field(default_factory=dict)
    """Kinds of thrusters by name."""
    thrusters: dict[str, ThrusterData] = field(default_factory=dict)
    """Thrusters by name, in the order of their commands."""

    def check(self) -> None:
        """Raises `InvalidParameter` unless `undriven` are the axes that thrusters do not drive."""
        require(0 < len(self.thrusters) <= MOST, "thrusters", list(self.thrusters),
                f"1 to {MOST} by name")
        for name, thruster in self.thrusters.items():
            require(thruster.kind in self.kinds, f"thrusters.{name}.kind", thruster.kind,
                    f"one of {', '.join(self.kinds) or 'kinds, which has none'}")
        known = all(axis in AXES for axis in self.undriven)
        require(known and len(set(self.undriven)) == len(self.undriven), "undriven", self.undriven,
                f"different ones of {', '.join(AXES)}")
        B = thrust_map(list(self.thrusters.values()))
        lost = 6 - _rank(B)
        weakest = ", ".join(_weakest(B, lost)) or "none"
        driven = _rank(B[driven_rows(self.undriven)])
        require(len(self.undriven) == lost and driven == 6 - lost, "undriven", self.undriven,
                f"the axes that the thrusters do not drive: {lost}, such as {weakest}")


def thrust_map(thrusters: list[ThrusterData]) -> np.ndarray:
    """Returns B (6, m): the wrench of unit forces, columns (a, p × a), in axes of B about Bo."""
    axes = np.array([np.asarray(item.axis, dtype=float) for item in thrusters])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    places = np.array([np.asarray(item.position, dtype=float) for item in thrusters])
    return np.vstack([axes.T, cross(places, axes).T])


def driven_rows(undriven: list[str]) -> np.ndarray:
    """Returns the indices of the axes that are driven."""
    return np.array([i for i, axis in enumerate(AXES) if axis not in undriven])


def undriven_axes(places: list[tuple[np.ndarray, np.ndarray]]) -> list[str]:
    """Returns the axes of `AXES` that thrusters do not drive, by their positions [m] and axes."""
    B = thrust_map([ThrusterData(position=position, axis=axis) for position, axis in places])
    return _weakest(B, 6 - _rank(B))


def _rank(B: np.ndarray) -> int:
    return int(np.linalg.matrix_rank(B, tol=1e-6 * np.linalg.norm(B))) if B.size else 0


def _weakest(B: np.ndarray, count: int) -> list[str]:
    """Returns so many axes that are nearest to the null space of the thrust map's transpose."""
    lost = np.linalg.svd(B)[0][:, 6 - count:]
    found = np.argsort(-np.linalg.norm(lost, axis=1), kind="stable")[:count]
    return [AXES[i] for i in sorted(found)]

