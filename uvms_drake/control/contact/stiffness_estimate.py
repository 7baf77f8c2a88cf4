"""How stiff a wall is and how it is inclined: an estimate by what the tip feels as it moves.

In the wall the static force is about φ(𝔭 + m) = φ(𝔭) + κ (n·m + 𝔱·m): κ its slope along n, 𝔱 ⊥ n
its inclination, ‖𝔱‖ ≤ α, see `SurfaceClass`. An extended Kalman filter follows φ at the tip, κ, and
𝔱 in two directions across n, z = (φ, κ, t₁, t₂), m the motion since its last step:

    φ ← φ + κ s,   s = n·m + 𝔱·m,      P ← A P Aᵀ + Q,   A = I + e_φ (0, s, κm₁, κm₂),
    F = φ + noise of deviation σ,      K = P e_φ/(P_φφ + σ²).

So what changes across n at one force is a wall that runs off, not one that is soft: on a slide
∂φ/∂κ = s is nearly zero, while ∂φ/∂𝔱 is not. What is not in this model is taken for noise: that φ
wanders with the time (damping, friction, a sensor that lags, a navigation that drifts), that κ
changes by parts of itself with the force, on a wall that hardens, and 𝔱 with the way across n, on
one that is curved.

*Steps count the way, not the time*: there is one when the tip has moved by ν/κ₊. By less than that
no force changes by more than ν, so a tip at rest learns and forgets nothing, whatever the noise of
its force and, below that length, of its position, which would make every wall look soft. For the
same reason κ is learned, and changes, only in steps that go deeper than aside, |s| ≥ ‖P_t m‖: on a
slide at one force, s is an error of the position, and 0.7 mm of it would make 900 N/m look like 320
within 0.6 m. That helps against errors that are slower than the slide; one that outruns it, white
noise of 0.3 mm on 30 mm/s, makes a wall look soft still. The front does not go by κ.

*A reading may be of another place*: of any where the tip was while the force may have been read (W,
see `front`). If it moved by w along n meanwhile, the reading is off by κw at most, for which κ̂w is
taken: half of it comes to σ as a deviation, all of it to what a reading may be off. Of a tip that
was deeper meanwhile, by more than ν/κ₊, it says nothing: one that swings, and is felt late, would
make every wall look soft.

*It begins with* κ = ½κ₊ ± ½κ₊ and 𝔱 = 0 ± ½α. What a press goes by is κ̂ = min(κ₊, κ + √P_κκ): κ₊ as
long as nothing is known, and more often above κ than below it, so that the force comes up to the
desired one from below (`target`). It begins anew, with 𝔱 as it is, at a reading that is off by more
than ν + 3√P_φφ, which noise alone cannot be: soft on hard, hard on soft.

*It is no bound*, and need be none: the front holds for every wall of the class whatever κ̂ is, and
the target is in no limit of a plan. What it costs to be wrong is in `target`: a press converges if
κ̂ is more than about half of κ. A wall that gets hard where it was believed to be soft may keep it
below that, as long as what is felt is within ν of what is believed: a swing of less than 2ν remains
then, and dies out slowly.
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.model.surface.surface_class import SurfaceClass

SCATTER = 1.0 / 3.0
"""Deviation σ of a reading over ν; a sensor's own is less."""
WANDER = 0.1
"""Deviation over ν of what comes to φ within a second, however it comes."""
HARDENING = 0.3
"""Deviation over κ of what comes to κ while the force changes by `memory`."""
BEND = 0.3
"""Way across n on which the inclination becomes another one [m]."""
SOFTEST = 0.02
"""Smallest κ over κ₊ that is believed in."""
STRANGE = 3.0
"""Deviations of φ beyond ν from which on a reading is no such wall's."""


class StiffnessEstimate(NamedTuple):
    """What is believed of a wall where the tip was at the last step; or of an array of walls."""

    mean: np.ndarray
    """z (..., 4) [N, N/m, 1, 1]; NaN: nothing was felt yet."""
    covariance: np.ndarray
    """P (..., 4, 4)."""
    at: np.ndarray
    """Where the tip was, in Σ_I (..., 3) [m]."""

    @property
    def state(self) -> np.ndarray:
        """(23,) of one wall."""
        return np.concatenate([self.mean, self.covariance.ravel(), self.at])

    @staticmethod
    def of(state: np.ndarray) -> "StiffnessEstimate":
        """Returns the parts of a state (23,)."""
        return StiffnessEstimate(state[:4], state[4:20].reshape(4, 4), state[20:])


