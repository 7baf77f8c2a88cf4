"""Runs and certificates of the paper's simulation as files: log, summary, its three figures.

A scenario names this module by its key `simulation`. The figures compare one by one with those of
the paper: position errors, orientation errors (angles modulo 2π), and the norms of the inputs with
their limit; real is solid, nominal dashed, time below.
"""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from uvms_drake.certificate.certificate import CERTIFICATE_FILE
from uvms_drake.common.errors import RunFailed
from uvms_drake.common.jsonable import write_json
from uvms_drake.common.progress import Progress, silent
from uvms_drake.control.limits import resolved_radii
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.papers.nikou2018.kinematic_certificate import KinematicCertificate, certify
from uvms_drake.papers.nikou2018.kinematics import BLOCKS, Run, limited_angles, simulate
from uvms_drake.report.drawing import Drawing, Panel, Series, line, save
from uvms_drake.report.figure_style import BLACK, LIMIT, XYZ
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario

HEIGHT = 2.4  # inches
FIGURES = ("position_errors.png", "orientation_errors.png", "input_norms.png")
FILES = ("scenario.yaml", "log.npz", "summary.json", CERTIFICATE_FILE, *FIGURES)
"""Names of all files."""
WITHIN = 1.0 + 1e-2
"""Deviation over a radius that is no exit: a constant w takes it there, and the integrator errs."""


def certify_into(scenario: Scenario, folder: Path, progress: Progress = silent
                 ) -> KinematicCertificate:
    """Returns a scenario's certificate and writes it."""
    certificate = certify(scenario, progress)
    write_json(asdict(certificate), folder / CERTIFICATE_FILE)
    return certificate


def run_into(scenario: Scenario, folder: Path, *, certified: bool, figures: bool,
             progress: Progress = silent) -> dict[str, Any]:
    """Simulates a scenario, writes the files of the run, and returns its summary.

    Args:
        scenario: The scenario.
        folder: Folder to write to.
        certified: Whether the tube is that of a certificate; else it is the declared one.
        figures: Whether the figures are drawn.
        progress: Progress callback.

    Raises:
        RunFailed: There is no certificate, or no run.
    """
    if certified:
        certificate = certify_into(scenario, folder, progress)
        if not certificate.certified:
            failed = next(each for each in certificate.conditions if not each.holds)
            raise RunFailed(f"{scenario.name}: not certified ({failed}); --uncertified takes the "
                            "scenario's declared tube")
        scenario = certificate.applied_to(scenario)
    run = simulate(scenario, progress)
    summary = summarise(run, certified=certified)
    (folder / "scenario.yaml").write_text(dump_scenario(scenario), encoding="utf-8")
    np.savez_compressed(folder / "log.npz", **run.arrays())  # type: ignore[arg-type]
    write_json(summary, folder / "summary.json")
    if figures:
        for name, made in zip(FIGURES, (position, orientation, inputs), strict=True):
            save(made(run), folder / name)
    return summary


def summarise(run: Run, *, certified: bool) -> dict[str, Any]:
    """Returns the summary of a run: errors, use of the limits and of the tube."""
    error = np.linalg.norm(pose_difference(run.chi, run.chi_des), axis=1)
    tube = resolved_radii(run.scenario.tube)
    pose, z = (pose_difference(run.config, run.nominal_config), run.zeta - run.nominal_zeta)
    deviation = {
        "e": pose_difference(run.chi, run.chi_nominal), "joints": pose[:, 6:],
        "roll": pose[:, 3:4], "pitch": pose[:, 4:5], "z": z,
        **{name: z[:, block] for name, block in zip(("nu1", "nu2", "qdot"), BLOCKS, strict=True)}}
    worst = {name: float(np.max(np.linalg.norm(each, axis=1))) for name, each in deviation.items()}
    bounds, y = run.bounds, np.hstack([run.chi, run.config[:, 6:]])
    angles = limited_angles(run.config, y)
    speeds = [float(np.max(np.linalg.norm(run.zeta[:, block], axis=1))) for block in BLOCKS]
    margins = [*(bounds.speeds - speeds), *np.min(np.minimum(
        bounds.upper - angles, angles - bounds.lower), axis=0)]
    return {
        "scenario": run.scenario.name, "duration": float(run.time[-1]), "wall_time": run.wall_time,
        "error": {"start": error[0], "end": error[-1],
                  "last": float(np.max(error[run.time >= run.time[-1] - 1.0]))},
        "margins": dict(zip(bounds.names(), map(float, margins), strict=True)),
        "tube": {name: {"worst": size, "radius": getattr(tube, name)}
                 for name, size in worst.items()},
        "certified": certified,
        "kept": min(margins) >= 0.0 and (not certified or all(
            size <= WITHIN * getattr(tube, name) + 1e-4 for name, size in worst.items()))}


