"""Certificates from fewer searches, for tests that are about what is done with them."""

import pytest

FEW = ["certificate.constant_samples=50", "certificate.tube_samples=50",
       "certificate.terminal_samples=50"]
"""Settings that belong to it: what is cached of a full search is under another key."""


def search_less(patch: pytest.MonkeyPatch) -> None:
    """Starts one local search per constant, and those of the terminal set that decide most."""
    patch.setattr("uvms_drake.tube.constants.START_RANKS", (0,))
    patch.setattr("uvms_drake.tube.kinematic.START_RANKS", (0,))
    patch.setattr("uvms_drake.tube.terminal_set.STARTS", 1)
    patch.setattr("uvms_drake.tube.terminal_set.NEAR", 0.0)
