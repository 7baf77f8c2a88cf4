"""Campaigns that several test files look at."""

from pathlib import Path

import pytest
from support.campaigns import CLOSE, RUNS, SHORT, WALLS
from support.quick import FEW, search_less

from uvms_drake.campaign.campaign import Campaign, make_campaign
from uvms_drake.certificate.certify import certified_once
from uvms_drake.command.main import main
from uvms_drake.station.scenario.scenario import load_scenario


@pytest.fixture(scope="session")
def campaign() -> Campaign:
    scenario = load_scenario("girona500_ideal", ["duration=0.6", CLOSE[1]])
    return make_campaign(scenario, 3, None)


@pytest.fixture(scope="session")
def reference(tmp_path_factory) -> Path:
    """The folder of a campaign of one worker that nothing happened to."""
    folder = tmp_path_factory.mktemp("campaign") / "one"
    assert main([*SHORT, "--runs", str(RUNS), "--workers", "1", "--output", str(folder)]) == 0
    return folder


@pytest.fixture(scope="session")
def certified() -> Campaign:
    """Starts close to the wall, so that contact is made in 2 s; with fewer other surfaces."""
    scenario = load_scenario("girona500_ideal", ["duration=2.0", CLOSE[1], *FEW])
    with pytest.MonkeyPatch.context() as patch:
        search_less(patch)
        patch.setattr("uvms_drake.campaign.certified_surfaces.OTHER_WALLS", WALLS)
        certificate = certified_once(scenario)
        assert certificate.certified
        return make_campaign(scenario, 0, certificate, model_error=0.2)
