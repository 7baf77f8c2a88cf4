"""Report of a run: one self-contained HTML file."""

import base64
import html
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from uvms_drake.certificate.certificate import (
    CERTIFICATE_FILE,
    AnyCertificate,
    Certificate,
    probability_fingerprint,
    read_certificate,
)
from uvms_drake.certificate.in_probability import ProbabilityCertificate
from uvms_drake.certificate.text import format_overview, format_probability, largest_force
from uvms_drake.common.errors import RunFailed
from uvms_drake.common.program import VERSION
from uvms_drake.report.contact_figures import ESTIMATE
from uvms_drake.report.summary import format_summary, summarise
from uvms_drake.station.record import SCENARIO_FILE, Record, load_record, unusable_folder
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario

PAGE = Template(Path(__file__).with_name("page.html").read_text(encoding="utf-8"))
"""The page, with `$name` for each of its parts."""

PORTRAIT = "robot.png"
"""First figure of the report."""
CAPTIONS = {
    PORTRAIT: "The robot at the end, in parallel projection; in red the path of its end-effector "
              "and its force.",
    "task_error.png": "Task error χ − χ_des, and the same close to zero with the tube.",
    "force.png": "Force on the surface, and penetration with its limit in a known plane; after an "
                 "approach, also the force from first contact to settling.",
    "mission.png": "Force over time and along each line, with the bands of the mission's steps, "
                   "and the distance of the tip from the line.",
    "coverage.png": "The wall as the tool faces it: every measurement at its place, coloured by "
                    "force; the circles and lines are the mission's.",
    "velocities.png": "Velocities of vehicle and joints with their limits.",
    "joints.png": "Joint angles with their limits.",
    "inputs.png": "Acceleration commands with their limits.",
    "disturbance.png": "Disturbance and its bound.",
    "mpc.png": "Time of each step of the MPC, its active rows of limits, and the slack of the "
               "terminal set.",
    "deviation.png": "Deviation of the real from the nominal motion, and its bounds.",
}
SENSED_CAPTIONS = {
    "force.png": "Force along the direction into the wall, real and measured; depth of tip, plan, "
                 "safe region and wall, real and estimated; estimated stiffness; events; and the "
                 "depths at the contact, enlarged.",
}
"""Captions of a sensed contact, in place of those."""
WIDE = (PORTRAIT, "task_error.png", "inputs.png")


def load_run(folder: Path) -> tuple[Record, AnyCertificate | None]:
    """Returns the record and the certificate, if any, of a folder that a run has written.

    Raises:
        InvalidParameter: Not such a folder, or a certificate of another run.
    """
    record, path = load_record(folder), folder / CERTIFICATE_FILE
    if not record.certified:
        found, declared = _in_probability(path), float(record.declared_duration)
        run = record.scenario if np.isnan(declared) else replace(
            record.scenario, duration=declared)
        fits = found is not None and found.inputs == probability_fingerprint(run)["inputs"]
        return record, found if fits else None
    if not path.is_file():
        raise unusable_folder(folder, f"its {CERTIFICATE_FILE} is missing")
    certificate = read_certificate(path)
    scenario = record.scenario
    if not isinstance(certificate, Certificate) or (
            dump_scenario(certificate.applied_to(scenario)) != dump_scenario(scenario)):
        raise unusable_folder(folder, f"its {CERTIFICATE_FILE} was made for another run")
    return record, certificate


def _in_probability(path: Path) -> ProbabilityCertificate | None:
    """Returns the certificate of a file if it is one in probability."""
    try:
        certificate = read_certificate(path)
    except RunFailed:  # Missing or another's: the run has none.
        return None
    return certificate if isinstance(certificate, ProbabilityCertificate) else None


def format_report(record: Record, figures: Sequence[Path], certificate: AnyCertificate | None,
                  summary: dict[str, Any] | None = None) -> str:
    """Returns the report of a run as HTML.

    Args:
        record: Record of the run.
        figures: PNG files to embed.
        certificate: Certificate of the run, if any.
        summary: Summary of the run; made here if left out.
    """
    scenario, summary = record.scenario, summary or summarise(record, certificate)
    captions = CAPTIONS | (SENSED_CAPTIONS if ESTIMATE in record.signals else {})
    drawn = {path.name: embedded(path, captions.get(path.name)) for path in figures}
    verdict, sound = summary["verdict"], certificate and not summary["verdict"]["status"]
    force = largest_force(certificate, scenario) if (
        sound and isinstance(certificate, Certificate)) else ""
    # The certificate is of the whole duration.
    shortened = float(record.declared_duration) > scenario.duration
    again = (f"uvms-drake run {SCENARIO_FILE}{'' if certificate else ' --uncertified'}"
             + f" --duration {record.declared_duration:g}" * shortened)
    texts = {
        "title": scenario.name, "description": " ".join(scenario.description.split()),
        "summary": format_summary(summary, full=True), "scenario": dump_scenario(scenario),
        "file": SCENARIO_FILE, "version": VERSION, "seed": str(scenario.seed),
        "command": again,
        "drake": summary["versions"]["drake"], "python": summary["versions"]["python"]}
    return PAGE.substitute(
        {name: html.escape(text) for name, text in texts.items()},
        portrait=drawn.pop(PORTRAIT, ""), kept="" if sound else " no",
        figures="".join(drawn.values()) or "<p>Made without figures.</p>",
        verdict="<br>".join(f"{html.escape(line[:1].upper() + line[1:])}." for line in [
            verdict["text"], *([f"largest force {force}"] if force else [])]),
        certificate=_certificate(certificate, scenario, verdict["text"]))


def _certificate(certificate: AnyCertificate | None, scenario: Scenario, verdict: str) -> str:
    """Returns the section of the certificate of a scenario, of either kind.

    The verdict of the run is first: the certificate's own is for any run within its scope.
    """
    if certificate is None:
        return "<p>Run without a certificate, with the tube that the scenario declares.</p>"
    of_run = f"<p>Of this run: {html.escape(verdict)}. Of any run within its scope:</p>"
    if isinstance(certificate, ProbabilityCertificate):
        return f"{of_run}<pre>{html.escape(format_probability(certificate))}</pre>"
    return (f"{of_run}<pre>{html.escape(format_overview(certificate, scenario))}</pre>"
            "<details><summary>Everything: constants, conditions, tube, budget, estimates</summary>"
            f"<pre>{html.escape(str(certificate))}</pre></details>")


def embedded(path: Path, caption: str | None) -> str:
    """Returns a PNG file as a figure of a page."""
    data = base64.b64encode(path.read_bytes()).decode()
    caption = html.escape(caption or path.stem.replace("_", " "))
    wide = ' class="wide"' if path.name in WIDE else ""
    return (f'<figure{wide}><img alt="{caption}" src="data:image/png;base64,{data}">'
            f"<figcaption>{caption}</figcaption></figure>")
