"""Safety of a run: the retreat of its supervisor as data, and its sentence."""

from dataclasses import replace
from typing import Any

import numpy as np

from uvms_drake.model.signals.sensor_actuator import CAUSES
from uvms_drake.station.contact.bounds import largest_force, pressing_force, sensed_contact
from uvms_drake.station.record import Record

SECOND, STILL = 1.0, 0.05
"""Time over which a vehicle's motion at the end counts [s], and the speed of one that stands [m/s].
"""
SEPARATE = 0.1
"""Force along n below which the tip is off the wall [N]."""


def summarise_safety(record: Record) -> dict[str, Any]:
    """Returns the safety of a run: empty without a supervisor.

    Of several retreats it is the first one. `retreated_s` is None without one; `ratios` are the
    largest values of the detections over their thresholds while plans are followed. `off_wall_s` is
    the time from the detection to the last contact; `admitted_force` the largest desired force that
    the safe region would admit by the stiffness that was seen.
    """
    if "safety" not in record.signals:
        return {}
    scenario, safety, after = record.scenario, record.signals["safety"], ~record.followed
    contact = sensed_contact(scenario)
    force = record.force[:, :3] @ np.asarray(contact.direction, dtype=float)
    out: dict[str, Any] = {"retreated_s": None, "ratios": dict(zip(
        CAUSES, record.signals["safety_ratio"][-1], strict=True))}
    if not after.any():
        return out
    # The first retreat.
    begins = np.cumsum(after & ~np.append(False, after[:-1]))
    during = after & (begins == 1)
    time, (_, number, _, stiffness, cut) = record.trip, safety[during][-1]
    cause, settings = list(CAUSES)[int(number) - 1], scenario.supervisor
    touching, place = record.time[during & (force > SEPARATE)], record.state[during, :3]
    # The end of the retreat, and the class that its stiffness would make.
    last = record.time[during] > record.time[during][-1] - SECOND
    drift = float(np.linalg.norm(np.ptp(place[last], axis=0))) / SECOND
    assert settings is not None
    way = 2.0 * settings.distance / settings.speed
    stiff, known = np.isfinite(stiffness) and cause == "slope", record.model.thrusters
    out |= {
        "retreated_s": time, "retreats": int(begins[-1]), "cause": cause,
        "stiffness": stiffness if np.isfinite(stiffness) else None,
        "declared_stiffness": contact.stiffness,
        "admitted_force": largest_force(replace(scenario, contact=replace(
            contact, stiffness=float(stiffness)))) if stiff else None,
        "largest_force": float(np.max(force, initial=0.0)),
        "seconds_above_limit": float(np.sum(force > contact.force)) * scenario.log_period,
        "off_wall_s": float(touching[-1] - time) if len(touching) else 0.0,
        "off_wall": not force[during][-1] > SEPARATE,
        "distance": float(np.max(np.linalg.norm(place - place[0], axis=1))),
        "speed": drift, "held": drift < STILL or record.time[during][-1] - time < way,
        "isolated": list(known.thrusters)[int(cut) - 1] if known and cut else None,
        "filtered": bool(np.any(record.signals["input_filtered"][during]))}
    return out | {"text": retreat_sentence(out, pressing_force(scenario))}


def retreat_sentence(safety: dict[str, Any], pressing: float) -> str:
    """Returns the sentence about a retreat from a press with a force [N]."""
    text = f"retreated at {safety['retreated_s']:.1f} s: {CAUSES[safety['cause']]}"
    if safety["admitted_force"] is not None:
        text += (f" ({1e-3 * safety['stiffness']:.2g} kN/m, declared up to "
                 f"{1e-3 * safety['declared_stiffness']:.2g}; with it contact.force would admit "
                 f"{max(safety['admitted_force'], 0.0):.3g} N, asked are {pressing:.3g})")
    parts = [f"{safety['largest_force']:.3g} N at most"]
    if safety["isolated"]:
        parts.append(f"thruster {safety['isolated']} without power")
    if safety["filtered"]:
        parts.append("joints kept off their stops")
    if safety["retreats"] > 1:
        parts.append(f"the first of {safety['retreats']} retreats")
    if not safety["off_wall"]:
        parts.append("NOT off the wall at the end")
    if not safety["held"]:
        parts.append(f"NOT held: {safety['distance']:.2g} m off, and {safety['speed']:.2g} m/s")
    return f"{text}; {', '.join(parts)}"
