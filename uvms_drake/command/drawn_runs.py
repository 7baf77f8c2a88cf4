"""Drawn runs of a scenario: a campaign, a calibration, and the certificate of `certify --runs`."""

import argparse
import shlex
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from uvms_drake.actuation.thrusters import largest_error
from uvms_drake.campaign.campaign import (
    SETUP_FILE,
    Campaign,
    check_folder,
    keep_setup,
    make_campaign,
    read_setup,
    require_same_code,
)
from uvms_drake.campaign.drawn_contact import check_forces, force_to_admit
from uvms_drake.campaign.draws import vary
from uvms_drake.campaign.failures import certificate_in_probability
from uvms_drake.campaign.figures import CAMPAIGN_FIGURES, WALLS_FILE, make_campaign_figures
from uvms_drake.campaign.harness import RUNS_FILE, runs, stored
from uvms_drake.campaign.pool import Pool, make_pool
from uvms_drake.campaign.run import run_one
from uvms_drake.campaign.summary import (
    all_well,
    format_campaign,
    summarise_campaign,
    summarise_times,
)
from uvms_drake.certificate.attempts import attempt_of, begun, ledger_path
from uvms_drake.certificate.certificate import (
    CERTIFICATE_FILE,
    Certificate,
    cache_key,
    fingerprint,
    read_certificate,
    run_source,
    to_data,
    write_certificate,
)
from uvms_drake.certificate.certify import certified_once
from uvms_drake.certificate.in_probability import failure_bound, percent_above, spent
from uvms_drake.certificate.run_verdict import BROKEN
from uvms_drake.certificate.text import format_probability
from uvms_drake.command.certificates import note, sound
from uvms_drake.command.files import (
    DATA_FILES,
    asked,
    left_out,
    new_file,
    picture_files,
    write_data,
    write_pictures,
)
from uvms_drake.command.interrupt import PROGRAM
from uvms_drake.command.progress import bar
from uvms_drake.command.run import print_outcome
from uvms_drake.common.cache import store
from uvms_drake.common.errors import require
from uvms_drake.common.jsonable import write_json
from uvms_drake.common.output import output_folder, require_own
from uvms_drake.report.tube_use import check_log
from uvms_drake.setup.calibrate import (
    MULTIPLE,
    ROUNDS,
    SCALES,
    Calibration,
    PilotsFailed,
    calibrate,
)
from uvms_drake.setup.calibrated_file import calibrated_text
from uvms_drake.station.contact.bounds import largest_force, sensed_contact
from uvms_drake.station.problem import check_inputs
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import Scenario, load_scenario, scenario_of
from uvms_drake.station.scenario.scenario_file import reported_in, scenario_path
from uvms_drake.station.simulation import simulate
from uvms_drake.station.step_size import with_step

CAMPAIGN_FILE, TIMES_FILE = "campaign.json", "timing.json"
OWN_FILES = (CAMPAIGN_FILE, TIMES_FILE, CERTIFICATE_FILE, *CAMPAIGN_FIGURES, WALLS_FILE)
OWN_FOLDER = "-campaign"
"""End of the name of a campaign's folder."""
LARGEST_SEED = 2**32
RADII = ("e", "position", "orientation", "joints", "z", "nu1", "nu2", "qdot", "roll", "pitch", "u")
WALL_RADII = ("tip_speed", "depth", "depth_speed")
"""Radii that a certificate in probability needs, and those that it needs with a sensed contact."""
STORE = "runs"
"""Folder of the runs inside of that of a certificate in probability; it is a campaign's."""


def run_campaign(args: argparse.Namespace) -> int:
    """Computes the missing runs and writes the summary; returns 3 if a guarantee was broken."""
    check_draws(args)
    # The scenario, its certificate, and everything else that the runs have in common.
    scenario, source, output = asked(args, OWN_FOLDER)
    pool = make_pool(args.workers, args.scheduler)
    require_own(output, OWN_FILES)
    with reported_in(source):
        scenario = drawable(scenario)
        check_folder(output, replace(make_campaign(scenario, args.seed, None),
                                     certified=not args.uncertified))
        note(scenario)
        with bar(args, "certifying") as progress:
            certificate = None if args.uncertified else sound(
                certified_once(scenario, progress), source)
        campaign = make_campaign(scenario, args.seed, certificate)
        vary(campaign, 0)
    summary, _, text, written = complete(args, campaign, args.runs, output, pool, certificate)
    print(f"{text}\n\nwritten to {output}: "
          f"{', '.join(sorted((SETUP_FILE, RUNS_FILE, *written)))}")
    well, never = all_well(summary), summary["counts"]["never_settled"]
    words = ("all guarantees kept", "GUARANTEES BROKEN, or too many runs do not count")
    if not campaign.certified:
        words = ("all limits kept, without a certificate",
                 "LIMITS VIOLATED, or too many runs do not count, without a certificate")
    settled = f"; the force never settled in {never} of {args.runs} runs" if never else ""
    print(f"{words[not well]}{settled}")
    return 0 if well else BROKEN


