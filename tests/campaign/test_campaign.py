"""Campaigns as a whole: their files, a replay, a continuation, and many runs within every bound."""

import json
import os
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from support.campaigns import RUNS, SHORT, refusal

import uvms_drake as uv
from uvms_drake.campaign.campaign import SETUP_FILE, make_campaign, read_setup
from uvms_drake.campaign.figures import CAMPAIGN_FIGURES, WALLS_FILE
from uvms_drake.campaign.harness import RUNS_FILE, runs
from uvms_drake.campaign.pool import local_pool
from uvms_drake.campaign.run import run_one
from uvms_drake.campaign.summary import all_well, summarise_campaign
from uvms_drake.certificate.certify import certified_once
from uvms_drake.command.drawn_runs import drawable, replayed
from uvms_drake.command.main import main
from uvms_drake.common.output import MANIFEST_FILE

pytestmark = pytest.mark.slow

MANY = int(os.environ.get("UVMS_DRAKE_RUNS", "4"))
"""Number of runs of the campaign with a certificate."""


def result_bytes(folder):
    return (folder / "campaign.json").read_bytes()


def test_all_files_are_there(reference):
    assert {path.name for path in reference.iterdir()} == {
        SETUP_FILE, RUNS_FILE, MANIFEST_FILE, "campaign.json", "timing.json", *CAMPAIGN_FIGURES,
        WALLS_FILE}
    data = json.loads(result_bytes(reference))
    assert [result["index"] for result in data["results"]] == list(range(RUNS))
    assert data["counts"]["exceptions"] == data["counts"]["exits_set"] == 0
    assert "seconds" not in result_bytes(reference).decode()
    timing = json.loads((reference / "timing.json").read_text())
    assert timing["seconds"]["median"] > 0.0
    assert 0.1 < timing["step_ms"]["median"] <= timing["worst_step_ms"]["max"]


@pytest.mark.long
def test_it_can_be_made_longer_by_other_workers_and_gives_the_same_bytes(
        reference, tmp_path, capsys):
    for number in (1, RUNS):
        capsys.readouterr()
        assert main([*SHORT, "--runs", str(number), "--workers", "2",
                     "--output", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert f"1 of {RUNS} runs are there already" in err
    assert out.splitlines()[-1] == (
        f"all limits kept, without a certificate; the force never settled in {RUNS} of {RUNS} runs")
    assert result_bytes(tmp_path) == result_bytes(reference)


@pytest.mark.long
def test_a_run_can_be_replayed_alone(reference, capsys, monkeypatch):
    result = json.loads(result_bytes(reference))["results"][2]
    record = replayed(reference, 2)
    assert abs(np.linalg.norm(record.force[-1, :3]) - result["desired_force"]) == pytest.approx(
        result["force_error"], rel=1e-12)
    assert main(["campaign", "--output", str(reference), "--replay", "2"]) == 0
    assert (reference / "run-2" / "scenario.yaml").is_file()
    assert (reference / "run-2" / "force.png").is_file()
    capsys.readouterr()
    monkeypatch.chdir(reference)  # There is no out/girona500_contact-campaign.
    for args in (["2"], ["2", "--output", str(reference / "run-2")],
                 [str(RUNS), "--output", str(reference)]):
        assert main(["campaign", "--replay", *args]) == 2
    assert capsys.readouterr().err.count("\n") == 3


def test_the_folder_of_another_campaign_is_refused_before_anything_is_certified(
        reference, tmp_path, capsys, monkeypatch):
    before = result_bytes(reference), (reference / RUNS_FILE).read_bytes()
    assert "another campaign" in refusal(capsys, "--seed", "4", "--output", str(reference))
    assert (result_bytes(reference), (reference / RUNS_FILE).read_bytes()) == before
    monkeypatch.setattr("uvms_drake.command.drawn_runs.certified_once",
                        lambda *_: pytest.fail("a certificate was begun"))
    certified = [arg for arg in SHORT if arg != "--uncertified"]
    assert main([*certified, "--output", str(reference)]) == 2
    assert "another campaign" in capsys.readouterr().err
    # One of another version, and runs whose setup is lost.
    setup = json.loads((reference / SETUP_FILE).read_text("utf-8"))
    (tmp_path / SETUP_FILE).write_text(json.dumps(setup | {"outside": False}), "utf-8")
    assert "setup.json of this version" in refusal(capsys, "--output", str(tmp_path))
    (tmp_path / SETUP_FILE).unlink()
    (tmp_path / RUNS_FILE).write_bytes(before[1])
    assert "unknown origin" in refusal(capsys, "--output", str(tmp_path))


def test_another_program_runs_nothing(campaign, reference, monkeypatch, capsys):
    with pytest.raises(uv.RunFailed, match="this package is not as it was"):
        run_one(replace(campaign, source="0" * 64), 0)
    with pytest.raises(uv.RunFailed, match="a version is not"):
        run_one(replace(campaign, versions=campaign.versions | {"numpy": "0.1"}), 0)
    assert "numpy" in campaign.versions  # The draws are its own.
    monkeypatch.setattr("uvms_drake.campaign.campaign.run_source", lambda: "1" * 64)
    assert main(["campaign", "--output", str(reference), "--replay", "2"]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert read_setup(reference).seed == 3


def test_without_a_bound_every_run_counts():
    """There is nothing that d̃ would have to cover."""
    campaign = make_campaign(uv.load_scenario("girona500_real_loop", ["duration=0.3"]), 3, None)
    result = run_one(campaign, 0)
    assert result["error"] is None
    assert result["inside"] and result["worst_disturbance"] is None
    assert 0.0 < abs(result["unknown"]["mass"]) <= 0.1 + 1e-12  # A corner is at the bound.
    assert 0.0 < result["unknown"]["current"] <= 0.1 + 1e-12
    counts = summarise_campaign(campaign, [result])["counts"]
    assert (counts["counted"], counts["not_covered"]) == (1, 0)


@pytest.mark.long
def test_many_runs_stay_within_every_bound(tmp_path):
    """The whole campaign has a hundred runs; these are of the declared tube, which is certified.

    They reach what the disturbance takes of its radius: the rest is for a sensor whose errors are
    all at their bounds at once, and opposed, which no draw is.
    """
    scenario = drawable(uv.load_scenario("girona500_contact"))
    campaign, parts = make_campaign(scenario, 0, None), certified_once(scenario).budget["position"]
    results = runs(range(MANY), partial(run_one, campaign), tmp_path, local_pool())
    summary = summarise_campaign(campaign, results)
    assert all_well(summary), summary["counts"]
    assert summary["counts"]["mpc_failures"] == 0
    assert summary["walls"]["touched"] == MANY
    least = parts["d"] / sum(parts.values())
    assert least < summary["distributions"]["ratio_set"]["max"] < 1.0
