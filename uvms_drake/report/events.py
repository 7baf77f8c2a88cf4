"""Events of a run with their times, from its record.

They are found at the logged samples and at those of the MPC: an event lasts from the first sample
at which its condition holds to the first at which it no longer does. A logged condition that is
interrupted for less than `GAP` is one event, so that a bouncing contact is not a list of bounces;
`TubeMonitor` counts every exit.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from uvms_drake.control.feedback.tube_monitor import SAID, beyond
from uvms_drake.control.laws.law import FIELDS
from uvms_drake.control.mpc.planner import DROPPED, FAILED, HOVERED, KEPT, TIMED_OUT, TROUBLE
from uvms_drake.model.signals.sensor_actuator import CAUSES
from uvms_drake.report import signals
from uvms_drake.sensing.force_fault_detector import ForceStatus
from uvms_drake.station import diagram
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.record import Record
from uvms_drake.station.supervision import MONITOR_SLACK

ROUNDING = 1e-9
"""Rounding of a place [m], a force [N] or a torque [N m]."""
GAP = 0.1
"""Shortest interruption of a logged signal that makes two events of it [s]."""

ALARMING = ("tube_left", "bound_left", "disturbance_exceeded", "limit_violated", "solver_failed",
            "solver_late", "sample_dropped", "state_lost", "force_lost", "input_limited",
            "input_filtered", "motor_limited", "retreated")
"""Kinds that are alarms; the others are `contact`, from touch to loss, `settled`, `retarget`,
`force_refused`, `plan_kept` and `hovering`."""

MPC_KINDS = {FAILED: ("solver_failed", TROUBLE[FAILED]),
             TIMED_OUT: ("solver_late", TROUBLE[TIMED_OUT]),
             DROPPED: ("sample_dropped", TROUBLE[DROPPED]),
             KEPT: ("plan_kept", "the last plan was better and was kept"),
             HOVERED: ("hovering", "keeps its place, without a plan")}
"""Kind and text of an event by the outcome of a sample of the MPC."""


class Event(NamedTuple):
    """Event of a run."""

    start: float
    """Begin of the event [s]."""
    end: float | None
    """End of the event [s]: `start` for an instant, None if it lasts to the end of the run."""
    kind: str
    """Short and stable name of the kind: one of `ALARMING` or of the others there."""
    text: str
    """Description in words and numbers."""


class _Signal(NamedTuple):
    """Condition that makes an event of each interval in which it holds."""

    kind: str
    holds: np.ndarray
    """Values of the condition at the samples (T,), or (K,) of the MPC."""
    text: Callable[[slice], str]
    """Description of an interval of samples."""


def events(record: Record) -> list[Event]:
    """Returns the events of a run in the order in which they start."""
    out = [event for signal in _logged(record) for event in _during(signal, record.time, GAP)]
    out += [event for signal in _sampled(record) for event in _during(signal, record.mpc_time, 0.0)]
    return sorted([*out, *_settled(record)], key=lambda event: event.start)


def intervals(holds: np.ndarray, time: np.ndarray, gap: float) -> list[slice]:
    """Returns the intervals of samples in which `holds`; those less than `gap` apart are one.

    Args:
        holds: Values of the condition (T,).
        time: Instants of the samples (T,) [s].
        gap: Shortest gap between two intervals [s].
    """
    out: list[slice] = []
    for start, stop in np.flatnonzero(np.diff(holds, prepend=False, append=False)).reshape(-1, 2):
        if out and time[start] - time[out[-1].stop] < gap:
            out[-1] = slice(out[-1].start, int(stop))
        else:
            out.append(slice(int(start), int(stop)))
    return out


def _during(signal: _Signal, time: np.ndarray, gap: float) -> Iterator[Event]:
    for when in intervals(signal.holds, time, gap):
        end = float(time[when.stop]) if when.stop < len(time) else None
        yield Event(float(time[when.start]), end, signal.kind, signal.text(when))


def _logged(record: Record) -> Iterator[_Signal]:
    """Yields the signals at the logged samples."""
    depth, bound = record.penetration, record.scenario.disturbance.d_bound
    d = record.scenario.disturbance.norm(record.effective_disturbance)
    yield _Signal("contact", depth > 0.0,
                  lambda when: f"contact, at most {1e3 * np.max(depth[when]):.3g} mm deep")
    desired = record.desired_force
    yield _Signal("retarget", _changed(desired), lambda when: _wanted_text(desired[when.stop - 1]))
    if "target" in record.signals:
        n, target = sensed_contact(record.scenario).direction, record.signals["target"]
        yield _Signal("retarget", _changed(target - np.outer(target @ n, n)),
                      lambda when: "the tip is sent to another point of the wall")
    # Exits from the tube, lost measurements, and cut or changed commands.
    radii = diagram.set_wise_radii(record.scenario.tube, record.scenario.ancillary)
    set_wise = np.array([radii.get(field, np.inf) for field in FIELDS])
    yield _deviation("tube_left", SAID[0], record, set_wise)
    yield _deviation("bound_left", SAID[1], record, record.tube_bound)
    yield _Signal("disturbance_exceeded", signals.disturbance_above(record),
                  lambda when: f"whole disturbance above its bound of {bound:.3g}, at most "
                               f"{np.max(d[when]):.3g}")
    yield _Signal("state_lost", record.state_lost > 0.0, lambda when: "the measured state is lost")
    if "force_lost" in record.signals:
        yield _Signal("force_lost", record.signals["force_lost"][:, 0] > 0.0,
                      partial(_retreat_text, record))
    yield _Signal("input_limited", record.input_limited > 0.0,
                  lambda when: "the command saturates")
    torque, effort = signals.motor_torques(record), record.model.joint_effort
    yield _Signal("motor_limited", np.any(torque > effort + ROUNDING, axis=1),
                  lambda when: _motor_text(torque[when], effort))
    if "safety" in record.signals:
        cause = record.signals["safety"][:, 1].astype(int)
        yield _Signal("retreated", ~record.followed, lambda when: (
            f"the supervisor retreats: {list(CAUSES.values())[cause[when.start] - 1]}"))
    if "input_filtered" in record.signals:
        yield _Signal("input_filtered", record.signals["input_filtered"][:, 0] > 0.0,
                      lambda when: "the supervisor keeps the joints off their stops")
    for name, limit in signals.constraints(record).items():
        yield _Signal("limit_violated", ~(limit.margin >= 0.0),
                      partial(_limit_text, name, -limit.margin))


def _deviation(kind: str, said: str, record: Record, bounds: np.ndarray) -> _Signal:
    """Returns the condition that a deviation is above one of its bounds, (6,) or (T, 6).

    `TubeMonitor` evaluates it just after the MPC's step at the same instant and the log just
    before, which is the same for a continuous nominal motion. Only the log has the end of the run.
    """
    scenario, norms = record.scenario, record.tube_deviation
    floor = diagram.monitor_floor(diagram.set_wise_radii(scenario.tube, scenario.ancillary))
    left = beyond(norms, bounds, MONITOR_SLACK, floor) & signals.watched(record)[:, None]
    ratios = np.where(left, norms / np.maximum(bounds, floor), 0.0)

    def text(when: slice) -> str:
        """Names the component with the largest deviation over its bound."""
        worst = np.max(ratios[when], axis=0)
        part = int(np.argmax(worst))
        return f"{said}: {FIELDS[part]} at most {worst[part]:.3g} of its bound"

    return _Signal(kind, np.any(left, axis=1), text)


def _retreat_text(record: Record, when: slice) -> str:
    """Describes the reason, and the largest displacement of the plan from its first position."""
    place = record.chi_nominal[when, :3]
    displacement = np.max(np.linalg.norm(place - place[0], axis=1))
    reason = ForceStatus(int(record.signals["force_status"][when.start, 0]))
    return (f"no valid force measurement ({reason.name.lower()}): retreat by at most "
            f"{1e3 * displacement:.3g} mm")


def _limit_text(name: str, excess: np.ndarray, when: slice) -> str:
    return f"limit {name} violated, by at most {np.max(excess[when]):.3g}"


def _motor_text(torque: np.ndarray, effort: np.ndarray) -> str:
    """Names the joint of which most is asked, over the effort of its motor."""
    j = int(np.argmax(np.max(torque, axis=0) / effort))
    return (f"at most {np.max(torque[:, j]):.3g} asked of joint {j + 1}, whose motor gives "
            f"{effort[j]:.3g}")


def _changed(values: np.ndarray) -> np.ndarray:
    """Returns whether values (T, size) differ from those of the sample before (T,)."""
    return np.any(np.abs(np.diff(values, axis=0, prepend=values[:1])) > ROUNDING, axis=1)


def _wanted_text(desired: np.ndarray) -> str:
    return f"new desired force of {np.linalg.norm(desired):.4g} {signals.wrench_unit(desired)}"


def _sampled(record: Record) -> Iterator[_Signal]:
    """Yields the signals at the samples of the MPC."""
    for status, (kind, said) in MPC_KINDS.items():
        yield _Signal(kind, record.mpc_status == status, partial(_samples_text, said))
    yield _Signal("force_refused", record.mpc_refused != 0.0,
                  partial(_samples_text, "another desired force was refused"))


def _samples_text(said: str, when: slice) -> str:
    number = when.stop - when.start
    return said if number == 1 else f"{said}, {number} samples in a row"


def _settled(record: Record) -> Iterator[Event]:
    tolerance = record.scenario.task.force_tolerance
    error = np.linalg.norm(record.force - record.desired_force, axis=1)
    index = signals.settling_index(error, tolerance)
    if index is not None and np.any(record.desired_force[-1]):
        time = float(record.time[index])
        yield Event(time, time, "settled",
                    f"force within {tolerance:g} {signals.wrench_unit(record.desired_force[-1])} "
                    "of the desired one, for good")
