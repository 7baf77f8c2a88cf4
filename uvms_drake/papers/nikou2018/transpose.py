"""Law `transpose` of Nikou, Verginis and Dimarogonas (2018), as its proof needs it.

With 𝔢 = χ − χ̄, 𝔷 = ζ − ζ̄ and Euler angles compared modulo 2π,

    u = ū − k 𝔷 − k σ J(𝔮̄)ᵀ 𝔢,

and ζ = ζ̄ − σ J(𝔮̄)ᵀ 𝔢 where the velocity is the input. It does not act on the arm's self-motion;
with `joints`, J_x and 𝔢_y take the place of J and 𝔢, and it does. Derivation and the difference to
the printed law: papers/nikou2018/theory.md#law-transpose.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from uvms_drake.common.kinds import register
from uvms_drake.control.laws.law import (
    AncillaryLaw,
    Deviation,
    Pair,
    check_gains,
)
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.uvms_model import UvmsModel


@register
@dataclass
class Transpose(AncillaryLaw):
    """The law `transpose` and its gains."""

    k: float = 20.0
    """Gain of the velocity error [1/s]."""
    sigma: float = 1.0
    """σ, gain of the task error [1/s]."""
    joints: bool = False
    """Whether 𝔢_y is fed back with J_x instead of 𝔢 with J: the arm's self-motion too, which the
    paper's law leaves alone, and without which no tube protects the joints."""

    @property
    def protects_joints(self) -> bool:  # noqa: D102  see AncillaryLaw
        return self.joints

    @property
    def fed_back(self) -> slice:
        """Rows of 𝔢_y and J_x that are fed back."""
        return slice(None) if self.joints else slice(0, 6)

    def check(self) -> None:  # noqa: D102  see AncillaryLaw
        check_gains(self)

    def command(self, model: UvmsModel, now: Pair, nominal_acceleration: Callable[[], np.ndarray],
                nominal_input: Callable[[], np.ndarray]) -> np.ndarray:
        """Returns u = ū − k𝔷 − kσJ(𝔮̄)ᵀ𝔢; it reads ū only."""
        error = pose_difference(*now.y)[self.fed_back]
        z, J = now.zeta[0] - now.zeta[1], now.J_x[1, self.fed_back]
        return nominal_input() - self.k * z - self.k * self.sigma * J.T @ error

    def deviation(self, now: Pair) -> Deviation:
        """Returns the errors; 𝔯 = 𝔷 + σJ(𝔮̄)ᵀ𝔢."""
        e_y, z = pose_difference(*now.y), now.zeta[0] - now.zeta[1]
        task = e_y[self.fed_back]
        return Deviation(task, e_y, z, z + self.sigma * now.J_x[1, self.fed_back].T @ task)

