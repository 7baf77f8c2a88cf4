"""Runs of a campaign in a folder: checks of the options, missing runs, results."""

import argparse
import json
import sys
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, TextIO

from uvms_drake.campaign.campaign import Campaign
from uvms_drake.campaign.figures import CAMPAIGN_FIGURES, WALLS_FILE, make_campaign_figures
from uvms_drake.campaign.pool import Pool, run_all
from uvms_drake.campaign.run import run_one
from uvms_drake.campaign.store import RunLog
from uvms_drake.certificate.certificate import CERTIFICATE_FILE, Certificate, write_certificate
from uvms_drake.command.progress import Bar
from uvms_drake.command.workers import check_workers
from uvms_drake.common.errors import require
from uvms_drake.common.output import output_folder
from uvms_drake.station.problem import check_inputs
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.step_size import with_step

CAMPAIGN_FILE, TIMES_FILE = "campaign.json", "timing.json"
OWN_FILES = (CAMPAIGN_FILE, TIMES_FILE, CERTIFICATE_FILE, *CAMPAIGN_FIGURES, WALLS_FILE)


def check_draws_and_workers(args: argparse.Namespace) -> None:
    """Raises `InvalidParameter` for a number of runs, a seed or workers that cannot be."""
    require(args.runs >= 1, "--runs", args.runs, "at least 1")
    require(args.seed >= 0, "--seed", args.seed, "zero or positive")
    for override in args.overrides:
        require(override.partition("=")[0] != "seed", "--set", override,
                "--seed N: a campaign has a seed of its own")
    check_workers(args)


def drawable(scenario: Scenario) -> Scenario:
    """Returns the scenario with its integration step; raises if it cannot be drawn or repeated."""
    require(not scenario.faults, "faults", [type(fault).__name__ for fault in scenario.faults],
            "left out: a campaign draws them")
    require(scenario.mpc.deadline is None, "mpc.deadline", scenario.mpc.deadline,
            "left out: no run could be repeated")
    return with_step(scenario, check_inputs(scenario))


def complete(campaign: Campaign, runs: int, log: RunLog, pool: Pool, stream: TextIO) -> None:
    """Computes the runs below `runs` that a log does not have."""
    missing = [index for index in range(runs) if index not in log.runs]
    if len(missing) < runs:
        print(f"{runs - len(missing)} of {runs} runs are there already", file=stream)
    with closing(Bar("running", stream)) as progress:
        for done, (_, run) in enumerate(run_all(partial(run_one, campaign), missing, pool), 1):
            log.append(run)
            progress(f"{done} of {len(missing)} runs", done / len(missing))


def interrupted(log: RunLog, output: Path) -> int:
    """Says how many runs an interrupted command has kept; returns its exit status."""
    print(f"\nuvms-drake: interrupted, {len(log.runs)} runs are in {output}; the same "
          "command goes on with the others", file=sys.stderr)
    return 130


def write_results(output: Path, summary: dict[str, Any], times: dict[str, Any],
                  certificate: Certificate | None) -> list[str]:
    """Writes the files of a completed campaign, all together, and returns their names."""
    with output_folder(output, OWN_FILES, replaces=True) as own:
        folder = own.folder
        for name, data in ((CAMPAIGN_FILE, summary), (TIMES_FILE, times)):
            text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False)
            (folder / name).write_text(text + "\n", encoding="utf-8")
        if certificate is not None:
            write_certificate(certificate, folder)
        make_campaign_figures(summary, times, folder)
    return own.kept
