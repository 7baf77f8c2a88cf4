"""Readings that a working sensor of force and torque repeats by chance.

Noise moves every reading, and the resolution rounds it: whatever the force, a component repeats the
last reading with a probability of at most that of the most probable interval of the noise of the
length of the resolution. All six repeat with at most the product, so a long enough run of equal
readings is that of a frozen sensor: sensing/theory.md#detection-of-a-frozen-force.
"""

import math

import numpy as np

CHANCE = 1e-9
"""Largest probability, per reading, that a working sensor makes the run of a frozen one."""


def repeat_probability(sigma: np.ndarray, multiple: float, resolution: np.ndarray) -> float:
    """Returns a bound p of the probability that a reading repeats the last one in all components.

    With noise νᵢ, Gaussian and cut to ± mσᵢ, and Φ the normal distribution, p = ∏ pᵢ,

        pᵢ = max(P(|νᵢ| ≤ rᵢ/2), P(νᵢ ≥ mσᵢ − rᵢ)) = max(erf(rᵢ/(2√2 σᵢ)), Φ(rᵢ/σᵢ − m)),

    and 1 for rᵢ ≥ 2mσᵢ. It is 1 for a sensor without noise.

    Args:
        sigma: σ (6,) [N, N m].
        multiple: m.
        resolution: r (6,) [N, N m].
    """
    p = 1.0
    for s, r in zip(np.asarray(sigma, dtype=float), np.asarray(resolution, dtype=float),
                    strict=True):
        if s > 0.0 and r < 2.0 * multiple * s:
            middle = math.erf(r / (2.0 * math.sqrt(2.0) * s))
            end = 0.5 * math.erfc((multiple - r / s) / math.sqrt(2.0))
            p *= max(middle, end)
    return p


def chance_of_run(repeated: float, run: int) -> float:
    """Returns the bound 2p^(N − 1) of the probability that a reading ends a run of N equal ones.

    Twice, since they are compared in two frames.
    """
    return float(2.0 * repeated ** (run - 1))


def run_of_frozen(repeated: float) -> int:
    """Returns N, the least number of equal readings in a row whose `chance_of_run` is `CHANCE`.

    0 if there is none: then a frozen sensor cannot be told from a working one.

    Args:
        repeated: p, see `repeat_probability`.
    """
    if repeated >= 1.0:
        return 0
    ratio = math.log(0.5 * CHANCE) / math.log(max(repeated, 0.5 * CHANCE))
    return 1 + math.ceil(ratio - 1e-12)