def certify_by_runs(args: argparse.Namespace, replaced: list[str]) -> int:
    """Computes the missing runs, prints and writes the certificate; returns 3 if a run failed.

    The attempt is in the ledger before the first run, so that neither seed nor number of runs nor
    folder is chosen by the outcome.

    Args:
        args: Arguments of `certify`.
        replaced: Names of the files of a former `certify` that are replaced or deleted.
    """
    check_draws(args)
    require(0.5 <= args.confidence < 1.0, "--confidence", args.confidence,
            "at least 0.5 and below 1")
    scenario, source, path = asked(args)
    folder, pool = path / STORE, make_pool(args.workers, args.scheduler)
    with reported_in(source):
        drawn = drawable(scenario)
        check_declared(drawn)
        attempt = attempt_of(drawn, fingerprint(drawn) | {"source": run_source()}, args.runs,
                             args.confidence)
        campaign = make_campaign(drawn, attempt.seed, None, args.runs)
        check_folder(folder, campaign)
        note(scenario)
        vary(replace(campaign, seed=0), 0)  # Whether it can be drawn; no run of this attempt.
    attempts = begun(attempt)
    best = failure_bound(args.runs, 0, spent(args.confidence, len(attempts)))
    print(f"attempt {len(attempts)} at: {attempt.task}; in {ledger_path()}\n"
          f"{args.runs} runs, a minute or two of a core each: at most {percent_above(best)} per "
          "run if none fails", file=sys.stderr)
    summary, times, text, _ = complete(args, campaign, args.runs, folder, pool, None)
    # The certificate: in the folder, and in the cache for a run elsewhere.
    certificate = certificate_in_probability(
        campaign, attempts, scenario, summary["results"], args.confidence)
    with output_folder(path, replaced, replaces=True) as output:
        write_certificate(certificate, output.folder)
    store(cache_key(scenario), to_data(certificate))
    table = format_probability(certificate, (times["seconds"] or {}).get("median"), full=args.full)
    print(table, text if args.full else "statement, distribution and all results of the runs: "
          "--full", sep="\n\n")
    print(f"written to {path}: {CERTIFICATE_FILE}, {STORE}", file=sys.stderr)
    return BROKEN if certificate.failures else 0


def calibrate_scenario(args: argparse.Namespace) -> int:
    """Writes the calibrated scenario and prints the rows of its tube."""
    scenario, path = load_scenario(args.scenario), scenario_path(args.scenario)
    file = args.output or Path(f"{scenario.name}_calibrated.yaml")
    pool = make_pool(args.workers, args.scheduler)
    command = shlex.join([PROGRAM, "calibrate", args.scenario, *["--gains"] * args.gains,
                          "--runs", str(args.runs)])
    text = path.read_text(encoding="utf-8")
    with reported_in(args.scenario):
        check_repeatable(scenario)
    with new_file(file, "--output"):
        # Whether its layout takes the numbers, before the runs that find them.
        with reported_in(str(file)):
            scenario_of(calibrated_text(text, Calibration(
                scenario, {}, args.runs, MULTIPLE, ROUNDS, SCALES[0] if args.gains else None, 0.0),
                command), file)
        with reported_in(args.scenario), bar(args, "pilot runs") as progress:
            try:
                found = calibrate(scenario, args.runs, args.gains, pool, progress)
            except PilotsFailed as error:
                print("\n".join(error.lines), file=sys.stderr)
                raise
        file.write_text(calibrated_text(text, found, command), encoding="utf-8")
        with reported_in(str(file)):
            check_declared(drawable(load_scenario(str(file))))
    print(f"{found}\n\nwritten to {file}; '{PROGRAM} certify {file} --runs 300' draws other runs")
    return 0


def check_draws(args: argparse.Namespace) -> None:
    """Raises `InvalidParameter` for a number of runs or a seed that cannot be."""
    require(args.runs >= 1, "--runs", args.runs, "at least 1")
    seed = getattr(args, "seed", 0)  # That of a certificate, which is larger, cannot be foreseen.
    require(0 <= seed < LARGEST_SEED, "--seed", seed, "zero or positive, below 2³²")
    for override in args.overrides:
        require(override.partition("=")[0] != "seed", "--set", override,
                "left out: a campaign has a seed of its own")


