"""Derived signals of a run: limits, units, settling, the wall, attempts at a mission's steps."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from uvms_drake.actuation import Thrusters
from uvms_drake.control.limits import Limit, tighten
from uvms_drake.control.plan.points import Points
from uvms_drake.mission.law import REASONS, RUNNING
from uvms_drake.mission.system import PROGRESS
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.surface.law import Surface, check_surface
from uvms_drake.station.diagram import bounds_disturbance, monitor_begin
from uvms_drake.station.problem import limits_of, true_surface
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import Scenario

BOUND_SLACK, BOUND_FLOOR = 1e-6, 1e-9
"""Relative and absolute rounding [m/s², rad/s²] of a disturbance of exactly d̃."""
STEP = 1e-5
"""Step of the difference for the slope of a force [m]."""
UNFINISHED, DONE_STEP = "not over", "done"
"""Outcome of a step at the end of the run, and of one that was completed."""


def disturbance_above(record: Record) -> np.ndarray:
    """Returns whether the effective disturbance violates ‖Ŵ⁻¹d‖₂ ≤ d̃ (T,), if declared."""
    declared = record.scenario.disturbance
    if not bounds_disturbance(declared.d_bound, bool(record.certified)):
        return np.zeros(len(record.time), dtype=bool)
    effective = declared.norm(record.effective_disturbance)
    return effective > (1.0 + BOUND_SLACK) * declared.d_bound + BOUND_FLOOR


def watched(record: Record) -> np.ndarray:
    """Returns whether the tube is watched (T,): after the hover, while the plan is followed."""
    begin = monitor_begin(record.scenario.mpc.hover, bool(record.certified))
    return record.followed & (record.time >= begin)


def real_limits(record: Record) -> dict[str, Limit]:
    """Returns the limits of the robot by name."""
    return limits_of(record.scenario, record.model)


def nominal_limits(record: Record) -> dict[str, Limit]:
    """Returns the tightened limits, those of the nominal MPC."""
    return tighten(real_limits(record), record.scenario.tube)


class Constraint(NamedTuple):
    """Signal of a limit."""

    values: np.ndarray
    """Values g (T,)."""
    limit: float
    """Bound of g: the lower one of joint limits named _min, the upper one otherwise."""
    unit: str
    margin: np.ndarray
    """Distance to the limit (T,); negative where it is violated."""


def constraints(record: Record) -> dict[str, Constraint]:
    """Returns the constraints of a run by name.

    The static force is that of the pose, at rest, on the controller's model of the surface: a limit
    of the penetration. `contact.force` limits that on the real surface, which a controller with a
    sensed contact does not know. After a retreat of the supervisor it alone counts, and the margin
    of others is infinite.
    """
    y = np.concatenate([record.chi, record.config[:, 6:]], axis=1)
    at = Points(record.model, record.config, y, record.zeta, record.u, record.tau)
    found = {name: Constraint(
        values, bound, limit.unit_of(name),
        np.where(record.followed, values - bound if name.endswith("_min") else bound - values,
                 np.inf))
        for limit in real_limits(record).values()
        for name, (values, bound) in limit.signals(at).items() if np.isfinite(bound)}
    if (wall := record.scenario.contact.declared_wall()) is not None:
        static = check_surface(true_surface(record.scenario)).static_force(record.chi)
        found["contact.force"] = Constraint(static, wall.force, "N", wall.force - static)
    return found


def motor_torques(record: Record) -> np.ndarray:
    """Returns |τ| that is asked of the motors of the joints (T, n) [N m, N], behind all parts."""
    torques: np.ndarray = np.abs(record.signals.get("exerted", record.tau)[:, 6:])
    return torques


def wrench_unit(desired: Sequence[float] | np.ndarray) -> str:
    """Returns the unit of 𝔉 and its errors for 𝔉_des (6,): of a force, a torque or both."""
    force, torque = np.any(desired[:3]), np.any(desired[3:])
    return "N, N m" if force and torque else "N m" if torque else "N"


def surface_slope(surface: Surface, chi: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Returns the stiffness along n, the slope of the static force (T,) [N/m]; NaN without contact.

    Args:
        surface: The surface.
        chi: Poses of the end-effector (T, 6) [m, rad].
        direction: Unit vector n into the surface (3,).
    """
    step = STEP * np.pad(direction, (0, 3))
    rise = (surface.static_force(chi + step) - surface.static_force(chi - step)) / (2.0 * STEP)
    return np.where(surface.penetration(chi - step) > 0.0, rise, np.nan)


def settling_index(error: np.ndarray, tolerance: float) -> int | None:
    """Returns the first sample after which `error` (T,) stays within `tolerance`, or None."""
    outside = np.flatnonzero(error > tolerance)
    first = int(outside[-1]) + 1 if len(outside) else 0
    return first if first < len(error) else None


def thruster_part(scenario: Scenario) -> Thrusters | None:
    """Returns the robot's thrusters among the parts of a scenario's actuation, if any."""
    return next((part for part in scenario.actuation if type(part) is Thrusters), None)


def thrusters_of(record: Record) -> ThrusterModel:
    """Returns the controller's model of the thrusters of a run that has some."""
    part = thruster_part(record.scenario)
    assert part is not None
    return part.known(record.model)


class Attempt(NamedTuple):
    """Attempt at a step, from begin to end; the step may be begun again later."""

    step: int
    """Index of the step in the mission."""
    when: slice
    """Logged samples."""
    ended: str
    """Outcome: `done`, the reason of failure, or `UNFINISHED`."""


def has_mission(record: Record) -> bool:
    """Returns whether a run has a mission."""
    return "mission_progress" in record.signals


def progress_of(record: Record) -> dict[str, np.ndarray]:
    """Returns the entries of `PROGRESS` (T,) each, integers."""
    logged = record.signals["mission_progress"].astype(int)
    return dict(zip(PROGRESS, logged.T, strict=True))


def losses_of(record: Record) -> int:
    """Returns how often the tip left the wall in a step that needs a contact, or at its begin.

    Where it is drawn off by a retreat of the supervisor it is no loss.
    """
    steps, touching = record.scenario.mission.steps, (record.penetration > 0.0).astype(int)
    left = (np.diff(touching, prepend=touching[0]) < 0) & record.followed
    return sum(int(np.count_nonzero(left[max(attempt.when.start, 1):attempt.when.stop]))
               for attempt in attempts_of(record) if steps[attempt.step].touches)


def attempts_of(record: Record) -> list[Attempt]:
    """Returns all attempts of a mission in order; between two of a step there is a retreat."""
    progress = progress_of(record)
    step, running = progress["step"], progress["outcome"] == RUNNING
    again = np.diff(progress["tries"], prepend=0) > 0  # Maybe from the same step.
    begins = np.flatnonzero(running & ((np.diff(step, prepend=-1) != 0) | again))
    ends = [*begins[1:], np.count_nonzero(running)][: len(begins)]
    out = []
    for begin, end in zip(begins, ends, strict=True):
        failed = end < len(step) and progress["failures"][end] > progress["failures"][begin]
        ended = (UNFINISHED if end == len(step)
                 else REASONS[progress["reason"][end]] if failed else DONE_STEP)
        out.append(Attempt(int(step[begin]), slice(int(begin), int(end)), ended))
    return out
