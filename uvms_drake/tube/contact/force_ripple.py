"""How much of a signal is left when what changes slowly is taken off."""

import numpy as np


def ripple(time: np.ndarray, signal: np.ndarray, rate: float) -> float:
    """Returns the least a ≥ 0 with ‖f(t) − f(s)‖ ≤ 2a + ρ|t − s| for all instants s, t.

    The sum of a function with ‖ṡ‖ ≤ ρ and of one that is at most a has no larger ripple than a. Of
    one component the converse holds, too: the least majorant, max_s f(s) − ρ|t − s|, less a is a
    slow part (McShane).

    Args:
        time: Instants (T,), ascending [s].
        signal: f (T, m).
        rate: ρ.
    """
    rises = (np.linalg.norm(signal[i:] - signal[i], axis=1) - rate * (time[i:] - time[i])
             for i in range(len(time)))
    return 0.5 * max((float(np.max(rise)) for rise in rises), default=0.0)
