"""Supervisor of a scenario: its thresholds, derived from the declared data."""

import numpy as np

from uvms_drake.actuation import Thrusters
from uvms_drake.common.errors import require
from uvms_drake.control.limits import resolved_radii
from uvms_drake.control.supervisor.detections import Thresholds
from uvms_drake.control.supervisor.retreat import RetreatSettings
from uvms_drake.control.supervisor.supervisor import Safety
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.sensing.navigation import Navigation
from uvms_drake.station.contact.bounds import known_reading, sensed_contact
from uvms_drake.station.scenario.parts import command_path_of
from uvms_drake.station.scenario.scenario import Scenario

MONITOR_SLACK = 0.01
"""Relative excess that is not an exit: a constant d takes the deviation to its bound exactly, and
the integrator's error over a step of 0.02 s through contact is 0.7 %."""
MONITOR_FLOOR = 1e-4
"""Deviation that is not an exit [m, rad, m/s, rad/s]: the integrator makes 7e-5 of one that is
exactly zero. At most a tenth of the tube's smallest radius counts, see `monitor_floor`."""
TIMES = 2.0
"""Factor of declared times and disturbances at which they are exceeded for sure."""
STATE_LOST = 0.5
"""Time without a state after which it is lost, where no navigation declares a gap [s]."""
LOST = 1.0
"""Time without a force after which the planned retreat is not waited for any longer [s]."""


def safety_of(scenario: Scenario, model: ContactModel) -> Safety | None:
    """Returns the parts of the supervisor of a sensed contact; None if it has none."""
    asked = scenario.supervisor
    if asked is None:
        return None
    thrusters = [part for part in scenario.actuation if isinstance(part, Thrusters)]
    retreat = RetreatSettings(
        np.asarray(sensed_contact(scenario).direction, dtype=float), asked.distance, asked.speed,
        asked.draw, asked.draw_speed, model.q_lower, model.q_upper, model.joint_speed)
    return Safety(thresholds_of(scenario, model), retreat, Allocation.to(
        thrusters[0].known(model)) if thrusters else None)


def thresholds_of(scenario: Scenario, model: ContactModel) -> Thresholds:
    """Returns the thresholds.

    With ν the error of a reading, declared or the sensor's own if that is larger, of which c never
    changes, ε of the measured position, κ₊ and
    F_max of the class, and the radii of the tube:

    * force: F_max − ν, so that the true one is at most F_max. A trip by it is early: F_max is of
      the static force, to which a certificate lets readings add their error and the tube its own;
    * slope: 2(ν − c), two readings off in opposite ways;
    * tip, joints: the radii, and ε; vehicle: that of the tip and of the arm by ‖J_q‖;
    * fix: the longest gap, and a period of the fixes, which lie in between;
    * drift: twice the acceleration by the declared flow, that of ν at the tip, the noise of the
      velocity through the observer, and the bound of the disturbance, its largest semi-axes;
    * cut: twice the delay of the vehicle's wrench; plan: all but two intervals of the horizon.
    """
    contact, tube = sensed_contact(scenario), resolved_radii(scenario.tube)
    reading, path = known_reading(scenario), command_path_of(scenario.actuation, model)
    navigation = next((part for part in scenario.sensing if isinstance(part, Navigation)), None)
    position, turning, velocity, fix = 0.0, 0.0, 0.0, STATE_LOST
    if navigation is not None:
        multiple, dvl = navigation.noise_multiple, navigation.dvl
        position = multiple * navigation.position.noise + navigation.drift.bound * (
            navigation.drift.rate > 0.0)
        velocity = multiple * float(np.max(dvl.noise)) + dvl.growth * dvl.gap
        turning = multiple * navigation.turning.noise
        fix = dvl.gap + 1.0 / dvl.rate + path.period
    # The error of a reading, and the part of it that never changes.
    constant, error = 0.0, contact.force_error
    if reading is not None:
        constant = float(np.linalg.norm(reading.constant[:3]))
        error = max(error, constant + float(np.max((reading.error - reading.constant)[:3])))
    require(contact.force > error, "contact.force", contact.force,
            f"more than {error:.3g} N, the error of a reading, for the supervisor")
    # Accelerations by the flow and by that error at the tip, at the start.
    config = np.asarray(scenario.start.config, dtype=float)
    M, J = model.mass_matrix(model.kinematics(config)), model.task_jacobian(config)[:3]
    lever = float(np.linalg.norm(model.task_pose(config)[:3] - config[:3]))
    flow = float(np.linalg.norm(scenario.current)) + sum(wave.speed for wave in scenario.waves)
    linear, angular = drag_accelerations(model, config, flow)
    observer = getattr(getattr(scenario.ancillary, "vehicle", None), "observer", 0.0)
    drift = TIMES * np.array([linear, angular]) + error * np.array(
        [1.0 / np.min(np.diag(M)[:3]), lever / np.min(np.diag(M)[3:6])])
    drift += TIMES * observer * np.array([velocity, turning])
    axes = scenario.disturbance.axes(model.size)
    drift += [np.max(axes[:3]), np.max(axes[3:6])]
    off = (1.0 + MONITOR_SLACK) * np.array([
        (tube.position or 0.0) + np.sqrt(3.0) * position, tube.joints or 0.0,
        (tube.position or 0.0) + np.sqrt(3.0) * position
        + float(np.linalg.norm(J[:, 6:], 2)) * (tube.joints or 0.0)]) + MONITOR_FLOOR
    horizon, h = scenario.mpc.horizon, scenario.mpc.time_step
    return Thresholds(
        force=contact.force - error, slope=2.0 * (error - constant),
        walls=contact.walls, touch=0.5 * error, depth_error=position,
        off=off, fix=fix, drift=drift, cut=TIMES * max(path.mean_delays[0], h),
        plan=max(horizon - 2, 1) * h, lost=LOST, begin=scenario.mpc.hover)


def drag_accelerations(model: ContactModel, config: np.ndarray, flow: float) -> np.ndarray:
    """Returns the largest linear and angular acceleration of the vehicle (2,) by a flow [m/s].

    Of a robot at rest in a flow along one of its axes: that of the model, which moves through still
    water.
    """
    still = np.zeros(model.size)
    found = np.zeros(2)
    for axis in range(3):
        for sign in (1.0, -1.0):
            through = still.copy()
            through[axis] = sign * flow
            change = model.drift(config, through) - model.drift(config, still)
            found = np.maximum(found, [np.linalg.norm(change[:3]), np.linalg.norm(change[3:6])])
    return found
