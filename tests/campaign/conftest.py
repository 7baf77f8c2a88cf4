"""Campaigns that several test files look at."""

from pathlib import Path

import pytest
from support.campaigns import RUNS, SHORT

import uvms_drake as uv
from uvms_drake.campaign.campaign import Campaign, make_campaign
from uvms_drake.campaign.run import run_one
from uvms_drake.command.main import main


@pytest.fixture(scope="session")
def campaign() -> Campaign:
    return make_campaign(uv.load_scenario("girona500_contact", ["duration=0.6"]), 3, None)


@pytest.fixture(scope="session")
def result(campaign) -> dict:
    """The result of its first run, which must not be changed."""
    return run_one(campaign, 0)


@pytest.fixture(scope="session")
def reference(tmp_path_factory) -> Path:
    """The folder of a campaign of one worker that nothing happened to."""
    folder = tmp_path_factory.mktemp("campaign") / "one"
    assert main([*SHORT, "--runs", str(RUNS), "--workers", "1", "--output", str(folder)]) == 0
    return folder
