"""Whether a robot can hold a task at rest: weight and force apart, with advice.

With w = b(𝔮) the generalised force of weight and buoyancy, j = J_𝔭ᵀ times the direction of pressing
that of a newton on the wall, and r the reserve for motion, coordinate i can be held where

    |wᵢ + F jᵢ| ≤ aᵢ = τ_max,i − rᵢ,                                                             (1)

which is an interval of forces F: an arm that reaches up may be too weak to carry itself and strong
enough to press.
"""

from dataclasses import dataclass, replace

import numpy as np

from uvms_drake.model.description.thruster_file import AXES
from uvms_drake.model.uvms import Uvms
from uvms_drake.model.uvms_model import UvmsModel

NOTHING = 1e-9
"""Lever of a coordinate that a force on the wall does not reach [m]."""


@dataclass(frozen=True)
class Holding:
    """Generalised forces that hold a task at rest, by coordinate (6+n,), in N and N m."""

    weight: np.ndarray
    """w of (1)."""
    by_newton: np.ndarray
    """j of (1), for each newton [1, m]."""
    reserve: np.ndarray
    """r of (1)."""
    reserve_if_strong: np.ndarray
    """That of stronger motors, which have more friction, too."""
    strength: np.ndarray
    """τ_max of (1); infinite where it is not known."""

    def missing(self, force: float) -> np.ndarray:
        """Returns how much stronger each would have to be (6+n,); zero or less is enough."""
        return np.abs(self.weight + force * self.by_newton) - (
            self.strength - self.reserve)

    def forces(self) -> tuple[float, float]:
        """Returns the smallest and the largest F [N] of (1); the first exceeds the last if none."""
        least, most = 0.0, np.inf
        margin = self.strength - self.reserve
        for a, w, j in zip(margin, self.weight, self.by_newton, strict=True):
            if not np.isfinite(a):
                continue
            if a < 0.0 or (abs(j) < NOTHING and abs(w) > a):
                return np.inf, 0.0
            if abs(j) >= NOTHING:
                ends = sorted([(-a - w) / j, (a - w) / j])
                least, most = max(least, ends[0]), min(most, ends[1])
        return least, most

    def said(self, i: int, force: float) -> str:
        """Returns the parts of weight and force in coordinate i, in words."""
        weight, pressing = self.weight[i], force * self.by_newton[i]
        change = abs(weight + pressing) - abs(weight)
        how = f"take {-change:.3g} off" if change < 0.0 else f"add {change:.3g}"
        return (f"weight and buoyancy take {abs(weight):.3g} {unit_of(i)}, and {force:g} N on the "
                f"wall {how}")


def with_water(uvms: Uvms) -> tuple[Uvms, list[str]]:
    """Returns a robot whose dry links of the arm weigh nothing in water, and their names."""
    plant, water = uvms.plant, uvms.hydrodynamics
    bodies, names = dict(water.bodies), []
    moved = {body.index() for joint in uvms.joints
             for body in plant.GetBodiesWeldedTo(joint.child_body())}
    for body in (plant.get_body(index) for index in moved):
        known = uvms.water(body)
        if known.displaced_volume == 0.0 and body.default_mass() > 0.0:
            names.append(body.name())
            bodies[body.name()] = replace(
                known, displaced_volume=body.default_mass() / water.fluid_density,
                center_of_buoyancy=body.default_com())
    return replace(uvms, hydrodynamics=replace(water, bodies=bodies)), sorted(names)


def what_helps(uvms: Uvms, config: np.ndarray, holding: Holding, force: float) -> str:
    """Returns the changes that make (1) hold, in words; each is checked.

    Args:
        uvms: The robot.
        config: 𝔮 (6+n,) of the task.
        holding: Forces that hold it, at its thrusters and motors.
        force: F that was asked for [N].
    """
    found = []
    least, most = holding.forces()
    least, most = _rounded(least, np.ceil), _rounded(most, np.floor)
    if max(least, 0.0) < most:
        found.append(f"a force of {least:g} N at least" if not np.isfinite(most) else
                     f"a force of {most:g} N at most" if least <= 0.0 else
                     f"a force from {least:g} to {most:g} N")
    # Links of which the water is not known may weigh less.
    wet, names = with_water(uvms)
    if names:
        model = UvmsModel(wet)
        rest = np.zeros(model.size)
        lighter = replace(holding, weight=model.inverse_dynamics(
            model.kinematics(config), rest, rest))
        if np.all(lighter.missing(force) <= 0.0):
            found.append(f"water in hydrodynamics.yaml of the dry links {', '.join(names)}: a "
                         "neutral weight would do")
    strong = replace(holding, reserve=holding.reserve_if_strong)
    lacking = np.where(holding.missing(force) > 0.0, strong.missing(force), 0.0)
    found.append(" and ".join(
        f"{_rounded(holding.strength[i] + lacking[i], np.ceil):g} {unit_of(i)} along "
        f"{coordinate(i)}" for i in range(len(lacking)) if lacking[i] > 0.0))
    return "; or ".join(found)


def unit_of(i: int) -> str:
    """Returns the unit of the generalised force in coordinate i of ζ."""
    return "N" if i < 3 else "N m"


def coordinate(i: int) -> str:
    """Returns the name of coordinate i of ζ."""
    return AXES[i] if i < 6 else f"q{i - 5}"


def _rounded(value: float, way: np.ufunc) -> float:
    """Returns a value of two digits above or below one."""
    if not np.isfinite(value) or value <= 0.0:
        return value
    size = 10.0 ** (np.floor(np.log10(value)) - 1.0)
    return float(f"{float(way(value / size) * size):.6g}")
