"""The sub-command `campaign`: runs, resumes, sums up and replays."""

import argparse
import json
import os
import sys
from contextlib import closing
from pathlib import Path
from typing import Any, TextIO

from uvms_drake.campaign.campaign import Campaign, make_campaign, require_same_code
from uvms_drake.campaign.figures import CAMPAIGN_FIGURES, WALLS_FILE, make_campaign_figures
from uvms_drake.campaign.model_uncertainty import check_draws
from uvms_drake.campaign.pool import Pool, cluster_pool, local_pool, run_all
from uvms_drake.campaign.store import (
    RUNS_FILE,
    SETUP_FILE,
    RunLog,
    read_indices,
    read_setup,
    require_same,
    run_log,
)
from uvms_drake.campaign.summary import (
    all_well,
    format_campaign,
    summarise_campaign,
    summarise_times,
)
from uvms_drake.campaign.variation import vary
from uvms_drake.certificate.certificate import CERTIFICATE_FILE, Certificate, write_certificate
from uvms_drake.certificate.certify import certified_once, check_inputs
from uvms_drake.command.files import DATA_FILES, picture_files, write_data, write_pictures
from uvms_drake.command.progress import Bar, stream_of
from uvms_drake.command.run import BROKEN, note, sound
from uvms_drake.common.errors import require
from uvms_drake.common.output import output_folder, require_own
from uvms_drake.common.progress import part_of
from uvms_drake.report.summary import format_summary
from uvms_drake.station.motions.motions import motion_of
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import Scenario, load_scenario
from uvms_drake.station.scenario.scenario_file import reported_in, scenario_source, set_options
from uvms_drake.station.simulation import simulate
from uvms_drake.station.step_size import with_step

CAMPAIGN_FILE, TIMES_FILE = "campaign.json", "timing.json"
OWN_FILES = (CAMPAIGN_FILE, TIMES_FILE, CERTIFICATE_FILE, *CAMPAIGN_FIGURES, WALLS_FILE)


def run_campaign(args: argparse.Namespace) -> int:
    """Computes the missing runs and writes the summary; returns 1 if a guarantee was broken.

    Every completed run is kept, even if others fail.
    """
    require(args.runs >= 1, "--runs", args.runs, "at least 1")
    require(args.seed >= 0, "--seed", args.seed, "zero or positive")
    for override in args.overrides:
        require(override.partition("=")[0] != "seed", "--set", override,
                "--seed N: a campaign has a seed of its own")
    require(args.workers is None or args.workers >= 1, "--workers", args.workers, "at least 1")
    require(0.0 <= args.model_error <= 0.5, "--model-error", args.model_error, "from 0 to 0.5")
    require(args.model_error > 0.0 or not args.outside, "--model-error", args.model_error,
            "above 0 with --outside")
    # The scenario, its certificate, and everything else that the runs have in common.
    scenario = load_scenario(args.scenario, args.overrides)
    source = scenario_source(args.scenario, set_options(args.overrides))
    output = folder_of(args, scenario)
    require_own(output, OWN_FILES)
    pool = (cluster_pool(args.scheduler) if args.scheduler is not None
            else local_pool(args.workers or _cores()))
    with reported_in(source):
        require(not scenario.faults, "faults", [type(fault).__name__ for fault in scenario.faults],
                "left out: a campaign draws them")
        require(scenario.mpc.deadline is None, "mpc.deadline", scenario.mpc.deadline,
                "left out: no run could be repeated")
        scenario = with_step(scenario, check_inputs(scenario))
        if args.model_error > 0.0 and motion_of(scenario).has_forces:
            check_draws(scenario, args.model_error)
        require_same(output, make_campaign(scenario, args.seed, None, args.model_error,
                                           outside=args.outside), certified=not args.uncertified)
        note(scenario)
        with closing(Bar("certifying the surfaces (two minutes)", stream_of(args))) as progress:
            certificate = None if args.uncertified else sound(
                certified_once(scenario, part_of(progress, 0.0, 0.2)), source)
            campaign = make_campaign(scenario, args.seed, certificate, args.model_error,
                                     outside=args.outside, progress=part_of(progress, 0.2, 1.0))
        vary(campaign, 0)
    # The runs, and their summary.
    with run_log(output, campaign) as log:
        try:
            _run(campaign, args.runs, log, pool, stream_of(args))
        except KeyboardInterrupt:
            print(f"\nuvms-drake: interrupted, {len(log.runs)} runs are in {output}; the same "
                  "command goes on with the others", file=sys.stderr)
            return 130
        runs = [log.runs[index] for index in range(args.runs)]
        summary = summarise_campaign(campaign, [run["result"] for run in runs])
        times = summarise_times([run["wall"] for run in runs])
        written = _write(output, summary, times, certificate)
    print(format_campaign(summary, times, str(output)))
    print(f"\nwritten to {output}: {', '.join(sorted((SETUP_FILE, RUNS_FILE, *written)))}")
    well, never = all_well(summary), summary["counts"]["never_settled"]
    print(("all guarantees kept" if well else "GUARANTEES BROKEN, or too many runs do not count")
          + (f"; the force never settled in {never} of {args.runs} runs" if never else ""))
    return 0 if well else BROKEN


def folder_of(args: argparse.Namespace, scenario: Scenario) -> Path:
    """Returns the folder of a campaign: the one asked for, or out/<scenario>-campaign."""
    kind = "outside" if args.outside else "campaign"
    return args.output if args.output is not None else Path("out") / f"{scenario.name}-{kind}"


def _run(campaign: Campaign, runs: int, log: RunLog, pool: Pool, stream: TextIO) -> None:
    missing = [index for index in range(runs) if index not in log.runs]
    if len(missing) < runs:
        print(f"{runs - len(missing)} of {runs} runs are there already", file=stream)
    with closing(Bar("running", stream)) as progress:
        for done, (_, run) in enumerate(run_all(campaign, missing, pool), 1):
            log.append(run)
            progress(f"{done} of {len(missing)} runs", done / len(missing))


def _write(output: Path, summary: dict[str, Any], times: dict[str, Any],
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


def _cores() -> int:
    """Returns the number of cores available to this process; on macOS that of the machine."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def replay_run(args: argparse.Namespace) -> int:
    """Repeats a single run of a campaign, and writes its data and figures."""
    for name in set(vars(args)) - {"command", "parser", "scenario", "output", "outside", "replay",
                                  "quiet"}:
        option = "--set" if name == "overrides" else f"--{name.replace('_', '-')}"
        require(getattr(args, name) == args.parser.get_default(name), option, getattr(args, name),
                "left out with --replay: the campaign in the folder determines it")
    campaign = folder_of(args, load_scenario(args.scenario))
    record = replayed(campaign, args.replay)
    path = campaign / f"run-{args.replay}"
    with output_folder(path, (*DATA_FILES, *picture_files())) as output:
        summary = write_data(record, output.folder)
        output.keep()
        write_pictures(record, None, output.folder, figures=True, replay=False)
    print(f"{format_summary(summary)}\n\nthe tube is the campaign's; a run of it has no "
          f"certificate of its own\nwritten to {path}: {', '.join(sorted(output.kept))}")
    return 0


def replayed(folder: Path, index: int) -> Record:
    """Returns the record of a repeated run of the campaign in a folder.

    It has no certificate: that of the campaign is of another start, force and disturbance.
    """
    campaign, done = read_setup(folder), read_indices(folder)
    require(index in done, "--replay", index, f"one of the {len(done)} runs in {folder}")
    require_same_code(campaign)
    return simulate(vary(campaign, index).scenario)
