"""Tests of `uvms_drake.campaign.run`."""

from dataclasses import replace

import pytest

from uvms_drake.campaign.run import run_one
from uvms_drake.campaign.summary import (
    all_well,
    format_campaign,
    summarise_campaign,
    summarise_times,
)
from uvms_drake.command.main import main
from uvms_drake.common.errors import RunFailed

pytestmark = pytest.mark.long


def test_a_run_that_raises_is_a_result(campaign, monkeypatch):
    def breaks(scenario):
        raise ZeroDivisionError("of\nno use")

    monkeypatch.setattr("uvms_drake.campaign.run.simulate", breaks)
    run = run_one(campaign, 2)
    assert run["result"]["error"] == "ZeroDivisionError: of no use"
    assert run["result"]["index"] == 2
    summary = summarise_campaign(campaign, [run["result"]])
    assert summary["counts"]["exceptions"] == 1
    assert not all_well(summary)
    assert "exceptions: 1" in format_campaign(summary, summarise_times([run["wall"]]), "DIR")


def test_another_program_runs_nothing(campaign, reference, monkeypatch, capsys):
    with pytest.raises(RunFailed, match="this package is not as it was"):
        run_one(replace(campaign, source="0" * 64), 0)
    with pytest.raises(RunFailed, match="a version is not"):
        run_one(replace(campaign, versions={"drake": "0.1"}), 0)
    monkeypatch.setattr("uvms_drake.campaign.campaign.source_digest", lambda: "1" * 64)
    assert main(["campaign", "--output", str(reference), "--replay", "2"]) == 1
    assert capsys.readouterr().err.count("\n") == 1
