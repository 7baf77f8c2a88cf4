"""Extended Kalman filter of the stiffness and inclination of a wall.

The static force is about φ(𝔭 + m) = φ(𝔭) + κ (n·m + 𝔱·m): κ its slope along n [N/m], 𝔱 ⊥ n the
inclination, ‖𝔱‖ ≤ α, see `SurfaceClass`. For z = (φ, κ, t₁, t₂) and a displacement m of the tip [m]

    φ ← φ + κ s,   s = n·m + 𝔱·m,      P ← A P Aᵀ + Q,   A = I + e_φ (0, s, κm₁, κm₂),
    F = φ + noise of deviation σ,      K = P e_φ/(P_φφ + σ²).

There is a step when the tip has moved by ν/κ₊, and κ is learned only in steps with |s| ≥ ‖P_t m‖.
The controller uses κ̂ = min(κ₊, κ + √P_κκ): a press overshoots by a stiffness that is too small.
It is no bound, and need be none: the safe region holds for
every wall of the class. control/contact/theory.md#estimate-of-stiffness-and-inclination.
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.model.surface.surface_class import SurfaceClass

SCATTER = 1.0 / 3.0
"""Deviation σ of a reading over ν; a sensor's own is less."""
WANDER = 0.1
"""Standard deviation over ν of the drift of φ within a second."""
HARDENING = 0.3
"""Standard deviation over κ of its change while the force changes by `memory`."""
BEND = 0.3
"""Tangential path on which the inclination decorrelates [m]."""
SOFTEST = 0.02
"""Smallest κ over κ₊ of an estimate."""
STRANGE = 3.0
"""Standard deviations of φ beyond ν from which on a reading is rejected."""


class StiffnessEstimate(NamedTuple):
    """Estimate of a wall at the last step's place; or of an array of walls."""

    mean: np.ndarray
    """z (..., 4) [N, N/m, 1, 1]; NaN before the first contact."""
    covariance: np.ndarray
    """P (..., 4, 4)."""
    at: np.ndarray
    """Position of the tip in Σ_I (..., 3) [m]."""

    @property
    def state(self) -> np.ndarray:
        """(23,) of one wall."""
        return np.concatenate([self.mean, self.covariance.ravel(), self.at])

    @staticmethod
    def of(state: np.ndarray) -> "StiffnessEstimate":
        """Returns the parts of a state (23,)."""
        return StiffnessEstimate(state[:4], state[4:20].reshape(4, 4), state[20:])


_THREE = np.eye(3)
NO_ESTIMATE = StiffnessEstimate(np.full(4, np.nan), np.zeros((4, 4)), np.full(3, np.nan))
"""Estimate before the first contact."""


def _chosen(where: np.ndarray | np.bool, one: StiffnessEstimate, other: StiffnessEstimate
            ) -> StiffnessEstimate:
    """Returns one of two estimates for each wall (...)."""
    if np.ndim(where) == 0:
        return one if where else other
    return StiffnessEstimate(*(
        np.where(np.reshape(where, (*np.shape(where), *ones)), a, b)
        for ones, a, b in zip([(1,), (1, 1), (1,)], one, other, strict=True)))


def initial_estimate(surface: SurfaceClass, tip: np.ndarray, force: np.ndarray, noise: float
                     ) -> StiffnessEstimate:
    """Returns the estimate at the first reading of a contact.

    Args:
        surface: The class of walls.
        tip: Position of the tip, in Σ_I (..., 3) [m].
        force: F, along n (...) [N].
        noise: ν [N].
    """
    mean = np.stack(np.broadcast_arrays(force, 0.5 * surface.stiffness, 0.0, 0.0), axis=-1)
    deviations = np.array([noise, 0.5 * surface.stiffness, *[0.5 * surface.tilt] * 2])
    return StiffnessEstimate(mean, np.broadcast_to(np.diag(deviations**2), (*mean.shape, 4)),
                             np.broadcast_to(tip, (*mean.shape[:-1], 3)))


