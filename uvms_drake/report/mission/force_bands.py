"""Check of a run against the certified bands of the force of a sensed contact.

In contact the force along n is within b(ℓκ̂/κ₊) of the desired one, ℓ how far the plan is from its
target and κ̂ the stiffness that the target is of: in a hold, once the plan has stood for the time of
`HoldRadii`, by `hold_band`, else by `SensedContact.band`.
tube/contact/theory.md#force-band-of-a-hold.
"""

from typing import Any, NamedTuple

import numpy as np

from uvms_drake.model.frames.spatial import times
from uvms_drake.report.headline import BANDS
from uvms_drake.report.mission.attempts import attempts_of, has_mission
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.contact.hold import STANDING
from uvms_drake.station.record import Record
from uvms_drake.tube.ultimate_bounds import hold_band, tip_errors


class ForceBands(NamedTuple):
    """Error and band of the force along n at the logged instants."""

    error: np.ndarray
    """n·𝐅 − F_des (T,) [N]."""
    bound: np.ndarray
    """b(ℓκ̂/κ₊) (T,) [N]; NaN without contact at the last reading."""
    holds: np.ndarray
    """Whether the band is that of a hold (T,)."""


def desired_force(record: Record) -> np.ndarray:
    """Returns the desired force along n (T,) [N], of a run with a sensed contact."""
    goal: np.ndarray = (
        record.signals["mission_force"][:, 0] if has_mission(record)
        else record.desired_force[:, :3] @ sensed_contact(record.scenario).direction)
    return goal


def force_error(record: Record) -> np.ndarray:
    """Returns the error of the real force along n (T,) [N], likewise."""
    error: np.ndarray = (record.force[:, :3] @ sensed_contact(record.scenario).direction
                         - desired_force(record))
    return error


def force_bands(record: Record) -> ForceBands:
    """Returns the error of the force and its band, likewise."""
    contact, tube = sensed_contact(record.scenario), record.scenario.tube
    goal = desired_force(record)
    short = record.signals["target"] - record.chi_nominal[:, :3]
    lags = np.maximum(contact.walls.advance(short), contact.walls.advance(-short))
    lags = lags * record.signals["stiffness_used"][:, 0] / contact.stiffness  # ℓ counts κ̂ℓ.
    touched = record.signals["touched"][:, 0] > 0.0
    holds = touched & has_stood(record)
    recedes = np.zeros(len(goal))
    for attempt in attempts_of(record) if has_mission(record) else ():
        step = record.scenario.mission.steps[attempt.step]
        recedes[attempt.when] = step.line_speed
    bound, off = np.full(len(goal), np.nan), tip_errors(tube)
    for i in np.flatnonzero(touched):
        bound[i] = contact.band(goal[i], off, recedes[i], lags[i])
        if holds[i] and tube.hold is not None:
            bound[i] = min(bound[i], hold_band(contact, goal[i], tube.hold, lags[i]))
    return ForceBands(force_error(record), bound, holds)


def has_stood(record: Record) -> np.ndarray:
    """Returns whether the plan has stood for the time of a hold (T,); never without one."""
    hold, zeta = record.scenario.tube.hold, record.nominal_zeta
    if hold is None:
        return np.zeros(len(record.time), dtype=bool)
    walls = sensed_contact(record.scenario).walls
    velocity = times(record.model.tip_kinematics(record.nominal_config).J_chi[:, :3], zeta)
    speeds = np.stack([np.maximum(walls.advance(velocity), walls.advance(-velocity)),
                       *(np.linalg.norm(zeta[:, part], axis=1)
                         for part in (slice(3, 6), slice(6, None)))], axis=-1)
    moves = np.any(speeds > STANDING, axis=1)
    last = np.maximum.accumulate(np.where(moves, record.time, -np.inf))
    stood: np.ndarray = record.time - np.maximum(last, record.time[0]) >= hold.time
    return stood


def summarise_bands(record: Record) -> dict[str, Any]:
    """Returns `force_bands`: largest error, smallest band and their largest ratio in both phases.

    Nothing without a certificate or a declared wall; a phase that never was is None.
    """
    if not record.certified or record.scenario.contact.declared_wall() is None:
        return {}
    found = force_bands(record)
    out: dict[str, Any] = {}
    for name, phase in (("motion", ~found.holds), ("hold", found.holds)):
        there = phase & np.isfinite(found.bound)
        ratio = np.abs(found.error[there]) / found.bound[there]
        out[name] = None if not len(ratio) else {
            "share": float(np.mean(there)), "worst_error": float(np.max(np.abs(
                found.error[there]))), "least_bound": float(np.min(found.bound[there])),
            "worst_ratio": float(np.max(ratio)), "exits": int(np.count_nonzero(ratio > 1.0))}
    return {"force_bands": out}


def format_bands(bands: dict[str, Any]) -> list[str]:
    """Returns a line for each phase."""
    return [f"{'':<14}{BANDS[name]} ({100.0 * row['share']:.0f} % of the run) off by at most "
            f"{row['worst_error']:.3g} N, {row['worst_ratio']:.3g} of the certified band, which is "
            f"{row['least_bound']:.3g} N at least" for name, row in bands.items() if row]
