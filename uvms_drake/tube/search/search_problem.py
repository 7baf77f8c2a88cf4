"""Problems of a search for largest values: functions of a nominal motion and of errors.

A motion x is a pose (the tip's position, the vehicle's attitude, the joints), ζ̄ and ū over its
limits; an error is in a sum of ellipsoids. `ascent` and `second_search` look for the largest value
of each channel, the norm of some components, over all motions of the declared set and all errors.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.uvms_model import Kinematics, UvmsModel
from uvms_drake.tube.search.constraint_set import ROUNDING, ConstraintSet, pulled

PULLS = 5
"""Halvings of a step that leaves the set."""
Part = tuple[np.ndarray, float]
"""Matrix (errors, j) and radius: the errors are the sum of matrix · ball of the radius."""


@dataclass(frozen=True)
class SearchProblem(ABC):
    """Sets of motions and errors; a derived class has the function."""

    model: ContactModel
    declared: ConstraintSet
    parts: list[Part]
    """Summands of the errors (errors,)."""

    @property
    def size(self) -> int:
        """6 + n."""
        return self.model.size

    @property
    def errors(self) -> int:
        """Number of components of the errors, 2(6+n) by default."""
        return 2 * self.size

    @property
    @abstractmethod
    def channels(self) -> list[slice]:
        """Components of the values, whose norms are maximised."""

    @abstractmethod
    def values(self, x: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Returns the values (..., c) of motions (..., 3(6+n)) and errors (..., errors).

        Real or complex; zero where there are no errors.
        """

    def draw(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Returns random motions (count, 3(6+n)), ū a third of the time on each of its bounds."""
        poses, speeds = np.empty((0, self.size)), np.empty((0, self.size))
        while len(poses) < count:
            config, zeta = self.declared.sample(self.model, count, rng)
            pose = config.copy()
            pose[:, :3] = self.model.task_pose(config)[:, :3]
            inside = np.all(np.abs(self.bounded(pose)) <= 1.0 + 1e-7, axis=1)
            poses = np.concatenate([poses, pose[inside]])
            speeds = np.concatenate([speeds, zeta[inside]])
        u = np.clip(1.5 * rng.uniform(-1.0, 1.0, (count, self.size)), -1.0, 1.0)
        return np.concatenate([poses[:count], speeds[:count], u], axis=1)

    def config(self, pose: np.ndarray) -> np.ndarray:
        """Returns 𝔮 (..., 6+n) with the tip at the first three numbers of `pose`."""
        return self._placed(pose)[0]

    def bounded(self, pose: np.ndarray) -> np.ndarray:
        """Returns values of poses (m, 6+n) that have to be in [−1, 1], besides their box (m, 4).

        Tip pitch, tool angle, contact, and the attitude over that at which the contact's law jumps.
        """
        chi = self._placed(pose)[1]
        turned = self.model.surface.turned(chi) / NEAREST_TO_A_JUMP
        return np.concatenate(
            [self.declared.normalised_tip(self.model, chi), turned[:, None]], axis=1)

    def pulled(self, pose: np.ndarray, inside: np.ndarray) -> np.ndarray:
        """Returns poses (m, 6+n) of the box, moved towards others of the set (m, 6+n) into it."""
        return pulled(lambda x: np.all(np.abs(self.bounded(x)) <= 1.0 + ROUNDING, axis=1),
                      pose, inside, PULLS)

    def _placed(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns 𝔮 (..., 6+n) as of `config`, and χ (..., 6) there."""
        config = pose.copy()
        config[..., :3] = 0.0
        chi = self.model.task_pose(config)[..., :6]
        config[..., :3] = pose[..., :3] - chi[..., :3]
        chi[..., :3] = pose[..., :3]
        return config, chi


Product = Callable[[ContactModel, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Function that returns A w (..., rows) of the model, 𝔮, ζ and w (..., 6+n), real or complex."""


@dataclass(frozen=True)
class NormProblem(SearchProblem):
    """A(𝔮, ζ) w of errors w: its largest norm is that of A, if w is in the unit ball."""

    product: Product

    @property
    def errors(self) -> int:
        """6 + n."""
        return self.size

    @property
    def channels(self) -> list[slice]:
        """The only channel."""
        return [slice(None)]

    def values(self, x: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Returns A w."""
        pose, zeta, _ = np.split(x, 3, axis=-1)
        return self.product(self.model, self.config(pose), zeta, error)


def norm_problem(model: ContactModel, declared: ConstraintSet, product: Product,
                 weights: np.ndarray | float = 1.0) -> NormProblem:
    """Returns the problem whose largest value is sup‖AŴ‖₂, for the diagonal of Ŵ."""
    return NormProblem(model, declared, [(np.diag(weights * np.ones(model.size)), 1.0)], product)


NEAREST_TO_A_JUMP = 0.9
"""Largest attitude over the angle at which a contact's law jumps."""


def input_within(drift: np.ndarray, share: np.ndarray, u_limits: np.ndarray,
                 largest_rate: np.ndarray | float) -> np.ndarray:
    """Returns ū by a share of the tighter one of its two bounds, |ūᵢ| and |ζ̄̇ᵢ|, within both.

    A share of the looser one alone, cut to the tighter, is the same set; but for light joints,
    whose ζ̄̇ is cut long before, a search would have no slope.

    Args:
        drift: f(𝔮̄, ζ̄) (..., 6+n): ζ̄̇ = f + ū [m/s², rad/s²].
        share: Share of the bound (..., 6+n), in [−1, 1].
        u_limits: Bounds of |ūᵢ| (6+n,).
        largest_rate: Bounds of |ζ̄̇ᵢ| (6+n,), or one for all.
    """
    rates = largest_rate * np.ones(len(u_limits))
    slow = rates < u_limits
    u = u_limits * share
    if np.any(slow):
        u = _within(np.where(slow, np.where(slow, rates, 0.0) * share - drift, u), u_limits)
        u = _within(u + drift, rates) - drift
    return u


def _within(x: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """Returns real or complex x, cut to ± limit."""
    return np.where(np.abs(x.real) > limit, np.sign(x.real) * limit, x)


class NominalMotion(NamedTuple):
    """Nominal motion, maybe complex."""

    config: np.ndarray
    """𝔮̄ (..., 6+n) [m, rad]."""
    zeta: np.ndarray
    """ζ̄ (..., 6+n) [m/s, rad/s]."""
    kinematics: Kinematics
    """Geometry at 𝔮̄."""
    drift: np.ndarray
    """f(𝔮̄, ζ̄) (..., 6+n) [m/s², rad/s²]."""
    M: np.ndarray
    """M(𝔮̄) (..., 6+n, 6+n)."""


def nominal_motion(model: UvmsModel, config: np.ndarray, zeta: np.ndarray) -> NominalMotion:
    """Returns the nominal motion at (𝔮̄, ζ̄) (..., 6+n) each."""
    kinematics = model.kinematics(config)
    return NominalMotion(config, zeta, kinematics, *model.drift_and_inertia(kinematics, zeta))
