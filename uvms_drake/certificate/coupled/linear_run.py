"""A run as the coupled linear loop has it, with the very same draws: to compare with its record.

    record = simulate(scenario)                    # the Diagram, with the noise of scenario.seed
    linear = linear_run(record)                    # the linear loop, with the same noise
    apart = linear.of_record - linear.values       # (T, rows), by the names in linear.rows

The inputs are the noise of the navigation and of the force sensor, the plan's accelerations, and
the unknown mass and current, which observers that begin at zero have yet to find. The loop is that
of the task's configuration; it is free until the first touch, and pressed from there on. Friction
and the slope of the wall are not foreseen: with `across`, the logged force across the normal is an
input, too. Left out are rounding, dead bands, limits, and everything nonlinear.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from uvms_drake.certificate.coupled.loop_at_task import loop_parts, press_configuration
from uvms_drake.model.signals.linear import Block
from uvms_drake.model.signals.sensor_actuator import Sensor
from uvms_drake.sensing.force_sensor import ForceSensor
from uvms_drake.sensing.navigation import CHANNELS, Navigation, channel_rows
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.record import Record
from uvms_drake.tube.coupled.coupled_loop import (
    FORCE_ACROSS,
    NORMAL_FORCE,
    PLAN,
    CoupledLoop,
    Wall,
    coupled_loop,
    frame_of,
    operating_point,
    row_errors,
)
from uvms_drake.tube.coupled.simulated import Input, simulated


class LinearRun(NamedTuple):
    """Rows of a run, as the linear loop and as the record has them."""

    time: np.ndarray
    """Logged instants (T,) [s]."""
    rows: tuple[str, ...]
    """Names of the rows, see `CoupledLoop.rows`."""
    values: np.ndarray
    """Rows of the linear loop (T, rows) [m, rad, m/s, rad/s]."""
    of_record: np.ndarray
    """Rows of the record (T, rows)."""


def linear_run(record: Record, *, across: bool = True) -> LinearRun:
    """Returns the rows of a run of a scenario with a sensed contact.

    Args:
        record: The run, whose log has the plan at its knots.
        across: Whether the force across the normal is an input.
    """
    scenario, model = record.scenario, record.model
    parts, contact = loop_parts(scenario, model), sensed_contact(scenario)
    n = np.asarray(contact.direction, dtype=float)
    config = press_configuration(scenario.task, model)
    touched = record.time[record.penetration > 0.0]
    walls = [(0.0, Wall(n))]
    if touched.size:
        walls.append((float(touched[0]), Wall(n, 0.0, _stiffness(record, n))))
    at = operating_point(parts, config, walls[0][1])
    loops = [(time, coupled_loop(parts, at, wall, planned=True)) for time, wall in walls]
    first = loops[0][1]

    inputs = drawn_errors(scenario.sensing, scenario.seed, first) | {
        first.entry(PLAN): _accelerations(record, max(parts.command_path.preview), parts.time_step)}
    inputs |= _forces(record, first, n, walls, across=across)
    time, values = simulated(
        [(time, loop.system) for time, loop in loops], inputs, float(record.time[-1]),
        first.start(record.nominal_config[0]))
    values = np.array([np.interp(record.time, np.append(0.0, time), np.append(0.0, row))
                       for row in values.T]).T
    of_record = row_errors(model, n, record.state, record.nominal_state)
    for axis in first.undriven:  # They follow no plan.
        of_record[:, 3 + axis] = record.state[:, axis] - at.state[axis]
        of_record[:, axis - model.size] = record.state[:, model.size + axis]
    return LinearRun(record.time, first.rows, values, of_record)


def _stiffness(record: Record, normal: np.ndarray) -> float:
    """Returns the secant of the force along n by the depth, at the largest depth [N/m]."""
    deepest = int(np.argmax(record.penetration))
    return float(record.force[deepest, :3] @ normal / record.penetration[deepest])


def drawn_errors(sensing: Sequence[Sensor], seed: int, loop: CoupledLoop) -> dict[Block, Input]:
    """Returns the errors of sensors by the entries of their loop, as the seed draws them."""
    out: dict[Block, Input] = {}
    for part in sensing:
        if isinstance(part, Navigation):
            for key in CHANNELS:
                size = len(channel_rows(loop.at.model.size)[key])
                out[loop.entry(key)] = partial(part.error, key, size, seed)
        elif isinstance(part, ForceSensor):
            out[loop.entry("force")] = _force_error(part, seed)
    return out


def _force_error(sensor: ForceSensor, seed: int) -> Input:
    """Returns the error of a reading less that of the tare, without rounding; zero before."""
    off, count = sensor.imperfection(seed), sensor.tare_samples

    def raw(index: int) -> np.ndarray:
        return off.bias + off.drift * (index / sensor.rate) + off.noise(index)

    tare = np.mean([raw(i) for i in range(count)], axis=0) if count else np.zeros(6)

    def error(time: float) -> np.ndarray:
        index = round(time * sensor.rate)
        return raw(index) - tare if index >= count else np.zeros(6)

    return error


def plan_accelerations(record: Record, step: float) -> np.ndarray:
    """Returns the plan's ζ̄̇ on each interval between knots (T, 6+n)."""
    knots = np.arange(0.0, record.time[-1] + 0.5 * step, step)
    zeta = np.array([np.interp(knots, record.time, row) for row in record.nominal_zeta.T]).T
    return np.diff(zeta, axis=0) / step


def _accelerations(record: Record, preview: float, step: float) -> Input:
    """Returns the plan's ζ̄̇ on the interval that begins `preview` later."""
    size, rates = record.nominal_zeta.shape[1], plan_accelerations(record, step)

    def acceleration(time: float) -> np.ndarray:
        knot = round((time + preview) / step)
        return rates[knot] if 0 <= knot < len(rates) else np.zeros(size)

    return acceleration


def _forces(record: Record, loop: CoupledLoop, normal: np.ndarray,
            walls: list[tuple[float, Wall]], *, across: bool) -> dict[Block, Input]:
    """Returns further forces: that of a wall which is not at the point, and that across n."""
    out: dict[Block, Input] = {}
    if len(walls) > 1:
        model, (touch, wall) = loop.at.model, walls[1]
        size, i = model.size, int(np.searchsorted(record.time, touch))
        # The wall's force is zero at the touch. The linear loop begins its plan at zero, and moves
        # it as at the point: ∫ζ̄ and the difference of poses are millimetres apart.
        J = model.tip_kinematics(loop.at.state[:size]).J_chi[:3]
        moved = np.trapezoid(record.nominal_zeta[:i + 1], record.time[:i + 1], axis=0)
        out[loop.entry(NORMAL_FORCE)] = lambda time: (
            np.array([-wall.stiffness * normal @ J @ moved]) if time >= touch else np.zeros(1))
    if across:
        axes = frame_of(normal)[:, 1:]
        force = record.force[:, :3] @ axes
        out[loop.entry(FORCE_ACROSS)] = lambda time: np.array(
            [np.interp(time, record.time, each) for each in force.T])
    return out
