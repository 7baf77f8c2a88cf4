"""Certificates from fewer searches, for tests of the code that uses them."""

import pytest

from uvms_drake.certificate import certify  # noqa: F401  it has its constants before a patch
from uvms_drake.common.schema import parse_yaml
from uvms_drake.station.scenario import scenario

SETTINGS = dict.fromkeys(("constant_samples", "tube_samples", "terminal_samples"), 50)
FEW = [f"certificate.{name}={count}" for name, count in SETTINGS.items()]
"""Settings that belong to it: what is cached of a full search is under another key."""


def search_less(patch: pytest.MonkeyPatch) -> None:
    """Climbs for suprema in a step, refines the terminal set little, and tries no proof.

    Of a second search that hardly searches no power is asked.

    A scenario has to say `FEW`, too.
    """
    patch.setattr("uvms_drake.tube.search.ascent.STEPS", 1)
    patch.setattr("uvms_drake.tube.search.ascent.LEADERS", 2)
    patch.setattr("uvms_drake.tube.constants.LEADERS", 2)
    patch.setattr("uvms_drake.tube.search.second_search.STEPS", 0)
    patch.setattr("uvms_drake.tube.search.second_search.SWEEPS", 0)
    patch.setattr("uvms_drake.tube.estimates.LEAST_SHARE", 0.0)
    patch.setattr("uvms_drake.tube.contact.sensor_gains_proof.MOST_WORK", 0)
    patch.setattr("uvms_drake.tube.terminal_set.STARTS", 1)
    patch.setattr("uvms_drake.tube.terminal_set.NEAR", 0.0)


def few_in_all_files(patch: pytest.MonkeyPatch) -> None:
    """Lets `certify` search less, and every scenario file say `FEW`."""
    search_less(patch)
    patch.setattr(scenario, "parse_yaml", lambda text: parse_yaml(text) | {"certificate": SETTINGS})
