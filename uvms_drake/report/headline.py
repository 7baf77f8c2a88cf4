"""The sentence that sums up a run, for a reader who reads nothing else."""

from typing import Any

import numpy as np

BANDS = {"motion": "at touch and in motion", "hold": "in a hold"}
"""Names of the bands of the force of a sensed contact."""
NAMED = ("tube", "limit", "contact")
"""Kinds of `in_probability.FAILURES` that `broken` names."""


def broken(summary: dict[str, Any]) -> list[str]:
    """Returns the limits that a run has violated and, of a certified one, the bounds it left.

    With a certificate in probability also exits of the declared tube, and a lost contact.
    """
    names, tube = violated_limits(summary), summary["tube"]
    names += [f"the force band {BANDS[name]}" for name, row in
              summary["contact"].get("force_bands", {}).items() if row and row["exits"]]
    counted = summary.get("in_probability") is not None
    names += ["the contact, lost"] * bool(counted and summary["contact"]["losses"])
    return names + [f"the tube, {what}" for key, what in (
        ("exits", "set-wise"), ("exits_along_the_run", "along the run"))
        if (tube["certified"] or counted) and tube[key]]


def violated_limits(summary: dict[str, Any]) -> list[str]:
    """Returns the limits that a run has violated."""
    return [name for name, row in summary["constraints"].items() if not row["margin"] >= 0.0]


def headline(summary: dict[str, Any]) -> str:
    """Returns one sentence: the task, its errors, the largest force, the tube and the limits."""
    parts = [_task(summary)]
    if summary["contact"]["first_touch_s"] is not None:
        parts.append(f"at most {summary['contact']['largest_force']:.3g} N in contact")
    parts.append(used(summary["tube"], summary.get("in_probability") is not None))
    failed = violated_limits(summary)
    parts.append(f"VIOLATED: {', '.join(failed)}" if failed else "all limits kept")
    return f"{summary['scenario']}: {'; '.join(parts)}."


def used(tube: dict[str, Any], in_probability: bool = False) -> str:
    """Returns the share of the tube that the run used, the largest of its parts.

    Args:
        tube: As of the summary.
        in_probability: Whether the run has a certificate in probability.
    """
    kind = "certified in probability" if in_probability else "not certified"
    name = "certified tube" if tube["certified"] else f"declared tube ({kind})"
    ratio = tube["worst_ratio"]["set"]
    if tube["worst_e"] is None or ratio is None or not np.isfinite(ratio):
        return f"{name} not watched"
    return f"{100.0 * ratio:.3g} % of the {name} used"


def _task(summary: dict[str, Any]) -> str:
    """Returns the outcome of the mission, of the desired force, or of the pose without one."""
    force, mission, contact = summary["force"], summary["mission"], summary["contact"]
    if mission:
        return _mission(mission)
    magnitude = float(np.linalg.norm(force["desired"][:3]))
    if not np.any(force["desired"]):
        error = np.asarray(summary["task_error"]["final"])
        return (f"no force desired, end-effector off by {1e3 * np.linalg.norm(error[:3]):.3g} mm "
                f"and {1e3 * np.linalg.norm(error[3:]):.3g} mrad at the end")
    if magnitude == 0.0:
        return f"torque desired, off by {force['final_error_norm']:.3g} N m at the end"
    if contact["first_touch_s"] is None:
        return f"{magnitude:.4g} N desired, the surface was never touched"
    settled = force["settling_time_s"]
    when = ("not held within the tolerance" if settled is None else
            f"held within {force['tolerance']:.3g} N from {settled:.2f} s on")
    return (f"{magnitude:.4g} N {when}, normal force off by "
            f"{abs(force['final_error_normal']):.2g} N at the end")


def _mission(mission: dict[str, Any]) -> str:
    """Returns how a mission went: its outcome, its steps, and the force of those in contact."""
    steps = mission["steps"]
    done = len({row["step"] for row in steps if row["ended"] == "done"})
    total = len({row["step"] for row in steps}) + mission["not_begun"]
    when = "" if mission["over_s"] is None else f" after {mission['over_s']:.1f} s"
    text = f"mission {mission['outcome']}{when}, {done} of {total} steps done"
    pressed = [row for row in steps if "force_rms" in row]
    if pressed:
        text += (f", normal force off by {max(row['force_rms'] for row in pressed):.2g} N rms in "
                 f"the worst of {len(pressed)} measurements")
    return text