def check_declared(scenario: Scenario) -> None:
    """Raises `InvalidParameter` for a radius that tightens a limit and is not declared.

    Or for a part of the distribution that would follow from the radii.
    """
    tube, of_wall = scenario.tube, scenario.contact.declared_wall() is not None
    if of_wall:
        check_log(scenario)
        for key in ("speed", *(() if scenario.mission.steps else ("force",))):
            asked = getattr(scenario.draws, key)
            require(asked is not None, f"draws.{key}", asked, "declared: the distribution of a "
                    "certificate in probability must not depend on the tube")
        contact, speed = sensed_contact(scenario), scenario.draws.speed
        left = contact.speed - (tube.depth_speed or 0.0)
        assert speed is not None
        require(speed <= left + 1e-9, "draws.speed", speed,
                f"at most {left:.3g} m/s, contact.speed less tube.depth_speed: a plan is no faster")
        most = largest_force(scenario)
        key, force = force_to_admit(scenario)
        require(force < most, key, force,
                f"below {most:.3g} N, the largest that the safe region admits with the tube")
    for key in (*RADII, *(WALL_RADII if of_wall else ()),
                *(("tau",) if scenario.limits.tau is not None else ())):
        radius = getattr(tube, key)
        require(radius is not None and np.size(radius) > 0 and bool(np.any(radius)), f"tube.{key}",
                radius, "declared: a certificate in probability watches each radius that "
                "tightens a limit")


def drawable(scenario: Scenario) -> Scenario:
    """Returns the scenario with its integration step; raises if it cannot be drawn or repeated."""
    check_repeatable(scenario)
    scenario = with_step(scenario, check_inputs(scenario))
    check_forces(scenario)
    return scenario


def check_repeatable(scenario: Scenario) -> None:
    """Raises `InvalidParameter` for a part that is not drawn, or makes a run not repeatable."""
    require(not scenario.faults, "faults", [type(fault).__name__ for fault in scenario.faults],
            "left out: a campaign draws them")
    require(scenario.mpc.deadline is None, "mpc.deadline", scenario.mpc.deadline,
            "left out: no run could be repeated")
    require(largest_error(scenario.actuation) < 1.0, "actuation", "an error of -1", "larger: of "
            "a dead thruster there is no smaller error of either sign to draw")


def complete(args: argparse.Namespace, campaign: Campaign, number: int, output: Path, pool: Pool,
             certificate: Certificate | None
             ) -> tuple[dict[str, Any], dict[str, Any], str, list[str]]:
    """Computes the missing runs, and writes all results together.

    Returns the summary, the times, the table of both, and the names of the files.
    """
    keep_setup(output, campaign)
    if certificate is not None:  # A run can be repeated before the last one is done.
        with output_folder(output, [CERTIFICATE_FILE]) as first:
            write_certificate(certificate, first.folder)
    with bar(args, "running") as progress:
        results = runs(range(number), partial(run_one, campaign), output, pool, progress=progress)
    times = summarise_times([result.pop("times") for result in results])
    summary = summarise_campaign(campaign, results)
    with output_folder(output, OWN_FILES, replaces=True) as own:
        write_json(summary, own.folder / CAMPAIGN_FILE)
        write_json(times, own.folder / TIMES_FILE)
        if certificate is not None:
            write_certificate(certificate, own.folder)
        make_campaign_figures(summary, own.folder)
    return summary, times, format_campaign(summary, times, str(output)), own.kept


def replay_run(args: argparse.Namespace) -> int:
    """Repeats a single run of a campaign, and writes its data and figures."""
    left_out(args, set(vars(args)) - {"command", "parser", "scenario", "output", "replay", "quiet"},
             "with --replay: the campaign in the folder determines it")
    _, _, campaign = asked(args, OWN_FOLDER)
    record = replayed(campaign, args.replay)
    certificate = read_certificate(campaign / CERTIFICATE_FILE) if record.certified else None
    path = campaign / f"run-{args.replay}"
    with output_folder(path, (*DATA_FILES, *picture_files(), CERTIFICATE_FILE)) as output:
        if certificate is not None:
            write_certificate(certificate, output.folder)
        summary = write_data(record, output, certificate)
        write_pictures(record, certificate, output.folder, summary, figures=True, replay=False)
    return print_outcome(summary, path, output.kept, full=True)


def replayed(folder: Path, index: int) -> Record:
    """Returns the record of a repeated run of the campaign in a folder.

    With the tube of the campaign's certificate, if that has one.
    """
    campaign, done = read_setup(folder), stored(folder)
    require(index in done, "--replay", index, f"one of the {len(done)} runs in {folder}")
    require_same_code(campaign)
    return simulate(vary(campaign, index), certified=campaign.certified)