def format_summary(summary: dict[str, Any]) -> str:
    """Returns the summary of a run as text."""
    error, kind = summary["error"], "certified" if summary["certified"] else "declared"
    rows = [
        f"{summary['scenario']}: {summary['duration']:g} s in {summary['wall_time']:.1f} s",
        f"task error    {error['start']:.3g} m, rad at the start, {error['end']:.3g} at the end, "
        f"at most {error['last']:.3g} in the last second", "",
        "limit        margin", *(f"{name:<11}{margin:>8.4g}"
                                 for name, margin in summary["margins"].items()), "",
        f"deviation from the plan, and the {kind} tube",
        *(f"{name:<11}{each['worst']:>8.4g} of {each['radius']:.4g}"
          for name, each in summary["tube"].items())]
    return "\n".join([*rows, "all guarantees kept" if summary["certified"] and summary["kept"] else
                      "all limits kept, without a certificate" if summary["kept"] else
                      "LIMITS VIOLATED or tube left"])


# Figures ------------------------------------------------------------------------------------------


def position(run: Run) -> Drawing:
    """Returns 𝔭 − 𝔭_des, real and nominal."""
    return _errors(run, slice(0, 3), "p", "position errors [m]")


def orientation(run: Run) -> Drawing:
    """Returns 𝔬 − 𝔬_des, real and nominal."""
    return _errors(run, slice(3, 6), "o", "orientation errors [rad]")


def inputs(run: Run) -> Drawing:
    """Returns ‖ν₁‖, ‖ν₂‖ and ‖q̇‖, real and nominal, and the paper's common limit."""
    names = (r"$\|\nu_1\|$", r"$\|\nu_2\|$", r"$\|\dot{q}\|$")
    series = [each for color, block, name in zip(XYZ, BLOCKS, names, strict=True)
              for each in _both([np.linalg.norm(zeta[:, block], axis=1)
                                 for zeta in (run.zeta, run.nominal_zeta)], color, name)]
    limits = [line(limit, LIMIT) for limit in run.bounds.speeds]
    return Drawing([[Panel("input norms [m/s, rad/s]", run.time, [*series, *limits],
                           scale="zero")]], HEIGHT)


def _errors(run: Run, part: slice, letter: str, label: str) -> Drawing:
    real, nominal = (pose_difference(chi, run.chi_des)[:, part]
                     for chi in (run.chi, run.chi_nominal))
    series = [each for i, color in enumerate(XYZ) for each in _both(
        [real[:, i], nominal[:, i]], color, rf"$\mathfrak{{{letter}}}_{i + 1}$")]
    zero = line(0.0, color=BLACK, linewidth=0.5, label="")
    key = [line(0.0, color="0.45"), line(0.0, color="0.45", linestyle="--", label="nominal")]
    return Drawing([[Panel(label, run.time, [*series, zero])]], HEIGHT, legend=5,
                   key=[*series, *key])


def _both(values: list[np.ndarray], color: str, name: str) -> list[Series]:
    """Returns a real value solid, and its nominal one dashed."""
    return [line(values[0], color=color, label=name),
            line(values[1], color=color, linestyle="--", linewidth=0.8, label="")]