def _displacement(estimate: StiffnessEstimate, surface: SurfaceClass, tip: np.ndarray
                  ) -> tuple[np.ndarray, np.ndarray]:
    """Returns s (...) and the first row of A (..., 4), without s where κ is not updated."""
    motion = tip - estimate.at
    across = surface.across(motion)
    s = surface.depth(motion) + (estimate.mean[..., 2:] * across).sum(axis=-1)
    row = np.empty(estimate.mean.shape)
    row[..., 0], row[..., 2:] = 1.0, estimate.mean[..., 1:2] * across
    row[..., 1] = np.where(np.abs(s) >= np.sqrt((across * across).sum(axis=-1)), s, 0.0)
    return s, row


def predicted(estimate: StiffnessEstimate, surface: SurfaceClass, tip: np.ndarray, memory: float
              ) -> StiffnessEstimate:
    """Returns the prediction at the tip's present place; NaN without an estimate.

    Args:
        estimate: Estimate at the last step.
        surface: The class of walls.
        tip: Where the tip is (..., 3) [m].
        memory: Change of the force with which κ changes by `HARDENING` [N].
    """
    s, row = _displacement(estimate, surface, tip)
    kappa, mean = estimate.mean[..., 1], estimate.mean.copy()
    mean[..., 0] += kappa * s
    A = np.zeros(estimate.covariance.shape)
    A[..., 0, :] = row
    A[..., 1:, 1:] = _THREE
    P = A @ estimate.covariance @ np.swapaxes(A, -1, -2)
    # Each of κ, t₁, t₂ comes to be as unknown as at first, and no more.
    diagonal = np.einsum("...ii->...i", P)[..., 1:]  # A view.
    most = np.array([0.5 * surface.stiffness, *[0.5 * surface.tilt] * 2]) ** 2
    grown = np.empty(diagonal.shape)
    grown[..., 0] = (HARDENING * kappa) ** 2 * kappa * np.abs(row[..., 1]) / memory
    bent = surface.tilt**2 * surface.lateral(tip - estimate.at) / BEND
    grown[..., 1:] = bent[..., None]
    diagonal += np.minimum(grown, np.maximum(most - diagonal, 0.0))
    return StiffnessEstimate(mean, P, tip)


def unlike(estimate: StiffnessEstimate, surface: SurfaceClass, tip: np.ndarray, force: np.ndarray,
           noise: np.ndarray | float) -> np.ndarray:
    """Returns the excess [N] of a reading above (> 0) or below those of the estimated wall, or 0.

    The arguments are those of `with_reading`.
    """
    s, row = _displacement(estimate, surface, tip)
    variance = ((row[..., None, :] @ estimate.covariance)[..., 0, :] * row).sum(axis=-1)
    off = force - estimate.mean[..., 0] - estimate.mean[..., 1] * s
    allowed = noise + STRANGE * np.sqrt(variance)
    excess = np.maximum(off - allowed, 0.0) + np.minimum(off + allowed, 0.0)
    return np.where(np.isnan(excess), 0.0, excess)


def corrected(estimate: StiffnessEstimate, surface: SurfaceClass, force: np.ndarray,
              deviation: np.ndarray | float) -> StiffnessEstimate:
    """Returns the estimate corrected by a reading at its place, with κ and 𝔱 of the class.

    Args:
        estimate: Estimate before.
        surface: The class of walls.
        force: F, along n (...) [N].
        deviation: σ (...) [N].
    """
    P = estimate.covariance
    gain = P[..., 0] / (P[..., 0, 0] + deviation**2)[..., None]
    mean = estimate.mean + gain * (force - estimate.mean[..., 0])[..., None]
    mean[..., 1] = np.minimum(
        np.maximum(mean[..., 1], SOFTEST * surface.stiffness), surface.stiffness)
    size = np.sqrt((mean[..., 2:] ** 2).sum(axis=-1, keepdims=True))
    mean[..., 2:] *= surface.tilt / np.maximum(size, max(surface.tilt, 1e-9))
    return estimate._replace(mean=mean, covariance=P - gain[..., None] * P[..., None, 0, :])


