"""Report of a run: one self-contained HTML file."""

import base64
import html
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from uvms_drake.certificate.certificate import (
    CERTIFICATE_FILE,
    AnyCertificate,
    Certificate,
    probability_fingerprint,
    read_certificate,
)
from uvms_drake.certificate.in_probability import ProbabilityCertificate
from uvms_drake.certificate.text import format_overview, format_probability, scope
from uvms_drake.common.errors import RunFailed
from uvms_drake.common.program import VERSION
from uvms_drake.report.contact_figures import ESTIMATE
from uvms_drake.report.summary import format_summary, summarise
from uvms_drake.station.record import SCENARIO_FILE, Record, load_record, unusable_folder
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario

PAGE_STYLE = """
:root { color-scheme: light; --ink: #1a1a1a; --soft: #5a5f66; --rule: #d5d9de; --blue: #0072b2; }
* { box-sizing: border-box; }
body { font: 15px/1.5 "Charter", "Bitstream Charter", "Iowan Old Style", Georgia, serif;
       color: var(--ink); background: #fff;
       max-width: 60rem; margin: 2.5rem auto; padding: 0 1.5rem; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.1rem; margin: 2.2rem 0 .6rem; padding-bottom: .2rem;
     border-bottom: 1px solid var(--rule); }
p { margin: .4rem 0; }
.lead { font-size: 1.05rem; color: var(--soft); }
.verdict { border-left: 4px solid var(--blue); padding: .3rem .8rem; margin: 1rem 0; }
.verdict.no { border-left-style: dashed; border-color: #d55e00; }
.figures { display: grid; grid-template-columns: repeat(2, 1fr); gap: 1rem 2rem;
           grid-auto-flow: dense; align-items: start; }
figure { margin: 0; break-inside: avoid; }
figure.wide { grid-column: span 2; }
figure img { width: 100%; height: auto; display: block; }
figcaption { font-size: .85em; color: var(--soft); }
pre, code { font: 12px/1.45 "DejaVu Sans Mono", Consolas, Menlo, monospace; }
pre { background: #fbfcfd; padding: .7rem .9rem; overflow-x: auto; white-space: pre-wrap; }
summary { cursor: pointer; color: var(--blue); }
@page { size: A4; margin: 16mm; }
@media print {
  body { margin: 0; padding: 0; max-width: none; font-size: 10pt; }
  pre, code { font-size: 6.5pt; }
  h2 { break-after: avoid; }
  .verdict { break-inside: avoid; }
}
"""

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
        found = _in_probability(path)
        fits = found is not None and (
            found.inputs == probability_fingerprint(record.scenario)["inputs"])
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
                  failed: Sequence[str] = ()) -> str:
    """Returns the report of a run as HTML.

    Args:
        record: Record of the run.
        figures: PNG files to embed.
        certificate: Certificate of the run, if any.
        failed: With a certificate in probability, the ways in which the run itself failed.
    """
    scenario = record.scenario
    summary: dict[str, Any] = summarise(record, certificate)
    title = html.escape(scenario.name)
    captions = CAPTIONS | (SENSED_CAPTIONS if ESTIMATE in record.signals else {})
    drawn = {path.name: _figure(path, captions.get(path.name)) for path in figures}
    portrait = drawn.pop(PORTRAIT, "")
    parts = [
        f"<h1>{title}</h1>",
        f'<p class="lead">{html.escape(" ".join(scenario.description.split()))}</p>',
        _verdict(certificate, summary, failed), portrait,
        "<h2>Summary</h2>", f"<pre>{html.escape(format_summary(summary, event_lines=None))}</pre>",
        "<h2>Figures</h2>",
        f'<div class="figures">{"".join(drawn.values())}</div>' if drawn
        else "<p>Made without figures.</p>",
        "<h2>Certificate</h2>",
        _certificate(certificate, scenario),
        "<h2>Scenario</h2>",
        "<details><summary>Every value, with the defaults filled in "
        f"({SCENARIO_FILE})</summary><pre>{html.escape(dump_scenario(scenario))}</pre></details>",
        "<h2>Run it again</h2>", _reproduction(summary, certificate),
    ]
    return (f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            '<meta name="viewport" content="width=device-width">\n'
            '<link rel="icon" href="data:,">\n'
            f"<title>{title}: report</title>\n<style>{PAGE_STYLE}</style>\n</head>\n<body>\n"
            + "\n".join(parts) + "\n</body>\n</html>\n")


def _certificate(certificate: AnyCertificate | None, scenario: Scenario) -> str:
    """Returns the section of the certificate of a scenario, of either kind."""
    if certificate is None:
        return "<p>Run without a certificate, with the tube that the scenario declares.</p>"
    if isinstance(certificate, ProbabilityCertificate):
        return f"<pre>{html.escape(format_probability(certificate))}</pre>"
    return (f"<pre>{html.escape(format_overview(certificate, scenario))}</pre>"
            "<details><summary>Everything: constants, conditions, tube, budget, estimates</summary>"
            f"<pre>{html.escape(str(certificate))}</pre></details>")


def _verdict(certificate: AnyCertificate | None, summary: dict[str, Any], failed: Sequence[str]
             ) -> str:
    if certificate is None:
        return ('<p class="verdict no">Run without a certificate: the tube is declared, and '
                "nothing is guaranteed.</p>")
    if isinstance(certificate, ProbabilityCertificate):
        outside = summary["in_probability"]["outside"]
        text = "; ".join(outside) or certificate.verdict
        own = f"This run FAILED: {html.escape(', '.join(failed))}.<br>" if failed else ""
        return (f'<p class="verdict{" no" if outside or failed else ""}">{own}'
                f"{html.escape(text[:1].upper() + text[1:])}.</p>")
    sentence = certificate.force_sentence
    finally_ = f" {sentence[:1].upper()}{sentence[1:]}." if sentence else ""
    return (f'<p class="verdict{"" if certificate.certified else " no"}">'
            f"{'<br>'.join(map(html.escape, scope(certificate)))}<br>"
            f"{html.escape(certificate.verdict[:1].upper() + certificate.verdict[1:])}."
            f"{finally_}</p>")


def _figure(path: Path, caption: str | None) -> str:
    data = base64.b64encode(path.read_bytes()).decode()
    caption = html.escape(caption or path.stem.replace("_", " "))
    wide = ' class="wide"' if path.name in WIDE else ""
    return (f'<figure{wide}><img alt="{caption}" src="data:image/png;base64,{data}">'
            f"<figcaption>{caption}</figcaption></figure>")


def _reproduction(summary: dict[str, Any], certificate: AnyCertificate | None) -> str:
    versions = summary["versions"]
    command = f"uvms-drake run {SCENARIO_FILE}{'' if certificate else ' --uncertified'}"
    return (f"<p>With the scenario above in <code>{SCENARIO_FILE}</code>:</p>"
            f"<pre>{command}</pre>"
            f"<p>uvms_drake {VERSION}, Drake {html.escape(versions['drake'])}, "
            f"Python {html.escape(versions['python'])}, seed {summary['seed']}.</p>")
