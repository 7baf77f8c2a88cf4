"""Impulse responses by partial fractions."""

import numpy as np


def impulse(numerator, denominator, t: np.ndarray) -> np.ndarray:
    """Returns the impulse response at the times t of a transfer function of different poles."""
    poles = np.roots(denominator)
    parts = np.polyval(numerator, poles) / np.polyval(np.polyder(denominator), poles)
    return (np.exp(np.multiply.outer(t, poles)) @ parts).real


def largest(numerator, denominator) -> float:
    """Returns ∫|g| of the impulse response."""
    t = np.linspace(0.0, 25.0 / np.min(-np.roots(denominator).real), 50_001)
    return float(np.trapezoid(np.abs(impulse(numerator, denominator, t)), t))
