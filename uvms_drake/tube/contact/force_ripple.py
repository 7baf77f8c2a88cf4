"""Ripple of a signal: its part beyond a slow one."""

import numpy as np


def ripple(time: np.ndarray, signal: np.ndarray, rate: float) -> float:
    """Returns the least a ≥ 0 with ‖f(t) − f(s)‖ ≤ 2a + ρ|t − s| for all instants s, t.

    Of one component it is the least amplitude in addition to a function with ‖ṡ‖ ≤ ρ, else a lower
    bound of that. Proof: tube/contact/theory.md#ripple-and-slow-part.

    Args:
        time: Instants (T,), ascending [s].
        signal: f (T, m).
        rate: ρ.
    """
    rises = (np.linalg.norm(signal[i:] - signal[i], axis=1) - rate * (time[i:] - time[i])
             for i in range(len(time)))
    return 0.5 * max((float(np.max(rise)) for rise in rises), default=0.0)
