"""Metrics of pressing on a wall that the controller does not know, over its class's bounds."""

from typing import Any

import numpy as np

from uvms_drake.model.surface import ShapedSurface
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.unknown_contact import UnknownContact
from uvms_drake.report.signals import has_mission, losses_of, settling_index
from uvms_drake.station.contact.drawn_mission import ends_of
from uvms_drake.station.contact.drawn_surfaces import across, ball_about, is_member, membership
from uvms_drake.station.problem import true_surface
from uvms_drake.station.record import Record
from uvms_drake.tube.contact.sensor_error import ripple

LAST_SECONDS = 2.0
"""Length of the window at the end over which the force is averaged [s]."""

Ends = tuple[np.ndarray, np.ndarray]
"""Start of the tip, and its desired position but for the depth (3,), (3,) [m]; see `ends_of`."""


def wall_metrics(record: Record) -> dict[str, Any]:
    """Returns the metrics of a wall of any shape that `contact` declares; empty without one.

    `static` and `peak` are forces along the wall's own normal, at rest and in motion, over their
    bounds. The others are of the controlled force along n: `settled_s` is the time from the first
    touch to when it stays within the task's tolerance, `settling_time_s` that from the start,
    `losses` the number of losses of contact after it was within. `in_class` is whether the wall is
    in the class wherever it was touched.

    With a mission the desired force is that of every instant, and losses are those of steps that
    need a contact.
    """
    scenario, surface = record.scenario, check_surface(true_surface(record.scenario))
    contact = scenario.contact.declared_wall()
    if contact is None or not isinstance(surface, ShapedSurface):
        return {}
    goal = np.asarray(scenario.task.pose, dtype=float)[:3]
    ends = ends_of(scenario.mission, contact.walls, record.chi[0, :3], goal)
    found, static = membership(surface, contact, *ends), surface.static_force(record.chi)
    # A mission desires a force in some of its steps, a press always the same one.
    desired: Any = (record.desired_force[:, :3] @ contact.direction if has_mission(record)
                    else scenario.task.force_along(contact.direction))
    error = np.abs(record.force[:, :3] @ contact.direction - desired)
    within, touching = error <= scenario.task.force_tolerance, record.penetration > 0.0
    index = settling_index(error, scenario.task.force_tolerance)
    settled = None if index is None else record.time[index]
    touch = record.time[np.argmax(touching)] if np.any(touching) else None
    since = touching[np.argmax(within):] if np.any(within) else touching[:0]
    return {
        "shape": type(surface.geometry).__name__, "law": type(surface.law).__name__,
        "stiffness": None if found is None else found.stiffness,
        "angle": None if found is None else found.angle,
        "static": np.max(static) / contact.force,
        "peak": np.max(_normal_force(record, surface)) / contact.peak(
            contact.force, contact.largest_advance),
        "first_touch_s": touch,
        "settled_s": None if settled is None or touch is None else max(settled - touch, 0.0),
        "settling_time_s": settled,
        "error": np.mean(error[record.time >= record.time[-1] - LAST_SECONDS]),
        "final_error": error[-1],
        "losses": (losses_of(record) if has_mission(record)
                   else np.count_nonzero(np.diff(since.astype(int)) < 0)),
        "in_class": _in_class(record, surface, contact, static, ends),
    }


def _normal_force(record: Record, surface: ShapedSurface) -> np.ndarray:
    """Returns the force on the wall along its own normal (T,) [N], without friction."""
    _, into = surface.geometry.depth_and_gradient(record.chi[:, :3])
    force: np.ndarray = np.sum(record.force[:, :3] * into, axis=1) / np.linalg.norm(into, axis=1)
    return force


def _in_class(record: Record, surface: ShapedSurface, contact: UnknownContact, static: np.ndarray,
              ends: Ends) -> bool:
    """Returns whether the wall of a run is in the class wherever the tip touched it.

    The tip has to stay in the ball of proven membership, and the rate of the force normal to n
    within the class's bound; only the time before the first too large static force (T,) counts.
    """
    center, reach = ball_about(surface.anchor, contact, surface.law, *ends)
    hard = static > contact.force
    allowed = slice(int(np.argmax(hard)) if np.any(hard) else len(hard))
    far = np.linalg.norm(record.chi[allowed, :3] - center, axis=1) > reach
    tangential = ripple(record.time[allowed], across(contact.direction, record.force[allowed, :3]),
                        contact.force_rate)
    return (is_member(surface, contact, *ends)
            and not np.any(far & (record.penetration[allowed] > 0.0))
            and tangential <= contact.force_ripple)
