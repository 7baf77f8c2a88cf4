"""The option --runs of `certify`: a certificate in probability, from runs that are drawn."""

import argparse
import sys
from pathlib import Path

from uvms_drake.campaign.campaign import make_campaign
from uvms_drake.campaign.probability.failures import certificate_in_probability
from uvms_drake.campaign.store import require_same, run_log
from uvms_drake.campaign.summary import format_campaign, summarise_campaign, summarise_times
from uvms_drake.campaign.variation import vary
from uvms_drake.certificate.cache import store
from uvms_drake.certificate.certificate import CERTIFICATE_FILE, write_certificate
from uvms_drake.certificate.coupled.budget import coupled_budget, has_coupled_budget
from uvms_drake.certificate.coupled.linear_distance import check_linear_loop
from uvms_drake.certificate.in_probability import cache_key
from uvms_drake.certificate.probability_table import format_probability
from uvms_drake.command.campaign.runs import (
    check_draws_and_workers,
    complete,
    drawable,
    interrupted,
    pool_of,
    write_results,
)
from uvms_drake.command.progress import stream_of
from uvms_drake.command.run import BROKEN, note
from uvms_drake.common.errors import require
from uvms_drake.common.output import output_folder
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.scenario.scenario_file import reported_in, scenario_source, set_options

STORE = "runs"
"""Folder of the runs, a campaign, inside of the certificate's."""


def certify_by_runs(args: argparse.Namespace, replaced: list[str]) -> int:
    """Computes the missing runs, prints and writes the certificate; returns 3 if a run failed.

    All runs up to the last one that is stored count, even beyond --runs: none is chosen by its
    outcome.

    Args:
        args: Arguments of `certify`.
        replaced: Names of the files of a former `certify` that are replaced or deleted.
    """
    check_draws_and_workers(args)
    require(0.0 < args.confidence < 1.0, "--confidence", args.confidence, "above 0 and below 1")
    scenario = load_scenario(args.scenario, args.overrides)
    path = args.output if args.output is not None else Path("out") / scenario.name
    folder, pool = path / STORE, pool_of(args)
    with reported_in(scenario_source(args.scenario, set_options(args.overrides))):
        require(not scenario.mission.steps, "mission.steps", len(scenario.mission.steps),
                "left out with --runs: no campaign draws a mission")
        if scenario.certificate.linear is not None:
            check_linear_loop(scenario)
        campaign = make_campaign(drawable(scenario), args.seed, None)
        require_same(folder, campaign, certified=False)
        note(scenario)
        vary(campaign, 0)
    # The runs, stored like those of any campaign.
    with run_log(folder, campaign) as log:
        runs = max(args.runs, 1 + max(log.runs, default=-1))
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
    model = load_model(scenario)
    coupled = coupled_budget(scenario, model) if has_coupled_budget(scenario, model) else None
    certificate = certificate_in_probability(
        campaign, scenario, results, args.confidence, coupled)
    with output_folder(path, replaced, replaces=True) as output:
        write_certificate(certificate, output.folder)
    store(cache_key(scenario), certificate.to_data())
    print(format_probability(certificate))
    print(f"\n{format_campaign(summary, times, str(folder))}" if args.full else
          "\nall results of the runs: --full")
    print(f"written to {path}: {CERTIFICATE_FILE}, {STORE}", file=sys.stderr)
    return BROKEN if certificate.failures else 0
