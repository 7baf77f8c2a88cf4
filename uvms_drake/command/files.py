"""The files of a run, which several commands write."""

import argparse
import contextlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from uvms_drake.certificate.certificate import AnyCertificate, Certificate
from uvms_drake.certificate.in_probability import FAILURES
from uvms_drake.common.errors import InvalidParameter, require, shortened
from uvms_drake.common.jsonable import write_json
from uvms_drake.common.output import Output
from uvms_drake.station.record import LOG_FILE, SCENARIO_FILE, TIMING_FILE, Record, save_record
from uvms_drake.station.scenario.scenario import Scenario, load_scenario
from uvms_drake.station.scenario.scenario_file import scenario_source, set_options

MAIN_SCENARIO = "girona500_contact"
SUMMARY_FILE = "summary.json"
REPLAY_FILE = "replay.html"
REPORT_FILE = "report.html"
INSPECTION_FILE = "inspection.csv"
TABLE_FILE = "log.csv"
LONGEST_NAME = 255
"""Largest length of a folder's name in file systems [bytes]."""
DATA_FILES = (SCENARIO_FILE, LOG_FILE, TIMING_FILE, SUMMARY_FILE, TABLE_FILE,
              INSPECTION_FILE)


def folder(text: str) -> Path:
    """Returns the folder of an option; an empty text, of an unset variable, is refused."""
    fits = all(len(os.fsencode(part)) <= LONGEST_NAME for part in Path(text).parts)
    if not text or "\0" in text or not fits:
        raise argparse.ArgumentTypeError(f"{shortened(text)!r}: must be the name of a folder")
    return Path(text)


@contextlib.contextmanager
def new_at(path: Path, option: str = "--new") -> Iterator[None]:
    """Raises `InvalidParameter` if the path of an option cannot be written."""
    try:
        yield
    except OSError as error:
        raise InvalidParameter(option, str(path),
                               f"a path that can be written to ({error.strerror})") from None


@contextlib.contextmanager
def new_file(file: Path, option: str) -> Iterator[None]:
    """Checks that a file can be written, and removes it again if the block raises.

    Raises:
        InvalidParameter: It is there already, or cannot be written.
    """
    require(file.suffix == ".yaml" and not file.exists(), option, str(file),
            "a .yaml file that is not there yet")
    above = [path for path in file.parents if not path.exists()]
    with new_at(file, option):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
        file.unlink()  # Else the end of the process would leave it empty.
    try:
        yield
    except BaseException:
        file.unlink(missing_ok=True)
        for path in above:
            path.rmdir()
        raise


def take_scenario(command: argparse.ArgumentParser) -> None:
    """Adds the arguments that name a scenario and override its values."""
    command.add_argument("scenario", nargs="?", default=MAIN_SCENARIO, metavar="SCENARIO",
                         help="name of a shipped scenario or a YAML file (default: %(default)s)")
    command.add_argument("--set", action="append", default=[], metavar="KEY.PATH=VALUE",
                         dest="overrides",
                         help="any value of the scenario, in YAML, such as limits.u.0=0.2; can be "
                              "repeated")
    take_quiet(command)


def take_quiet(command: argparse.ArgumentParser) -> None:
    """Adds the option that keeps the progress off stderr."""
    command.add_argument("--quiet", action="store_true", help="do not report progress")


def asked(args: argparse.Namespace, ending: str = "") -> tuple[Scenario, str, Path]:
    """Returns the scenario that is asked for, its source for messages, and the folder to write to.

    Args:
        args: Arguments of a command that has those of `take_scenario` and --output.
        ending: End of the name of a folder that is not given, after out/<scenario>.
    """
    scenario = load_scenario(args.scenario, args.overrides)
    source = scenario_source(args.scenario, set_options(args.overrides))
    return scenario, source, args.output or Path("out") / f"{scenario.name}{ending}"


def left_out(args: argparse.Namespace, options: Iterable[str], where: str) -> None:
    """Raises `InvalidParameter` for the first given option that must be left out."""
    for name in options:
        option = "--set" if name == "overrides" else f"--{name.replace('_', '-')}"
        require(getattr(args, name) == args.parser.get_default(name), option, getattr(args, name),
                f"left out {where}")


def picture_files() -> tuple[str, ...]:
    """Returns the names of all the files that `write_pictures` may write."""
    from uvms_drake.report.figures import FIGURES

    return (*FIGURES, REPORT_FILE, REPLAY_FILE)


def summary_of(record: Record, certificate: AnyCertificate | None = None) -> dict[str, Any]:
    """Returns the summary of a run, with its verdict.

    One of the declared distribution of a certificate in probability fails as the certificate's own
    would.
    """
    from uvms_drake.certificate.run_verdict import NAMED, broken, verdict_of
    from uvms_drake.report.summary import summarise

    summary = summarise(record, certificate)
    claim = summary["in_probability"]
    if claim is not None and not claim["outside"] and not record.failure:
        from uvms_drake.campaign.failures import failures_of
        from uvms_drake.campaign.run import outcome

        kinds = failures_of({"error": None, **outcome(record)})
        said = " ".join(broken(summary))  # Not of all radii of the tube, nor of all losses.
        summary["verdict"] = verdict_of(summary, [
            f"it {FAILURES[kind]}" for kind in kinds if kind not in NAMED or (
                kind != "limit" and kind not in said)])
    return summary


def write_data(record: Record, output: Output, certificate: AnyCertificate | None = None
               ) -> dict[str, Any]:
    """Writes the data of a run and returns its summary; the log stays even if that cannot be made.

    A run with a mission has an `INSPECTION_FILE`.

    Args:
        record: Record of the run.
        output: Folder to write to; files of a former run that this one does not have are deleted.
        certificate: Certificate of the run, if any.
    """
    from uvms_drake.report.log_export import format_log
    from uvms_drake.report.mission import format_inspection
    from uvms_drake.report.signals import has_mission

    save_record(record, output.folder)
    try:
        (output.folder / TABLE_FILE).write_text(format_log(record), encoding="utf-8")
        if has_mission(record):
            (output.folder / INSPECTION_FILE).write_text(format_inspection(record), "utf-8")
        summary = summary_of(record, certificate)
        write_json(summary, output.folder / SUMMARY_FILE)
    finally:
        output.keep(replaces=True)
    return summary


def write_pictures(record: Record, certificate: AnyCertificate | None, folder: Path,
                   summary: dict[str, Any], *, figures: bool, replay: bool) -> None:
    """Writes figures and replay of a run into a folder; the report comes with the figures.

    Args:
        record: The run.
        certificate: Its certificate, if any.
        folder: The folder.
        summary: Its summary.
        figures: Whether figures and report are written.
        replay: Whether the replay is written.
    """
    if figures:
        from uvms_drake.report.figures import make_figures
        from uvms_drake.report.html import format_report

        bounds = certificate.bounds if isinstance(certificate, Certificate) else None
        drawn = make_figures(record, folder, bounds, summary["verdict"])
        (folder / REPORT_FILE).write_text(
            format_report(record, drawn, certificate, summary), encoding="utf-8")
    if replay:
        from uvms_drake.report.replay import write_replay

        write_replay(record, folder / REPLAY_FILE, summary["verdict"]["text"])