NOTHING = StiffnessEstimate(np.full(4, np.nan), np.zeros((4, 4)), np.full(3, np.nan))
"""Nothing was felt yet."""


def _chosen(where: np.ndarray | np.bool, one: StiffnessEstimate, other: StiffnessEstimate) -> StiffnessEstimate:
    """Returns one of two beliefs for each wall (...)."""
    return StiffnessEstimate(*(np.where(np.reshape(where, (*np.shape(where), *ones)), a, b)
                    for ones, a, b in zip([(1,), (1, 1), (1,)], one, other, strict=True)))


def initial_estimate(surface: SurfaceClass, tip: np.ndarray, force: np.ndarray, noise: float) -> StiffnessEstimate:
    """Returns what is believed at the first reading of a contact.

    Args:
        surface: The class of walls.
        tip: Where the tip is, in Σ_I (..., 3) [m].
        force: F, along n (...) [N].
        noise: ν [N].
    """
    mean = np.stack(np.broadcast_arrays(force, 0.5 * surface.stiffness, 0.0, 0.0), axis=-1)
    deviations = np.array([noise, 0.5 * surface.stiffness, *[0.5 * surface.tilt] * 2])
    return StiffnessEstimate(mean, np.broadcast_to(np.diag(deviations**2), (*mean.shape, 4)),
                  np.broadcast_to(tip, (*mean.shape[:-1], 3)))


