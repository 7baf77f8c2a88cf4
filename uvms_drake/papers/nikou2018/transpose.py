"""Law `transpose` of Nikou, Verginis and Dimarogonas (2018), as its proof needs it.

With 𝔢 = χ − χ̄, 𝔷 = ζ − ζ̄ and Euler angles compared modulo 2π,

    u = ū − k 𝔷 − k σ J(𝔮̄)ᵀ 𝔢,

and ζ = ζ̄ − σ J(𝔮̄)ᵀ 𝔢 where the velocity is the input. It does not act on the arm's self-motion;
with `joints`, J_x and 𝔢_y take the place of J and 𝔢, and it does. Derivation and the difference to
the printed law: papers/nikou2018/theory.md#law-transpose.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from uvms_drake.common.kinds import register
from uvms_drake.control.laws.law import (
    AncillaryLaw,
    Deviation,
    Pair,
    RunBound,
    check_gains,
)
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.uvms_model import UvmsModel


@register
@dataclass
class Transpose(AncillaryLaw):
    """The law `transpose` and its gains."""

    k: float = 20.0
    """Gain of the velocity error [1/s]; not read where the velocity is the input."""
    sigma: float = 1.0
    """σ, gain of the task error [1/s]."""
    joints: bool = False
    """Whether 𝔢_y is fed back with J_x instead of 𝔢 with J: the arm's self-motion too, which the
    paper's law leaves alone, and without which no tube protects the joints."""

    @property
    def protects_joints(self) -> bool:  # noqa: D102  see AncillaryLaw
        return self.joints

    @property
    def _rows(self) -> slice:
        """Rows of 𝔢_y and J_x that are fed back."""
        return slice(None) if self.joints else slice(0, 6)

    def check(self, *, kinematic: bool = False) -> None:  # noqa: D102  see AncillaryLaw
        check_gains(self, kinematic=kinematic)

    def command(self, model: UvmsModel, now: Pair, nominal_acceleration: Callable[[], np.ndarray],
                nominal_input: Callable[[], np.ndarray]) -> np.ndarray:
        """Returns u = ū − k𝔷 − kσJ(𝔮̄)ᵀ𝔢; it reads ū only."""
        error = pose_difference(*now.y)[self._rows]
        z = now.zeta[0] - now.zeta[1]
        return nominal_input() - self.k * z - self.k * self.sigma * now.J_x[1, self._rows].T @ error

    def velocity(self, model: UvmsModel, configuration: np.ndarray, nominal_state: np.ndarray
                 ) -> np.ndarray:
        """Returns ζ = ζ̄ − σJ(𝔮̄)ᵀ𝔢 (6+n,)."""
        nominal_configuration, nominal_zeta = np.split(nominal_state, 2)
        error = pose_difference(
            model.task_pose(configuration), model.task_pose(nominal_configuration))
        J_nominal = model.task_jacobian(nominal_configuration)[self._rows]
        return nominal_zeta - self.sigma * J_nominal.T @ error[self._rows]

    def deviation(self, now: Pair) -> Deviation:
        """Returns the errors; 𝔯 = 𝔷 + σJ(𝔮̄)ᵀ𝔢."""
        e_y, z = pose_difference(*now.y), now.zeta[0] - now.zeta[1]
        task = e_y[self._rows]
        return Deviation(task, e_y, z, z + self.sigma * now.J_x[1, self._rows].T @ task)

    def kinematic_run_bound(self, w_bound: float) -> RunBound:
        """Returns the bound along a run of the kinematics.

        With ζ = ζ̄ − σJ(𝔮̄)ᵀ𝔢, 𝔢̇ = J(𝔮)ζ − J(𝔮̄)ζ̄ + w = −σJ(𝔮̄)J(𝔮̄)ᵀ𝔢 + (J(𝔮) − J(𝔮̄))ζ + w, so that

            Ė = −σ λ(J(𝔮̄)J(𝔮̄)ᵀ) E + ‖(J(𝔮) − J(𝔮̄))ζ‖ + w̃,

        λ the smallest eigenvalue. The middle term is evaluated along the run: no constant bounds it
        by ‖𝔢‖, since the arm's self-motion, on which the law does not act, is in it. The joints
        have a bound only with J_x and 𝔢_y in place of J and 𝔢. ‖𝔷‖ is compared with σ‖J(𝔮̄)‖E,
        and 𝔯 with zero, its value where ζ is the command.
        """
        return RunBound(1, partial(self._rate, w_bound), self._bounds, from_deviation=True)

    def _rate(self, w_bound: float, E: np.ndarray, now: Pair) -> np.ndarray:
        J, J_nominal = now.J_x[:, self._rows]
        smallest = np.linalg.eigvalsh(J_nominal @ J_nominal.T)[0]
        drive = np.linalg.norm((J - J_nominal) @ now.zeta[0]) + w_bound
        return drive - self.sigma * smallest * E

    def _bounds(self, E: np.ndarray, now: Pair) -> np.ndarray:
        largest = float(np.linalg.norm(now.J_x[1, self._rows], 2))
        joints = E[0] if self.joints else np.inf
        return np.array([*np.repeat(E, 3), joints, self.sigma * largest * E[0], 0.0])