def with_reading(estimate: StiffnessEstimate, surface: SurfaceClass, tip: np.ndarray,
                 force: np.ndarray, touched: np.ndarray | np.bool, noise: float, memory: float,
                 period: float, advance: np.ndarray | float = 0.0) -> StiffnessEstimate:
    """Returns the estimate after one more reading.

    A reading without contact, where there should be one, resets it; off the wall φ goes on below
    zero.

    Args:
        estimate: Estimate before.
        surface: The class of walls.
        tip: Where the tip is (..., 3) [m].
        force: F, along n (...) [N].
        touched: Whether the reading is of a contact (...).
        noise: ν [N].
        memory: See `predicted` [N].
        period: Time since the last reading [s].
        advance: Advance of the tip along n within the age of the reading (...) [m]; inf: a reading
            that is not used.
    """
    enough, first = noise / surface.stiffness, np.isnan(estimate.mean[..., 0])
    if (first & np.logical_not(touched)).all():
        return estimate
    covariance = estimate.covariance.copy()
    covariance[..., 0, 0] = np.minimum(
        covariance[..., 0, 0] + (WANDER * noise) ** 2 * period,
        np.maximum(covariance[..., 0, 0], noise**2))
    estimate = estimate._replace(covariance=covariance)
    age_error = stiffness_used(estimate, surface) * advance
    off = unlike(estimate, surface, tip, force, noise + age_error)
    motion = tip - estimate.at
    far = (np.sqrt((motion * motion).sum(axis=-1)) >= enough) & touched
    after = estimate
    if (far | (off != 0.0)).any():
        here = predicted(estimate, surface, tip, memory)
        deviation = np.hypot(SCATTER * noise, 0.5 * age_error)
        after = _chosen(far, corrected(here, surface, force, deviation), estimate)
        if (rejected := off != 0.0).any():  # Stiffness and force begin anew; 𝔱 stays.
            new = initial_estimate(surface, tip, force, noise)
            mean, P = new.mean.copy(), new.covariance.copy()
            mean[..., 2:], P[..., 2:, 2:] = here.mean[..., 2:], here.covariance[..., 2:, 2:]
            after = _chosen(rejected, new._replace(mean=mean, covariance=P), after)
        after = _chosen(touched, after, _chosen(off < 0.0, NO_ESTIMATE, estimate))
    if (begins := first & touched).any():
        after = _chosen(begins, initial_estimate(surface, tip, force, noise), after)
    return after


def stiffness_std(estimate: StiffnessEstimate) -> np.ndarray:
    """Returns the standard deviation √P_κκ of the estimate (...) [N/m]; NaN before contact."""
    std: np.ndarray = np.where(
        np.isnan(estimate.mean[..., 1]), np.nan, np.sqrt(estimate.covariance[..., 1, 1]))
    return std


def stiffness_used(estimate: StiffnessEstimate, surface: SurfaceClass) -> np.ndarray:
    """Returns κ̂ = min(κ₊, κ + √P_κκ) (...) [N/m], which the controller uses; κ₊ before contact."""
    return np.fmin(estimate.mean[..., 1] + stiffness_std(estimate), surface.stiffness)


def tilt(estimate: StiffnessEstimate, surface: SurfaceClass) -> np.ndarray:
    """Returns 𝔱 (..., 3) in Σ_I; zero before the first contact."""
    tangential = estimate.mean[..., 2:]
    inclined: np.ndarray = np.where(
        np.isnan(tangential), 0.0, tangential) @ surface.tangents.T
    return inclined


def surface_depth(estimate: StiffnessEstimate, surface: SurfaceClass, tip: np.ndarray
                  ) -> np.ndarray:
    """Returns x − φ/κ (...) [m], the depth of the wall at a place (..., 3); NaN before contact."""
    motion = tip - estimate.at
    deep = estimate.mean[..., 0] / estimate.mean[..., 1] + (
        motion * (surface.direction + tilt(estimate, surface))).sum(axis=-1)
    depth: np.ndarray = surface.depth(tip) - deep
    return depth
