"""The files of an identification: the robot's numbers, its unknowns, everything as JSON."""

import hashlib
import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from uvms_drake.common.jsonable import write_json
from uvms_drake.common.schema import dump_typed
from uvms_drake.identification.identify import Identification, Result
from uvms_drake.identification.log import STATE
from uvms_drake.identification.robot_file import FILE, source_of, with_numbers
from uvms_drake.plant.model_error import BODIES, COEFFICIENTS, scaled_hydrodynamics
from uvms_drake.station.scenario.identified import Identified

UNKNOWNS_FILE, DATA_FILE = "unknowns.yaml", "identification.json"
COVERED = (0.99, 0.999)
"""Quantiles of the residual that are written."""


def format_result(result: Result) -> str:
    """Returns a parameter in one line: value, interval, unit and the file's value."""
    each = result.parameter
    shipped = f"the file has {each.value:.4g}"
    if result.why:
        return f"{each.name:32s} not identified: {result.why}; {shipped} {each.unit}"
    low, high = sorted(result.interval)
    return (f"{each.name:32s} {result.value:8.4g} in [{low:.4g}, {high:.4g}] {each.unit}; "
            f"{shipped}")


def sources(digests: dict[str, str], confidence: float) -> list[str]:
    """Returns the source of the numbers, a line each: the logs and their digests."""
    return [f"Identified by 'uvms-drake identify', intervals of {confidence:.0%}, from",
            *(f"  {name}" for name in named(digests))]


def named(digests: dict[str, str]) -> list[str]:
    """Returns the logs, each with the beginning of its digest."""
    return [f"{name} (SHA-256 {digest[:16]})" for name, digest in digests.items()]


def format_hydrodynamics(found: Identification, digests: dict[str, str]) -> str:
    """Returns the robot's file with the identified numbers, and their list in front."""
    before = found.robot.uvms.hydrodynamics
    after = scaled_hydrodynamics(found.robot.uvms, found.error)
    head = [*sources(digests, found.confidence), "", *map(format_result, found.identified), "",
            "Comments below are of the file before."]
    return "".join(f"# {line}".rstrip() + "\n" for line in head) + "\n" + with_numbers(
        source_of(found.robot.folder), before, after)


def format_unknowns(found: Identification, digests: dict[str, str]) -> str:
    """Returns two keys of a scenario with the identified robot, its `model_error` and `identified`.

    The residual d is a comment.
    """
    lines = [f"# {line}" for line in sources(digests, found.confidence)]
    lines += [f"# {each.parameter.name} was not identified: an error of it is for you to declare"
              for each in found.results if each.why]
    lines.append("# Intervals, no bounds: a certificate with them holds as far as they do.")
    unknowns = found.unknowns
    lines.append("model_error:")
    if unknowns.buoyancy != 1.0:
        lines.append(f"  buoyancy: {_up(unknowns.buoyancy)}")
    if np.any(unknowns.buoyancy_shift):
        lines.append(f"  buoyancy_shift: {_up(unknowns.buoyancy_shift)}  # m")
    for body in BODIES:
        factors = {name: f for name in COEFFICIENTS
                   if np.any((f := unknowns.by_axis(body, name)) != 1.0)}
        lines += [f"  {body}:"] * bool(factors)
        lines += [f"    {name}: {_up(f)}" for name, f in factors.items()]
    sizes = residual_sizes(found)
    lines += ["", "# Size of the vehicle's residual d [m/s², rad/s²] that "
              f"{COVERED[1]:.1%} of the samples are within:"]
    lines += [f"# residual of {axis}: {size:.3g}" if np.isfinite(size) else
              f"# residual of {axis}: not measured"
              for axis, size in zip(("surge", "sway", "heave", "roll", "pitch", "yaw"),
                                    sizes, strict=True)]
    identified = Identified(named(digests), hashlib.sha256(
        format_hydrodynamics(found, digests).encode()).hexdigest(), **found.excitation)
    lines += ["", "identified:", textwrap.indent(dump_typed(identified), "  ")]
    return "\n".join(lines)


def _up(values: Any) -> Any:
    """Returns numbers rounded up to the fourth decimal, in lists for an array."""
    if np.ndim(values):
        return [_up(float(each)) for each in values]
    return math.ceil(1e4 * values - 1e-9) / 1e4


def residual_sizes(found: Identification, quantile: float = COVERED[1]) -> np.ndarray:
    """Returns a quantile of |d| by axis (6,) [m/s², rad/s²]; nan where none was measured."""
    sizes = np.abs(found.residual.reshape(-1, 6))
    return np.array([np.quantile(each[np.isfinite(each)], quantile)
                     if np.any(np.isfinite(each)) else np.nan for each in sizes.T])


def validation_rms(found: Identification) -> dict[str, float]:
    """Returns the rms error of the held-out prediction of each part of x that was measured."""
    flat = found.validation.reshape(-1, len(STATE))
    return {name: float(np.sqrt(np.mean(each[np.isfinite(each)]**2)))
            for name, each in zip(STATE, flat.T, strict=True) if np.any(np.isfinite(each))}


def data_of(found: Identification, digests: dict[str, str]) -> dict[str, Any]:
    """Returns everything that was found, for `identification.json`."""
    return {
        "robot": found.robot.name, "confidence": found.confidence, "logs": digests,
        "windows": len(found.windows.start), "refused": found.refused,
        "parameters": {each.parameter.name: {
            "value": each.value, "interval": None if each.why else sorted(each.interval),
            "unit": each.parameter.unit, "file": each.parameter.value, "why": each.why}
            for each in found.results},
        "validation_rms": validation_rms(found), "excitation": found.excitation,
        "residual": {f"{q:g}": residual_sizes(found, q) for q in COVERED}}


def write_files(found: Identification, digests: dict[str, str], folder: Path) -> Sequence[str]:
    """Writes `hydrodynamics.yaml`, `unknowns.yaml` and `identification.json`; their names."""
    (folder / FILE).write_text(format_hydrodynamics(found, digests), encoding="utf-8")
    (folder / UNKNOWNS_FILE).write_text(format_unknowns(found, digests), encoding="utf-8")
    write_json(data_of(found, digests), folder / DATA_FILE)
    return (FILE, UNKNOWNS_FILE, DATA_FILE)
