"""Checks of a contact: the force against its certified bands, the wall against its class.

In contact the force along n is within b(ℓκ̂/κ₊) of the desired one, ℓ how far the plan is from its
target, whatever `deepest`, and κ̂ the stiffness that the target is of: in a hold by `hold_band` and
the target of the mean reading, else by `SensedContact.band` and that of the last one. It is a hold
where the plan has stood for the time of `HoldRadii` and is within `AT_TARGET` of its target: not
for some time after a change of the desired force or of its place.
tube/contact/theory.md#force-band-of-a-hold.

The class of the wall is checked from the static force along the tip's path, so for any surface; a
wall that passes may be out of its class elsewhere.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from uvms_drake.model.surface.unknown_contact import UnknownContact
from uvms_drake.report.signals import attempts_of, has_mission
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.contact.tube_in_contact import AT_TARGET, short_of_target, stands
from uvms_drake.station.record import Record
from uvms_drake.station.true_wall import Departure
from uvms_drake.tube.contact.sensor_error import ripple
from uvms_drake.tube.ultimate_bounds import hold_band, tip_errors

NOTHING = 1e-3
"""Rounding of a force [N]."""
CONTACT_FORCE, MOVING = 1.0, 1e-3
"""Smallest force [N] and speed [m/s] for which their ratios are evaluated."""
ROUNDING = 1.0 + 1e-6


class ForceBands(NamedTuple):
    """Error and band of the force along n at the logged instants."""

    error: np.ndarray
    """n·𝐅 − F_des (T,) [N]."""
    bound: np.ndarray
    """b(ℓκ̂/κ₊) (T,) [N]; NaN without contact at the last reading, and after a retreat."""
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
    touched = record.followed & (record.signals["touched"][:, 0] > 0.0)
    lags, of_reading = (short_of_target(  # ℓ counts κ̂ℓ.
        contact.walls, record.chi_nominal[:, :3], record.signals[name],
        record.signals["stiffness_used"][:, 0] / contact.stiffness) for name in (
            "unclipped_target", "target_of_reading"))
    holds = touched & has_stood(record) & (contact.stiffness * lags <= AT_TARGET)
    recedes = sliding(record)
    bound, off = np.full(len(goal), np.nan), tip_errors(tube)
    for i in np.flatnonzero(touched):
        bound[i] = contact.band(goal[i], off, recedes[i], of_reading[i])
        if holds[i] and tube.hold is not None:
            bound[i] = min(bound[i], hold_band(contact, goal[i], tube.hold, lags[i]))
    return ForceBands(force_error(record), bound, holds)


def sliding(record: Record) -> np.ndarray:
    """Returns the speed of the mission's step along the wall (T,) [m/s]; zero but in a slide."""
    speed = np.zeros(len(record.time))
    for attempt in attempts_of(record) if has_mission(record) else ():
        speed[attempt.when] = record.scenario.mission.steps[attempt.step].speed
    return speed


def has_stood(record: Record, earlier: float = 0.0) -> np.ndarray:
    """Returns whether the plan has stood for the time of a hold (T,); never without one.

    No step of a mission that slides is a hold, however slowly its plan begins: the tip slides, and
    the bounds `contact.hold` are of one that does not.

    Args:
        record: Of a sensed contact.
        earlier: Time by which it has to have stood less [s].
    """
    hold = record.scenario.tube.hold
    if hold is None:
        return np.zeros(len(record.time), dtype=bool)
    walls = sensed_contact(record.scenario).walls
    moves = ~stands(record.model, walls, record.nominal_state) | (sliding(record) > 0.0)
    last = np.maximum.accumulate(np.where(moves, record.time, -np.inf))
    stood: np.ndarray = record.time - np.maximum(last, record.time[0]) >= hold.time - earlier
    return stood


def summarise_bands(record: Record) -> dict[str, Any]:
    """Returns `force_bands`: largest error, and largest ratio to the band, in both phases.

    `at` has time, error and band of that ratio, `after_touch_s` is the time from the first touch to
    the phase. Nothing without a certificate or a declared wall; a phase that never was is None.
    """
    if not record.certified or record.scenario.contact.declared_wall() is None:
        return {}
    found = force_bands(record)
    out: dict[str, Any] = {}
    for name, phase in (("motion", ~found.holds), ("hold", found.holds)):
        there = phase & np.isfinite(found.bound)
        time, error, bound = record.time[there], np.abs(found.error[there]), found.bound[there]
        worst = int(np.argmax(error / bound)) if len(time) else 0
        out[name] = None if not len(time) else {
            "share": np.mean(there),
            "after_touch_s": time[0] - record.time[np.argmax(np.isfinite(found.bound))],
            "worst_error": np.max(error), "worst_ratio": error[worst] / bound[worst],
            "at": {"time_s": time[worst], "error": error[worst], "bound": bound[worst]},
            "exits": np.count_nonzero(error > bound)}
    return {"force_bands": out}


