"""Coulomb friction without a jump, as in Drake's continuous contact, for one coefficient μ.

The friction on a tip that slides at the speed v is μ ρ(v/v_s) times the normal force, where
ρ(x) = x³(10 − 15x + 6x²) for x < 1 and 1 beyond: twice continuously differentiable. It implies
creep: a sticking tip moves at up to v_s, since ρ grows from zero at rest.
"""

import numpy as np

STEEPEST = 1.875
"""Largest ρ′, at x = 1/2."""


def slip_factor(slip: np.ndarray) -> np.ndarray:
    """Returns ρ(x)/x (...) at the slip x = v/v_s ≥ 0 (...); zero at rest."""
    if slip.size == 1 and slip.dtype.kind == "f":
        return slip**2 * (10.0 + slip * (6.0 * slip - 15.0)) if slip < 1.0 else 1.0 / slip
    fast = np.where(slip.real < 1.0, 1.0, slip)
    return np.where(slip.real < 1.0, slip**2 * (10.0 + slip * (6.0 * slip - 15.0)), 1.0 / fast)


def coulomb(velocity: np.ndarray, friction: float, creep: float) -> np.ndarray:
    """Returns the force per normal force (..., 3) of a tip on the surface along which it slides.

    Args:
        velocity: Tangential velocity of the tip (..., 3) [m/s].
        friction: Coefficient μ.
        creep: Creep velocity v_s [m/s].
    """
    slip = np.sqrt(np.add.reduce(velocity * velocity, axis=-1, keepdims=True)) / creep
    return friction / creep * slip_factor(slip) * velocity
