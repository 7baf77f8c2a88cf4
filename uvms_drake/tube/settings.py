"""Search effort and safety factor of the certificate; part of a scenario."""

from dataclasses import dataclass

import numpy as np

from uvms_drake.common.errors import require

MOST_SAMPLES = 1_000_000
"""Largest number of samples; a supremum that so many miss, more will miss too."""


@dataclass
class LinearLines:
    """Lines of |x − x_lin|, the distance of a run from its coupled linear loop."""

    tip: float = 0.001
    """Line of each coordinate of the tip [m]."""
    vehicle: float = 0.002
    """Line of each coordinate of the vehicle [m]."""
    attitude: float = 0.01
    """Line of each angle of the vehicle [rad]."""
    joints: float = 0.015
    """Line of each joint [rad, m]."""


@dataclass
class CertificateSettings:
    """Samples, seed and safety factor of the estimates."""

    constant_samples: int = 2000
    """States at which each constant is evaluated before the local searches."""
    tube_samples: int = 300
    """Nominal states from the worst of which the tube in velocities and inputs is searched for."""
    terminal_samples: int = 2000
    """States in which the terminal set is checked, for every radius tried."""
    safety_factor: float = 1.1
    """Factor of every estimated supremum."""
    seed: int = 0
    linear: LinearLines | None = None
    """Lines of |x − x_lin| that a certificate in probability counts; left out: it compares no run
    with its linear loop, which takes as long as the run."""


def check_settings(settings: CertificateSettings) -> None:
    """Raises `InvalidParameter` for the first setting that has no meaning."""
    for key in ("constant_samples", "tube_samples", "terminal_samples"):
        require(10 <= getattr(settings, key) <= MOST_SAMPLES, key, getattr(settings, key),
                f"from 10 to {MOST_SAMPLES}, which take hours and gigabytes")
    require(settings.safety_factor >= 1.0, "safety_factor", settings.safety_factor, "at least 1")
    require(settings.seed >= 0, "seed", settings.seed, "zero or positive")
    for key, line in ({} if settings.linear is None else vars(settings.linear)).items():
        require(0.0 < line < np.inf, f"linear.{key}", line, "positive")
