"""Distribution of a metric over the runs of a campaign."""

from collections.abc import Sequence
from typing import Any

import numpy as np


def distribution_of(values: Sequence[float | None], indices: Sequence[int], *,
                    small_is_bad: bool = False) -> dict[str, Any]:
    """Returns minimum, median, 95th percentile and maximum of a metric, and the worst run.

    If small is bad the percentile is the 5th, under the name `p5`.

    Args:
        values: Values of the runs; None where a run has none.
        indices: Numbers of the runs.
        small_is_bad: Whether the smallest value is the worst.
    """
    pairs = [pair for pair in zip(values, indices, strict=True) if pair[0] is not None]
    tail = "p5" if small_is_bad else "p95"
    if not pairs:
        return {"count": 0, "min": None, "median": None, tail: None, "max": None, "worst": None}
    known = np.array([value for value, _ in pairs], dtype=float)
    worst = int(np.argmin(known) if small_is_bad else np.argmax(known))
    return {"count": len(pairs), "min": float(known.min()), "median": float(np.median(known)),
            tail: float(np.percentile(known, 5.0 if small_is_bad else 95.0)),
            "max": float(known.max()), "worst": pairs[worst][1]}