def departures(specified: UnknownContact, time: np.ndarray, tip: np.ndarray, velocity: np.ndarray,
               force: np.ndarray, static: Callable[[np.ndarray], np.ndarray],
               stood: np.ndarray | None = None) -> dict[str, Departure]:
    """Returns the bounds of a class, by their keys, that a wall has exceeded.

    Between any two places φ(𝔭') ≤ φ(𝔭) + κ₊⟨𝔭' − 𝔭⟩₊ (`SurfaceClass`), checked for successive
    samples; the angle of 𝐅 to n is at most θ + arctan μ; ‖𝐅‖ ≤ √(1 + μ²) φ (1 + c₊⟨v⟩₊); and for a
    receding tip ‖𝐅‖ ≥ φ (1 − c₊⟨−v⟩₊).

    Args:
        specified: Specification of the contact, with its class.
        time: Instants (T,) [s].
        tip: Positions of the tip (T, 3) [m].
        velocity: Velocities of the tip (T, 3) [m/s].
        force: 𝐅 of the tip on the wall (T, 3) [N].
        static: Function from positions of the tip (..., 3) to φ (...) [N].
        stood: Whether it is a hold (T,); None: never.
    """
    walls, phi, size = specified.walls, static(tip), np.linalg.norm(force, axis=1)
    in_contact = size > CONTACT_FORCE
    # Angle and friction, as the angle between force and direction; large if the wall pulls.
    cone = specified.angle + float(np.arctan(specified.friction))
    off = np.arctan2(walls.lateral(force), walls.depth(force))[in_contact]
    # Damping.
    damped = np.append(
        _damping(walls.advance(velocity), size / np.hypot(1.0, specified.friction), phi),
        -_damping(walls.advance(-velocity), size, phi))
    # Free distance from the start.
    advance = np.linspace(0.0, specified.clearance, 101)
    free = static(tip[0] + advance[:, None] * walls.direction) <= NOTHING
    nearest = specified.clearance if np.all(free) else float(advance[np.argmin(free)])
    observed = {
        "stiffness": Departure(specified.stiffness, _steepest(
            walls.advance(np.diff(tip, axis=0)), walls.advance(-np.diff(tip, axis=0)), phi)),
        "angle and friction": Departure(cone, float(np.max(off, initial=0.0))),
        "dissipation": Departure(specified.dissipation, float(np.max(damped, initial=0.0))),
        "force_ripple": Departure(specified.force_ripple, ripple(
            time, force @ walls.axes[1:].T, specified.force_rate)),
    }
    if stood is not None:
        slow = specified.hold_forces
        begins, ends = (np.flatnonzero(np.diff(stood.astype(int), prepend=0, append=0) == sign)
                        for sign in (1, -1))
        observed["hold.force_ripple"] = Departure(slow.force_ripple, max((
            ripple(time[begin:end], force[begin:end] @ walls.axes[1:].T, slow.force_rate)
            for begin, end in zip(begins, ends, strict=True)), default=0.0))
    out = {key: each for key, each in observed.items() if each.observed > ROUNDING * each.specified}
    if nearest != specified.clearance:
        out["clearance"] = Departure(specified.clearance, nearest)
    return out


def _damping(speed: np.ndarray, force: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Returns (F/φ − 1) over the speed, for samples in motion and contact [s/m]."""
    quick = (phi > CONTACT_FORCE) & (speed > MOVING)
    factors: np.ndarray = (force[quick] / phi[quick] - 1.0) / speed[quick]
    return factors


def _steepest(advance: np.ndarray, back: np.ndarray, phi: np.ndarray) -> float:
    """Returns the largest slope of φ (T,) over the advance, forwards (T−1,) and back [N/m]."""
    change = np.diff(phi)
    grown = np.concatenate([change, -change]) - NOTHING
    distance = np.maximum(np.concatenate([advance, back]), 1e-12)
    return float(np.max((grown / distance)[grown > 0.0], initial=0.0))
