"""Safety of a run: the retreat of its supervisor as data, and its sentence."""

from typing import Any

import numpy as np

from uvms_drake.control.supervisor.detections import CAUSES
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.record import Record

SEPARATE = 0.1
"""Force along n below which the tip is off the wall [N]."""


def summarise_safety(record: Record) -> dict[str, Any]:
    """Returns the safety of a run: empty without a supervisor.

    `retreated_s` is None without a retreat; `ratios` are the largest values of the detections over
    their thresholds until then. `off_wall_s` is the time from the detection to the last contact.
    """
    if "safety" not in record.signals:
        return {}
    contact = sensed_contact(record.scenario)
    force = record.force[:, :3] @ np.asarray(contact.direction, dtype=float)
    last = record.signals["safety"][-1]
    out: dict[str, Any] = {"retreated_s": None, "ratios": dict(zip(
        CAUSES, record.signals["safety_ratio"][-1], strict=True))}
    if last[0] == 0.0:
        return out
    time, after = record.trip, ~record.followed
    touching = record.time[after & (force > SEPARATE)]
    start = record.state[after, :3][:1]
    out |= {
        "retreated_s": time, "cause": list(CAUSES)[int(last[1]) - 1],
        "stiffness": last[3] if np.isfinite(last[3]) else None,
        "declared_stiffness": contact.stiffness,
        "largest_force": float(np.max(force, initial=0.0)),
        "seconds_above_limit": float(np.sum(force > contact.force)) * record.scenario.log_period,
        "off_wall_s": float(touching[-1] - time) if len(touching) else 0.0,
        "off_wall": not force[-1] > SEPARATE,
        "distance": float(np.max(np.linalg.norm(
            record.state[after, :3] - start, axis=1), initial=0.0)),
        "filtered": bool(np.any(record.signals["input_filtered"]))}
    return out | {"text": retreat_sentence(out)}


def retreat_sentence(safety: dict[str, Any]) -> str:
    """Returns the sentence about a retreat."""
    text = f"retreated at {safety['retreated_s']:.1f} s: {CAUSES[safety['cause']]}"
    if safety["cause"] == "slope" and safety["stiffness"] is not None:
        text += (f" ({1e-3 * safety['stiffness']:.2g} kN/m, "
                 f"{1e-3 * safety['declared_stiffness']:.2g})")
    state = "" if safety["off_wall"] else ", and NOT off the wall at the end"
    joints = ", joints kept off their stops" if safety["filtered"] else ""
    return f"{text}; {safety['largest_force']:.3g} N at most{joints}{state}"
