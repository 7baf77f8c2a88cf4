"""The report of a run: one HTML file with everything in it, to be mailed, read and printed."""

import base64
import html
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import uvms_drake
from uvms_drake.certificate.certificate import CERTIFICATE_FILE, Certificate, read_certificate
from uvms_drake.certificate.table import format_certificate, verdict
from uvms_drake.common.errors import InvalidParameter, ScenarioError
from uvms_drake.report.events import ALARMING
from uvms_drake.report.signals import wrench_unit
from uvms_drake.report.summary import span, summarise
from uvms_drake.station.record import SCENARIO_FILE, Record, load_record
from uvms_drake.station.scenario import dump_scenario

STYLE = """
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
table { border-collapse: collapse; font-size: .92em; font-variant-numeric: tabular-nums; }
th, td { padding: .1rem .9rem .16rem 0; text-align: left; vertical-align: top; }
th { font-weight: normal; color: var(--soft); }
thead th { border-bottom: 1px solid var(--rule); }
.number { text-align: right; }
.columns table { font-size: .85em; }
.columns { display: grid; grid-template-columns: repeat(auto-fit, minmax(21rem, 1fr));
           gap: 0 2.5rem; align-items: start; }
.figures { display: grid; grid-template-columns: repeat(2, 1fr); gap: 1rem 2rem;
           grid-auto-flow: dense; align-items: start; }
figure { margin: 0; break-inside: avoid; }
figure.wide { grid-column: span 2; }
figure img { width: 100%; height: auto; display: block; }
figcaption { font-size: .85em; color: var(--soft); }
pre, code { font: 12px/1.45 "DejaVu Sans Mono", Consolas, Menlo, monospace; }
pre { background: #f6f7f9; padding: .7rem .9rem; overflow-x: auto; white-space: pre-wrap; }
summary { cursor: pointer; color: var(--blue); }
.violated { font-weight: bold; }
@page { size: A4; margin: 16mm; }
@media print {
  body { margin: 0; padding: 0; max-width: none; font-size: 10pt; }
  pre, code { font-size: 6.5pt; }
  h2 { break-after: avoid; }
  table, .verdict { break-inside: avoid; }
}
"""

CAPTIONS = {
    "task_error.png": "Task error χ − χ_des, and the same close to zero with the tube.",
    "force.png": "Force on the surface, and penetration with its limit in a plane that is known; "
                 "after an approach, also the force from first contact to settling.",
    "velocities.png": "Velocities of vehicle and joints with their limits.",
    "joints.png": "Joint angles with their limits.",
    "inputs.png": "Acceleration commands with their limits.",
    "disturbance.png": "Disturbance and its bound.",
    "mpc.png": "Time of each step of the MPC, and the slack of the terminal set.",
    "deviation.png": "Deviation of the real from the nominal motion, and its bounds.",
    "position_errors.png": "Position errors, as in the paper.",
    "orientation_errors.png": "Orientation errors, as in the paper.",
    "input_norms.png": "Norms of the inputs, as in the paper.",
}
WIDE = ("task_error.png", "inputs.png")


def load_run(folder: Path) -> tuple[Record, Certificate | None]:
    """Returns the record and the certificate, if it has one, of a folder that a run has written.

    Raises:
        InvalidParameter: It is no such folder, or the certificate in it is not the run's.
    """
    def refused(why: str) -> InvalidParameter:
        return InvalidParameter("DIR", str(folder), f"a folder that 'run' has written ({why})")

    try:
        record = load_record(folder)
    except OSError as error:
        name = Path(error.filename).name if error.filename else str(folder)
        raise refused(f"{name}: {error.strerror or error}") from None
    except (KeyError, ValueError, BadZipFile, ScenarioError) as error:
        raise refused(" ".join(str(error).split())) from None
    if not record.certified:
        return record, None
    path = folder / CERTIFICATE_FILE
    if not path.is_file():
        raise refused(f"its {CERTIFICATE_FILE} is missing")
    certificate = read_certificate(path)
    scenario = record.scenario
    if dump_scenario(certificate.applied_to(scenario)) != dump_scenario(scenario):
        raise refused(f"its {CERTIFICATE_FILE} was made for another run")
    return record, certificate


def format_report(record: Record, figures: Sequence[Path], certificate: Certificate | None) -> str:
    """Returns the report of a run as HTML.

    Args:
        record: Of the run.
        figures: PNG files to put in.
        certificate: Of the run, if it has one.
    """
    scenario = record.scenario
    summary: dict[str, Any] = summarise(record)
    title = html.escape(scenario.name)
    parts = [
        f"<h1>{title}</h1>",
        f'<p class="lead">{html.escape(" ".join(scenario.description.split()))}</p>',
        _verdict(certificate),
        "<h2>Key numbers</h2>", f'<div class="columns">{_run(summary)}{_limits(summary)}</div>',
        "<h2>Events</h2>", _events(summary["events"]),
        "<h2>Figures</h2>",
        f'<div class="figures">{"".join(_figure(path) for path in figures)}</div>'
        if figures else "<p>Made without figures.</p>",
        "<h2>Certificate</h2>",
        f"<pre>{html.escape(format_certificate(certificate))}</pre>" if certificate
        else "<p>Run without a certificate, with the tube that the scenario declares.</p>",
        "<h2>Scenario</h2>",
        "<details><summary>Every value, with the defaults filled in "
        f"({SCENARIO_FILE})</summary><pre>{html.escape(dump_scenario(scenario))}</pre></details>",
        "<h2>Run it again</h2>", _reproduction(summary, certificate),
    ]
    return (f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            '<meta name="viewport" content="width=device-width">\n'
            '<link rel="icon" href="data:,">\n'
            f"<title>{title}: report</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
            + "\n".join(parts) + "\n</body>\n</html>\n")