def _way(estimate: StiffnessEstimate, surface: SurfaceClass, tip: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns s (...) and the first row of A (..., 4), without s where κ is not learned."""
    motion = tip - estimate.at
    across = motion @ surface.axes[1:].T
    s = surface.depth(motion) + np.sum(estimate.mean[..., 2:] * across, axis=-1)
    row = np.empty(estimate.mean.shape)
    row[..., 0], row[..., 2:] = 1.0, estimate.mean[..., 1:2] * across
    row[..., 1] = np.where(np.abs(s) >= np.linalg.norm(across, axis=-1), s, 0.0)
    return s, row


def moved(estimate: StiffnessEstimate, surface: SurfaceClass, tip: np.ndarray, memory: float) -> StiffnessEstimate:
    """Returns what is believed where the tip is now, NaN of nothing.

    Args:
        estimate: What was believed where it was.
        surface: The class of walls.
        tip: Where the tip is (..., 3) [m].
        memory: Change of the force with which κ changes by `HARDENING` [N].
    """
    s, row = _way(estimate, surface, tip)
    kappa, mean = estimate.mean[..., 1], estimate.mean.copy()
    mean[..., 0] += kappa * s
    A = np.broadcast_to(np.eye(4), estimate.covariance.shape).copy()
    A[..., 0, :] = row
    P = A @ estimate.covariance @ np.swapaxes(A, -1, -2)
    # Each of κ, t₁, t₂ comes to be as unknown as at first, and no more.
    most = np.array([0.5 * surface.stiffness, *[0.5 * surface.tilt] * 2]) ** 2
    harder = (HARDENING * kappa) ** 2 * kappa * np.abs(row[..., 1]) / memory
    bent = surface.tilt**2 * surface.lateral(tip - estimate.at) / BEND
    grown = np.minimum(np.stack([harder, bent, bent], axis=-1), np.maximum(
        most - np.diagonal(P, axis1=-2, axis2=-1)[..., 1:], 0.0))
    grown = np.concatenate([np.zeros_like(s)[..., None], grown], axis=-1)
    return StiffnessEstimate(mean, P + grown[..., None] * np.eye(4), tip)


def unlike(estimate: StiffnessEstimate, surface: SurfaceClass, tip: np.ndarray, force: np.ndarray,
           noise: np.ndarray | float) -> np.ndarray:
    """Returns by how much a reading is above (> 0) or below what the wall's may be [N]; or 0.

    The arguments are those of `with_reading`.
    """
    s, row = _way(estimate, surface, tip)
    variance = np.sum((row[..., None, :] @ estimate.covariance)[..., 0, :] * row, axis=-1)
    off = force - estimate.mean[..., 0] - estimate.mean[..., 1] * s
    allowed = noise + STRANGE * np.sqrt(variance)
    return np.nan_to_num(np.maximum(off - allowed, 0.0) + np.minimum(off + allowed, 0.0))


def corrected(estimate: StiffnessEstimate, surface: SurfaceClass, force: np.ndarray,
              deviation: np.ndarray | float) -> StiffnessEstimate:
    """Returns what is believed after a reading at the same place; κ and 𝔱 those of the class.

    Args:
        estimate: What was believed.
        surface: The class of walls.
        force: F, along n (...) [N].
        deviation: σ (...) [N].
    """
    P = estimate.covariance
    gain = P[..., 0] / (P[..., 0, 0] + deviation**2)[..., None]
    mean = estimate.mean + gain * (force - estimate.mean[..., 0])[..., None]
    mean[..., 1] = np.clip(mean[..., 1], SOFTEST * surface.stiffness, surface.stiffness)
    size = np.linalg.norm(mean[..., 2:], axis=-1, keepdims=True)
    mean[..., 2:] *= surface.tilt / np.maximum(size, max(surface.tilt, 1e-9))
    return estimate._replace(mean=mean, covariance=P - gain[..., None] * P[..., None, 0, :])


def with_reading(estimate: StiffnessEstimate, surface: SurfaceClass, tip: np.ndarray, force: np.ndarray,
                 touched: np.ndarray | np.bool, noise: float, memory: float, period: float,
                 way: np.ndarray | float = 0.0) -> StiffnessEstimate:
    """Returns what is believed after one more reading.

    One without contact, where there should be one, leaves nothing; in front of the wall φ goes on
    below zero.

    Args:
        estimate: What was believed.
        surface: The class of walls.
        tip: Where the tip is (..., 3) [m].
        force: F, along n (...) [N].
        touched: Whether it is of a contact (...).
        noise: ν [N].
        memory: See `moved` [N].
        period: Time since the last reading [s].
        way: How much deeper the tip came while the force may have been read (...) [m]; inf: the
            reading says nothing.
    """
    enough, first = noise / surface.stiffness, np.isnan(estimate.mean[..., 0])
    if np.all(first & np.logical_not(touched)):
        return estimate
    covariance = estimate.covariance.copy()
    covariance[..., 0, 0] = np.minimum(
        covariance[..., 0, 0] + (WANDER * noise) ** 2 * period,
        np.maximum(covariance[..., 0, 0], noise**2))
    estimate = estimate._replace(covariance=covariance)
    late = slope(estimate, surface) * way
    off = unlike(estimate, surface, tip, force, noise + late)
    far = (np.linalg.norm(tip - estimate.at, axis=-1) >= enough) & touched
    after = estimate
    if np.any(far | (off != 0.0)):
        here, deviation = moved(estimate, surface, tip, memory), np.hypot(SCATTER * noise, 0.5 * late)
        after = _chosen(far, corrected(here, surface, force, deviation), estimate)
        # Another wall, as far as its stiffness goes: what is believed of 𝔱 stays.
        new = initial_estimate(surface, tip, force, noise)
        mean, P = new.mean.copy(), new.covariance.copy()
        mean[..., 2:], P[..., 2:, 2:] = here.mean[..., 2:], here.covariance[..., 2:, 2:]
        after = _chosen(off != 0.0, new._replace(mean=mean, covariance=P), after)
        after = _chosen(touched, after, _chosen(off < 0.0, NOTHING, estimate))
    if np.any(begins := first & touched):
        after = _chosen(begins, initial_estimate(surface, tip, force, noise), after)
    return after


def slope(estimate: StiffnessEstimate, surface: SurfaceClass) -> np.ndarray:
    """Returns κ̂ (...) [N/m], in (0, κ₊]."""
    above = estimate.mean[..., 1] + np.sqrt(estimate.covariance[..., 1, 1])
    return np.fmin(above, surface.stiffness)


def tilt(estimate: StiffnessEstimate, surface: SurfaceClass) -> np.ndarray:
    """Returns 𝔱 (..., 3) in Σ_I; zero as long as nothing was felt."""
    inclined: np.ndarray = np.nan_to_num(estimate.mean[..., 2:]) @ surface.axes[1:]
    return inclined


def surface_depth(estimate: StiffnessEstimate, surface: SurfaceClass, tip: np.ndarray) -> np.ndarray:
    """Returns x − φ/κ̂ (...) [m], where the wall begins at a place (..., 3); NaN: nothing felt."""
    motion = tip - estimate.at
    deep = estimate.mean[..., 0] / slope(estimate, surface) + np.sum(
        motion * (surface.direction + tilt(estimate, surface)), axis=-1)
    return surface.depth(tip) - deep
