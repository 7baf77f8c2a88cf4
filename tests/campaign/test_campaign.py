"""Campaigns as a whole: their files, a replay, and many runs within every bound."""

import json
import multiprocessing
import os
from copy import deepcopy
from functools import partial

import numpy as np
import pytest
from support.campaigns import RUNS, result_bytes

from uvms_drake.campaign.figures import CAMPAIGN_FIGURES
from uvms_drake.campaign.pool import local_pool, run_all
from uvms_drake.campaign.run import run_one
from uvms_drake.campaign.store import RUNS_FILE, SETUP_FILE, read_setup
from uvms_drake.campaign.summary import (
    all_well,
    summarise_campaign,
)
from uvms_drake.campaign.variation import vary
from uvms_drake.command.campaign.campaign import replayed
from uvms_drake.command.main import main
from uvms_drake.common.output import MANIFEST_FILE
from uvms_drake.report.summary import summarise
from uvms_drake.station.diagram import MONITOR_SLACK
from uvms_drake.station.simulation import simulate

pytestmark = pytest.mark.long

MANY = int(os.environ.get("UVMS_DRAKE_RUNS", "18"))
"""Number of runs of the campaign with certificates."""


def test_all_files_are_there(reference):
    assert {path.name for path in reference.iterdir()} == {
        SETUP_FILE, RUNS_FILE, MANIFEST_FILE, "campaign.json", "timing.json", *CAMPAIGN_FIGURES}
    data = json.loads(result_bytes(reference))
    assert [result["index"] for result in data["results"]] == list(range(RUNS))
    assert data["counts"]["exceptions"] == data["counts"]["exits_trajectory"] == 0
    assert "seconds" not in result_bytes(reference).decode()
    timing = json.loads((reference / "timing.json").read_text())
    assert timing["seconds"]["median"] > 0.0
    assert sum(timing["steps"]) == RUNS * 3  # 0.6 s, a plan every 0.2 s
    assert 0.1 < timing["step_ms"]["p50"] <= timing["step_ms"]["p99"]


def test_a_run_can_be_replayed_alone(reference, capsys, monkeypatch):
    result = json.loads(result_bytes(reference))["results"][2]
    record = replayed(reference, 2)
    assert np.linalg.norm(record.force[-1] - record.scenario.task.force) == pytest.approx(
        result["force_error"], rel=1e-12)
    assert read_setup(reference).seed == 3
    assert main(["campaign", "--output", str(reference), "--replay", "2"]) == 0
    assert (reference / "run-2" / "scenario.yaml").is_file()
    assert (reference / "run-2" / "force.png").is_file()
    capsys.readouterr()
    monkeypatch.chdir(reference)  # There is no out/girona500_contact-campaign.
    assert main(["campaign", "--replay", "2"]) == 2
    assert main(["campaign", "--replay", "2", "--output", str(reference / "run-2")]) == 2
    assert main(["campaign", "--replay", str(RUNS), "--output", str(reference)]) == 2
    assert capsys.readouterr().err.count("\n") == 3


def test_many_runs_stay_within_every_bound(certified):
    """The whole campaign has 20 s a run."""
    workers = min(2, multiprocessing.cpu_count())
    runs = run_all(partial(run_one, certified), range(MANY), local_pool(workers))
    results = [run["result"] for _, run in runs]
    summary = summarise_campaign(certified, results)
    assert len(results) == MANY
    assert all_well(summary), summary["counts"]
    assert summary["counts"]["mpc_failures"] == 0
    assert summary["counts"]["not_covered"] <= MANY // 20
    assert len(summary["by_fault"]) == 4
    unknown = summary["largest_unknown"].values()
    assert np.count_nonzero(list(unknown)) >= len(unknown) - 1  # A few of them in each run.
    worst = summary["distributions"]["ratio_trajectory"]
    assert 0.8 < worst["max"] < 1.0 + 2.0 * MONITOR_SLACK
    scenario = deepcopy(vary(certified, worst["worst"]).scenario)
    scenario.simulator.max_step_size = 0.005
    ratio = summarise(simulate(scenario))["tube"]["worst_ratio"]["trajectory"]
    assert 0.8 < ratio < 1.0005  # What was above one is the integrator's error.
