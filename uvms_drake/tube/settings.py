"""Search effort and safety factor of the certificate; part of a scenario."""

from dataclasses import dataclass

from uvms_drake.common.errors import require

MOST_SAMPLES = 1_000_000
"""Largest number of samples; a supremum that so many miss, more will miss too."""


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


def check_settings(settings: CertificateSettings) -> None:
    """Raises `InvalidParameter` for the first setting that has no meaning."""
    for key in ("constant_samples", "tube_samples", "terminal_samples"):
        require(10 <= getattr(settings, key) <= MOST_SAMPLES, key, getattr(settings, key),
                f"from 10 to {MOST_SAMPLES}, which take hours and gigabytes")
    require(settings.safety_factor >= 1.0, "safety_factor", settings.safety_factor, "at least 1")
    require(settings.seed >= 0, "seed", settings.seed, "zero or positive")
