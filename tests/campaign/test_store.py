"""Tests of `uvms_drake.campaign.store`."""

import json

import pytest
from support.campaigns import RUNS, SHORT, refusal, result_bytes

from uvms_drake.campaign.campaign import make_campaign
from uvms_drake.campaign.store import RUNS_FILE, run_log
from uvms_drake.command.campaign.runs import drawable
from uvms_drake.command.main import main

pytestmark = pytest.mark.long


def test_a_campaign_goes_on_and_can_be_made_longer(reference, tmp_path, capsys):
    """Also if the last line was cut off and another one is damaged."""
    assert main([*SHORT, "--runs", str(RUNS - 1), "--workers", "1", "--output", str(tmp_path)]) == 0
    file = tmp_path / RUNS_FILE
    first, *rest = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b'{"result": 7}\n' + b"".join(rest) + first[: len(first) // 2])
    capsys.readouterr()
    assert main([*SHORT, "--runs", str(RUNS), "--workers", "1", "--output", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert f"{RUNS - 2} of {RUNS} runs are there already" in err
    *_, files, verdict = out.splitlines()
    assert files.startswith(f"written to {tmp_path}: campaign.json, ")
    assert RUNS_FILE in files
    never = json.loads(result_bytes(tmp_path))["counts"]["never_settled"]
    assert never > 0
    assert verdict == f"all guarantees kept; the force never settled in {never} of {RUNS} runs"
    assert result_bytes(tmp_path) == result_bytes(reference)
    assert len(file.read_bytes().splitlines()) == RUNS + 1  # no run is there twice


def test_the_folder_of_another_campaign_is_refused(reference, capsys):
    before = result_bytes(reference), (reference / RUNS_FILE).read_bytes()
    err = refusal(capsys, "--seed", "4", "--output", str(reference))
    assert "another campaign" in err
    assert (result_bytes(reference), (reference / RUNS_FILE).read_bytes()) == before


def test_the_folder_is_looked_at_before_anything_is_certified(reference, capsys, monkeypatch):
    def certify(*args, **kwargs):
        pytest.fail("a certificate was begun")

    monkeypatch.setattr("uvms_drake.command.campaign.campaign.certified_once", certify)
    assert main(["campaign", "--seed", "3", "--output", str(reference)]) == 2
    assert "another campaign" in capsys.readouterr().err


def test_a_folder_in_use_is_refused(campaign, tmp_path, capsys):
    stepped = make_campaign(drawable(campaign.base), campaign.seed, None)  # As of the command.
    with run_log(tmp_path, stepped):
        assert "no other process" in refusal(
            capsys, "--model-error", "0", "--output", str(tmp_path))
