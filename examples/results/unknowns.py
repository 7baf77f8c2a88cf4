"""Declared unknowns, each alone: certified by the advice of `certify`, run, and in campaigns.

`python examples/results/unknowns.py > examples/results/unknowns.md` starts from `girona500_contact`
with an unknown of the asked size, takes over the settings that the certificate advises until it
holds, and makes a run. The first two unknowns have a campaign, whose runs draw the unknown up to
its declared size. It takes an hour on a core.
"""

import argparse
import json
import re
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from make_all import provenance, uvms_drake

import uvms_drake as uv
from uvms_drake.certificate.certificate import Certificate
from uvms_drake.certificate.certify import certified_once
from uvms_drake.command.drawn_runs import CAMPAIGN_FILE
from uvms_drake.report.summary import summarise
from uvms_drake.station.simulation import simulate
from uvms_drake.tube.ultimate_bounds import HOLD

BASE, STEPS, DURATION = "girona500_contact", 8, 20.0
"""Scenario, most certificates on the way to one that holds, and duration of a run [s]."""
RUNS, LONGEST = 100, 11.0
"""Runs of a campaign, and their longest duration [s]."""
ADVICE = re.compile(r"--set (\S+)")
HEAD = """# Declared unknowns, each alone

{provenance} Command: `{command}`.

`{base}` with an unknown of the asked size, and the settings that `certify` advises one after the
other. *Hold* is the certified band of the press of 20 N; *exits* of the tube and *off*, the largest
force error in the hold, are of a run of {duration} s.

{rows}

Settings:

{settings}

"""
"""Beginning of the page."""
CAMPAIGN_HEAD = """
## Campaigns

{runs} runs each with seed 1, of at most {longest} s, on walls of the class. The unknown is drawn
up to its declared size, in a quarter of the runs at it; adversaries have the rest of d.
"""
"""Beginning of the second table."""
COLUMNS = ("unknown", "asked", "certified", "hold [N]", "exits", "off [N]")
CAMPAIGN_COLUMNS = (
    "unknown", "runs", "counted", "exits of the tube", "violated limits",
    "exceptions, failed solves", "touched", "pressed too hard",
    "largest disturbance over its bound", "largest deviation over the tube")


def table_head(columns: Sequence[str]) -> str:
    """Returns the first two lines of a table."""
    return f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|"


class Case(NamedTuple):
    """An unknown."""

    unit: str
    asked: float
    """Size."""
    settings: Callable[[float], list[str]]
    """Function from a size to the keys that declare it."""


CASES = {
    "current": Case("m/s", 0.1, lambda size: [f"current=[{size:g},0,0]"]),
    "mass": Case("of it", 0.03,
                 lambda size: [f"model_error.mass={1.0 + size:g}"]),
    "added mass": Case("of it", 0.03,
                       lambda size: [f"model_error.added_mass={1.0 + size:g}"]),
    "trim": Case("of it", 0.01,
                 lambda size: [f"model_error.buoyancy={1.0 + size:g}"]),
    "joint friction": Case("N m", 0.2,
                           lambda size: [f"model_error.joint_friction.coulomb=[{size:g}]"]),
    "payload": Case("kg", 0.02,
                    lambda size: [f"model_error.payload.mass={size:g}"])}
CAMPAIGNS = tuple(CASES)[:2]


def declared_of(name: str) -> list[str]:
    """Returns the settings that declare an unknown of the asked size."""
    return [*CASES[name].settings(CASES[name].asked), f"duration={DURATION:g}"]


def followed(declared: list[str]) -> tuple[list[str], Certificate]:
    """Returns the settings at which the advice of certificates ends, and the last certificate.

    Args:
        declared: Settings that declare an unknown.
    """
    settings: dict[str, str] = {}
    for _ in range(STEPS):
        certificate = certified_once(uv.load_scenario(BASE, [*declared, *settings.values()]))
        advised = {found.partition("=")[0]: found for condition in certificate.conditions
                   if not condition.holds for found in ADVICE.findall(condition.advice)}
        if certificate.certified or not advised:
            break
        settings |= advised
    return list(settings.values()), certificate