def _verdict(certificate: Certificate | None) -> str:
    if certificate is None:
        return ('<p class="verdict no">Run without a certificate: the tube is declared, and '
                "nothing is guaranteed.</p>")
    bounds = certificate.bounds
    finally_ = (f" Once the plan is at the task, the force is off by less than "
                f"{bounds['force']:.3g} N."
                if "force" in bounds else "")
    return (f'<p class="verdict{"" if certificate.certified else " no"}">'
            f"{html.escape(verdict(certificate)[:1].upper() + verdict(certificate)[1:])}."
            f"{finally_}</p>")


def _run(summary: dict[str, Any]) -> str:
    force, mpc, tube = summary["force"], summary["mpc"], summary["tube"]
    disturbance, overshoot = summary["disturbance"], force["overshoot"]
    task, ratio, step = summary["task_error"], tube["worst_ratio"], mpc["step_ms"]
    desired, unit = math.hypot(*force["desired"]), wrench_unit(force["desired"])
    rows = [
        ("desired force", f"{desired:.4g} {unit}"),
        ("force settled after", _number(force["settling_time_s"], ".2f", "s", "never")),
        ("force error at the end", f"{force['final_error_norm']:.3g} {unit}"),
        ("largest force", _number(force["peak_normal"], ".4g", "N")),
        ("impact overshoot", "started in contact" if overshoot is None
         else _number(overshoot["percent"], ".3g", "%")),
        ("task error at the end", f"{task['final_norm']:.3g} m, rad"),
        ("deviation over the tube", f"{_number(ratio['set'], '.1%')} at most, "
                                    f"{tube['exits']} exits"),
        ("along the run", f"{_number(ratio['trajectory'], '.1%')} at most, "
                          f"{tube['exits_along_the_run']} exits"),
        ("disturbance", f"{disturbance['applied']:.3g} applied, {disturbance['worst']:.3g} with "
                        "what the controller does not know, bound "
                        f"{disturbance['bound']:.3g}"),
        ("MPC", f"{mpc['solves']} solves, {mpc['failures']} failures, {mpc['late']} late, "
                f"{mpc['dropped']} dropped"),
        ("step of the MPC", f"{_number(step['p50'], '.1f', 'ms')} median, "
                            f"{_number(step['p99'], '.1f', 'ms')} p99"),
        ("simulated", f"{summary['duration_s']:g} s in {summary['wall_time_s']:.1f} s"),
    ]
    return "<table>" + "".join(
        f"<tr><th>{name}</th><td>{value}</td></tr>" for name, value in rows) + "</table>"


def _limits(summary: dict[str, Any]) -> str:
    rows = []
    for name, row in summary["constraints"].items():
        kept = row["margin"] >= 0.0
        cells = "".join(f'<td class="number">{row[key]:.4g}</td>'
                        for key in ("limit", "worst", "margin"))
        rows.append(f"<tr><th>{html.escape(name)}</th>{cells}"
                    f'<td class="violated">{"" if kept else "VIOLATED"}</td></tr>')
    return ("<table><thead><tr><th>limit</th>"
            + "".join(f'<th class="number">{name}</th>' for name in ("is", "worst", "margin"))
            + f"<th></th></tr></thead><tbody>{''.join(rows)}</tbody></table>")


def _events(events: list[dict[str, Any]]) -> str:
    if not events:
        return "<p>None.</p>"
    rows = []
    for event in events:
        mark = ' class="violated"' if event["kind"] in ALARMING else ""
        rows.append(f"<tr><th>{span(event)}</th><td{mark}>{html.escape(event['text'])}</td></tr>")
    return f"<table>{''.join(rows)}</table>"


def _figure(path: Path) -> str:
    data = base64.b64encode(path.read_bytes()).decode()
    caption = html.escape(CAPTIONS.get(path.name, path.stem.replace("_", " ")))
    wide = ' class="wide"' if path.name in WIDE else ""
    return (f'<figure{wide}><img alt="{caption}" src="data:image/png;base64,{data}">'
            f"<figcaption>{caption}</figcaption></figure>")


def _reproduction(summary: dict[str, Any], certificate: Certificate | None) -> str:
    versions = summary["versions"]
    command = f"uvms-drake run {SCENARIO_FILE}{'' if certificate else ' --uncertified'}"
    return (f"<p>With the scenario above in <code>{SCENARIO_FILE}</code>:</p>"
            f"<pre>{command}</pre>"
            f"<p>uvms_drake {uvms_drake.__version__}, Drake {html.escape(versions['drake'])}, "
            f"Python {html.escape(versions['python'])}, seed {summary['seed']}.</p>")


def _number(value: float | None, spec: str, unit: str = "", missing: str = "–") -> str:
    return missing if value is None else f"{value:{spec}} {unit}".rstrip()
