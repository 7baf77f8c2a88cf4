"""How much of a signal is left when what changes slowly is taken off."""

import numpy as np


def ripple(time: np.ndarray, signal: np.ndarray, rate: float) -> float:
    """Returns the least a ≥ 0 for which each component is slow but for at most a.

    A function is the sum of one with |ṡ| ≤ ρ and of one that is at most a iff
    |f(t) − f(s)| ≤ 2a + ρ|t − s| for all s, t: then the least majorant, max_s f(s) − ρ|t − s|, less
    a is one (McShane). So a is half of the largest rise of ±f(t) − ρt above its least value so far.

    Args:
        time: Instants (T,), ascending [s].
        signal: f (T, m).
        rate: ρ.
    """
    both = np.concatenate([signal, -signal], axis=1) - rate * time[:, None]
    return 0.5 * float(np.max(both - np.minimum.accumulate(both, axis=0)))