def failures(certificate: Certificate) -> str:
    """Returns the conditions that do not hold."""
    return "; ".join(str(each) for each in certificate.conditions if not each.holds)


def run_of(settings: list[str], certificate: Certificate) -> dict[str, Any]:
    """Returns the summary of a run with a certificate."""
    scenario = certificate.applied_to(uv.load_scenario(BASE, settings))
    summary: dict[str, Any] = summarise(simulate(scenario, certified=True))
    return summary


def campaign_of(settings: list[str], folder: Path) -> dict[str, Any]:
    """Returns the statistics of a campaign; one that is complete in the folder is taken."""
    settings = [each for each in settings if not each.startswith("duration")]
    if not (folder / CAMPAIGN_FILE).exists():
        uvms_drake("campaign", BASE, "--runs", str(RUNS), "--seed", "1", "--workers", "1",
                   "--set", f"duration={LONGEST:g}",
                   *(part for each in settings for part in ("--set", each)),
                   "--output", str(folder))
    statistics: dict[str, Any] = json.loads((folder / CAMPAIGN_FILE).read_text("utf-8"))
    return statistics


def campaign_row(name: str, found: dict[str, Any]) -> str:
    """Returns the row of a campaign."""
    counts, walls = found["counts"], found["walls"]
    return (f"| {name} | {found['runs']} | {counts['counted']} | {counts['exits_set']} | "
            f"{counts['violations']} | {counts['exceptions'] + counts['mpc_failures']} | "
            f"{walls['touched']} | {len(walls['broken']['static'])} | "
            f"{found['distributions']['worst_disturbance']['max']:.2g} | "
            f"{found['distributions']['ratio_set']['max']:.2g} |")


def rows_of(name: str) -> tuple[str, str, list[str]]:
    """Returns the row of an unknown, its list of settings, and these settings."""
    case = CASES[name]
    print(name, file=sys.stderr)
    declared = declared_of(name)
    settings, certificate = followed(declared)
    asked = f"| {name} | {case.asked:g} {case.unit} |"
    if not certificate.certified:
        return f"{asked} no: {failures(certificate)} | – | – | – |", "", []
    run = run_of([*declared, *settings], certificate)
    exits, bands = run["tube"]["exits"], run["contact"]["force_bands"]["hold"]
    reached = "–" if bands is None else f"{bands['worst_error']:.2g}"
    row = (f"{asked} {len(certificate.conditions)} conditions | ± {certificate.bounds[HOLD]:.3g} | "
           f"{exits} | {reached} |")
    print(row, file=sys.stderr)
    return row, f"* {name}: `--set " + " --set ".join([*declared, *settings]) + "`", [
        *declared, *settings]


def main() -> None:
    """Prints the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("unknowns", nargs="*", default=list(CASES))
    parser.add_argument("--campaigns", type=Path,
                        help="folder of campaigns, one each; made where there is none")
    parser.add_argument("--no-campaigns", action="store_true", help="the first table alone")
    args = parser.parse_args()
    found = {name: rows_of(name) for name in args.unknowns}
    print(HEAD.format(
        provenance=provenance(), command=" ".join(
            ("python examples/results/unknowns.py", *sys.argv[1:])),
        base=BASE, duration=f"{DURATION:g}",
        rows="\n".join([table_head(COLUMNS), *(row for row, _, _ in found.values())]),
        settings="\n".join(line for _, line, _ in found.values() if line)))
    if args.no_campaigns:
        return
    print(CAMPAIGN_HEAD.format(runs=RUNS, longest=f"{LONGEST:g}"))
    print(table_head(CAMPAIGN_COLUMNS))
    with tempfile.TemporaryDirectory() as temporary:
        for name in CAMPAIGNS:
            if name in found and found[name][2]:
                print(campaign_row(name, campaign_of(
                    found[name][2], (args.campaigns or Path(temporary)) / name)))


if __name__ == "__main__":
    main()
