"""Radii of the velocities under the law `resolved` where the velocity is the input.

With J = [J_v J_a] of vehicle and arm, ζ = (ν, q̇) and 𝔮 = 𝔮(ȳ + (𝔢, 0)),

    q̇ = q̄̇,    ν − ν̄ = J_v(𝔮)⁻¹[J(𝔮̄)ζ̄ − J_a(𝔮)q̄̇ − σ𝔢] − ν̄,                                   (1)

whose suprema are searched for. See papers/nikou2018/theory.md#kinematic-tubes.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.euler import COMPLEX_STEP
from uvms_drake.model.frames.spatial import times
from uvms_drake.tube.constants import START_RANKS
from uvms_drake.tube.estimates import Estimate
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.local_search import DIFFERENCE, climb
from uvms_drake.tube.search.search_problem import SearchProblem
from uvms_drake.tube.search.second_search import second_search

STEPS = 4
"""Ascent steps of the search for the worst error 𝔢."""
_BLOCKS = (slice(0, 3), slice(3, 6))


def velocity_deviation(model: ContactModel, config: np.ndarray, zeta: np.ndarray,
                       error: np.ndarray, sigma: float) -> np.ndarray:
    """Returns ν − ν̄ of (1) (..., 6).

    Args:
        model: The prediction model.
        config: 𝔮̄ (..., 6+n).
        zeta: ζ̄ (..., 6+n).
        error: 𝔢 (..., 6); complex for a derivative.
        sigma: σ [1/s].
    """
    y = model.task_pose(config) + np.zeros_like(error[..., :1])
    y[..., :6] += error
    J = model.kinematics(model.configuration(y)).J_chi
    rate = times(model.kinematics(config).J_chi, zeta) - sigma * error
    rate = rate - times(J[..., 6:], zeta[..., 6:])
    return np.linalg.solve(J[..., :6], rate[..., None])[..., 0] - zeta[..., :6]


def worst_errors(model: ContactModel, config: np.ndarray, zeta: np.ndarray, block: slice,
                 radius: float, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns the largest ‖(ν − ν̄)_block‖ (m,) over ‖𝔢‖ ≤ `radius` and its 𝔢 (m, 6).

    A local maximum, at 𝔮̄ and ζ̄ (m, 6+n).
    """
    steps = 1j * COMPLEX_STEP * np.eye(6)

    def first_order(error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the block (..., m, 3) at 𝔢 (..., m, 6) and its gradient (..., m, 6, 3)."""
        moved = velocity_deviation(
            model, config[:, None], zeta[:, None], error[..., None, :] + steps, sigma)
        return moved[..., 0, block].real, moved[..., block].imag / COMPLEX_STEP

    _, gradient = first_order(np.zeros((1, len(config), 6)))
    leading = np.linalg.svd(gradient, full_matrices=False)[0][..., 0]
    error = radius * np.array([-1.0, 1.0])[:, None, None] * leading
    best, best_error = np.full(error.shape[:2], -np.inf), error
    for _ in range(STEPS):
        value, gradient = first_order(error)
        norm = np.linalg.norm(value, axis=-1)
        best_error = np.where((norm > best)[..., None], error, best_error)
        best = np.maximum(norm, best)
        uphill = times(gradient, value)
        size = np.linalg.norm(uphill, axis=-1, keepdims=True)
        error = radius * uphill / np.maximum(size, 1e-12)
    sign, state = np.argmax(best, axis=0), np.arange(len(config))
    return best[sign, state], best_error[sign, state]


def velocity_radii(model: ContactModel, declared: ConstraintSet, *, radius: float, sigma: float,
                   samples: int, safety_factor: float, seed: int) -> tuple[float, float]:
    """Returns bounds of ‖ν₁ − ν̄₁‖ and ‖ν₂ − ν̄₂‖; infinite if no nominal state remains.

    Args:
        model: The prediction model.
        declared: Set of the real state.
        radius: ‖𝔢‖ ≤ w̃/σ.
        sigma: σ [1/s].
        samples: Nominal states from which the searches start.
        safety_factor: Factor of the largest values found.
        seed: Seed of the samples.
    """
    if radius >= declared.tip_pitch:
        return np.inf, np.inf
    nominal = replace(declared, tip_pitch=declared.tip_pitch - radius)
    config, zeta = nominal.sample(model, samples, np.random.default_rng(seed))
    found = []
    for block in _BLOCKS:
        values, _ = worst_errors(model, config, zeta, block, radius, sigma)
        largest = partial(_largest, model, block, radius, sigma)
        order = np.argsort(-values, kind="stable")
        for i in order[[rank for rank in START_RANKS if rank < samples]]:
            found.append(climb(largest, model, nominal, config[i], zeta[i])[1:])
    # A bad state for one block is tried for both.
    config, zeta = (np.array(states) for states in zip(*found, strict=True))
    nu1, nu2 = (safety_factor * float(np.max(
        worst_errors(model, config, zeta, block, radius, sigma)[0])) for block in _BLOCKS)
    return nu1, nu2


@dataclass(frozen=True)
class _VelocityProblem(SearchProblem):
    """The velocities of (1), for the second search."""

    sigma: float

    @property
    def channels(self) -> list[slice]:
        """Channels of ν₁ and ν₂."""
        return list(_BLOCKS)

    def values(self, x: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Returns ν − ν̄ (..., 6) of motions (..., 3(6+n)) and errors 𝔢."""
        pose, zeta, _ = np.split(x, 3, axis=-1)
        return velocity_deviation(self.model, self.config(pose), zeta, error[..., :6], self.sigma)


def second_velocities(model: ContactModel, declared: ConstraintSet, radius: float, sigma: float,
                       claims: tuple[float, float], seed: int) -> tuple[Estimate, ...]:
    """Returns the estimates of `velocity_radii`."""
    nominal = replace(declared, tip_pitch=declared.tip_pitch - radius)
    part = np.eye(2 * model.size)[:, :6], radius
    found = second_search(_VelocityProblem(model, nominal, [part], sigma), np.arange(2),
                          np.random.default_rng([seed, 1]))
    return tuple(Estimate(name, claim, float(second))
                 for name, claim, second in zip(("ν₁", "ν₂"), claims, found, strict=True))


def _largest(model: ContactModel, block: slice, radius: float, sigma: float, config: np.ndarray,
             zeta: np.ndarray) -> tuple[float, np.ndarray]:
    """Returns the largest norm over 𝔢 and its derivative by (𝔮̄, ζ̄), at a constant worst 𝔢."""
    value, error = worst_errors(model, config[None], zeta[None], block, radius, sigma)
    steps = DIFFERENCE * np.eye(2 * model.size)
    x = np.concatenate([config, zeta])
    moved_config, moved_zeta = np.split(np.concatenate([x + steps, x - steps]), 2, axis=1)
    errors = np.tile(error, (len(moved_config), 1))
    moved = velocity_deviation(model, moved_config, moved_zeta, errors, sigma)[:, block]
    norms = np.linalg.norm(moved, axis=1)
    plus, minus = np.split(norms, 2)
    return float(value[0]), (plus - minus) / (2.0 * DIFFERENCE)
