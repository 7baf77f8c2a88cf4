"""The sub-command `campaign`: runs, resumes, sums up and replays."""

import argparse
from contextlib import closing
from pathlib import Path

from uvms_drake.campaign.campaign import make_campaign, require_same_code
from uvms_drake.campaign.store import (
    RUNS_FILE,
    SETUP_FILE,
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
from uvms_drake.certificate.certify import certified_once
from uvms_drake.command.campaign.runs import (
    OWN_FILES,
    check_draws_and_workers,
    complete,
    drawable,
    interrupted,
    write_results,
)
from uvms_drake.command.certificates import note, sound
from uvms_drake.command.files import BROKEN, DATA_FILES, picture_files, write_data, write_pictures
from uvms_drake.command.progress import Bar, stream_of
from uvms_drake.command.workers import pool_of
from uvms_drake.common.errors import require
from uvms_drake.common.output import output_folder, require_own
from uvms_drake.report.summary import format_summary
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.scenario.scenario_file import reported_in, scenario_source, set_options
from uvms_drake.station.simulation import simulate


def run_campaign(args: argparse.Namespace) -> int:
    """Computes the missing runs and writes the summary; returns 1 if a guarantee was broken.

    Every completed run is kept, even if others fail.
    """
    check_draws_and_workers(args)
    # The scenario, its certificate, and everything else that the runs have in common.
    scenario = load_scenario(args.scenario, args.overrides)
    source = scenario_source(args.scenario, set_options(args.overrides))
    output = folder_of(args, scenario.name)
    require_own(output, OWN_FILES)
    pool = pool_of(args)
    with reported_in(source):
        scenario = drawable(scenario)
        require_same(output, make_campaign(scenario, args.seed, None),
                     certified=not args.uncertified)
        note(scenario)
        with closing(Bar("certifying", stream_of(args))) as progress:
            certificate = None if args.uncertified else sound(
                certified_once(scenario, progress), source)
        campaign = make_campaign(scenario, args.seed, certificate)
        vary(campaign, 0)
    # The runs, and their summary.
    with run_log(output, campaign) as log:
        try:
            complete(campaign, args.runs, log, pool, stream_of(args))
        except KeyboardInterrupt:
            return interrupted(log, output)
        runs = [log.runs[index] for index in range(args.runs)]
        summary = summarise_campaign(campaign, [run["result"] for run in runs])
        times = summarise_times([run["wall"] for run in runs])
        written = write_results(output, summary, times, certificate)
    print(format_campaign(summary, times, str(output)))
    print(f"\nwritten to {output}: {', '.join(sorted((SETUP_FILE, RUNS_FILE, *written)))}")
    well, never = all_well(summary), summary["counts"]["never_settled"]
    print(("all guarantees kept" if well else "GUARANTEES BROKEN, or too many runs do not count")
          + (f"; the force never settled in {never} of {args.runs} runs" if never else ""))
    return 0 if well else BROKEN


def folder_of(args: argparse.Namespace, scenario: str) -> Path:
    """Returns the folder of a campaign: the one asked for, or out/<scenario>-campaign."""
    return args.output if args.output is not None else Path("out") / f"{scenario}-campaign"


def replay_run(args: argparse.Namespace) -> int:
    """Repeats a single run of a campaign, and writes its data and figures."""
    for name in set(vars(args)) - {"command", "parser", "scenario", "output", "replay",
                                  "quiet"}:
        option = "--set" if name == "overrides" else f"--{name.replace('_', '-')}"
        require(getattr(args, name) == args.parser.get_default(name), option, getattr(args, name),
                "left out with --replay: the campaign in the folder determines it")
    campaign = folder_of(args, load_scenario(args.scenario).name)
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
    return simulate(vary(campaign, index))
