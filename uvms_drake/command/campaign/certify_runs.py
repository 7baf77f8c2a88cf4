"""The option --runs of `certify`: a certificate in probability, from runs that are drawn."""

import argparse
import json
import os
import sys
from pathlib import Path

from uvms_drake.campaign.campaign import make_campaign
from uvms_drake.campaign.probability.failures import certificate_in_probability
from uvms_drake.campaign.store import RunLog, require_same, run_log
from uvms_drake.campaign.summary import format_campaign, summarise_campaign, summarise_times
from uvms_drake.campaign.variation import vary
from uvms_drake.certificate.certificate import (
    CERTIFICATE_FILE,
    cache_key,
    to_data,
    write_certificate,
)
from uvms_drake.certificate.text import format_probability
from uvms_drake.command.campaign.runs import (
    check_draws_and_workers,
    complete,
    drawable,
    interrupted,
    write_results,
)
from uvms_drake.command.certificates import note
from uvms_drake.command.files import BROKEN
from uvms_drake.command.progress import stream_of
from uvms_drake.command.workers import pool_of
from uvms_drake.common.cache import store
from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.common.output import output_folder
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.scenario.scenario_file import reported_in, scenario_source, set_options

STORE = "runs"
"""Folder of the runs, a campaign, inside of the certificate's."""
NUMBER_FILE = "number.json"
"""File in it with the number of runs, chosen before the first."""


def certify_by_runs(args: argparse.Namespace, replaced: list[str]) -> int:
    """Computes the missing runs, prints and writes the certificate; returns 3 if a run failed.

    The number of runs is that of the first command in the folder, so that it is not chosen by their
    outcome: all of them count where fewer are asked for, and more need another folder.

    Args:
        args: Arguments of `certify`.
        replaced: Names of the files of a former `certify` that are replaced or deleted.
    """
    check_draws_and_workers(args)
    require(0.5 <= args.confidence < 1.0, "--confidence", args.confidence,
            "at least 0.5 and below 1")
    scenario = load_scenario(args.scenario, args.overrides)
    path = args.output if args.output is not None else Path("out") / scenario.name
    folder, pool = path / STORE, pool_of(args)
    with reported_in(scenario_source(args.scenario, set_options(args.overrides))):
        campaign = make_campaign(drawable(scenario), args.seed, None)
        require_same(folder, campaign, certified=False)
        note(scenario)
        vary(campaign, 0)
    # The runs, stored like those of any campaign.
    with run_log(folder, campaign) as log:
        runs = _number_of_runs(folder, args.runs, log)
        try:
            complete(campaign, runs, log, pool, stream_of(args))
        except KeyboardInterrupt:
            return interrupted(log, folder)
        found = [log.runs[index] for index in range(runs)]
        results = [run["result"] for run in found]
        summary = summarise_campaign(campaign, results)
        times = summarise_times([run["wall"] for run in found])
        write_results(folder, summary, times, None)
    # The certificate: in the folder, and in the cache for a run elsewhere.
    certificate = certificate_in_probability(
        campaign, scenario, results, args.confidence)
    with output_folder(path, replaced, replaces=True) as output:
        write_certificate(certificate, output.folder)
    store(cache_key(scenario), to_data(certificate))
    print(format_probability(certificate))
    print(f"\n{format_campaign(summary, times, str(folder))}" if args.full else
          "\nall results of the runs: --full")
    print(f"written to {path}: {CERTIFICATE_FILE}, {STORE}", file=sys.stderr)
    return BROKEN if certificate.failures else 0


def _number_of_runs(folder: Path, asked: int, log: RunLog) -> int:
    """Returns the number of runs of a folder's certificate, and keeps it before the first run.

    Raises:
        InvalidParameter: More are asked for than were chosen.
    """
    path = folder / NUMBER_FILE
    if not path.exists():
        draft = path.with_suffix(".part")
        draft.write_text(json.dumps({"runs": max(asked, 1 + max(log.runs, default=-1))}) + "\n",
                         encoding="utf-8")
        os.replace(draft, path)
    try:
        chosen = int(json.loads(path.read_text(encoding="utf-8"))["runs"])
    except (OSError, ValueError, KeyError, TypeError):
        raise InvalidParameter("--output", str(path), "the file that certify has written") from None
    require(asked <= chosen, "--runs", asked,
            f"at most {chosen}, the number that {folder} was begun with; another number needs "
            "another --output")
    return chosen
