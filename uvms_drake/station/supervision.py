"""Supervisor of a scenario: its thresholds, derived from the declared data."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from uvms_drake.actuation import Thrusters
from uvms_drake.actuation.thrusters import largest_error
from uvms_drake.common.errors import require
from uvms_drake.control.limits import resolved_radii
from uvms_drake.control.supervisor.detections import (
    MOST_DAMPING,
    SPACING,
    WINDOW,
    Thresholds,
)
from uvms_drake.control.supervisor.retreat import RetreatSettings
from uvms_drake.control.supervisor.supervisor import Safety
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.model_error import ModelError, simulated_uvms
from uvms_drake.plant.waves import Wave, largest_speed
from uvms_drake.sensing.navigation import Navigation
from uvms_drake.station.contact.bounds import (
    fastest_advance,
    known_reading,
    sensed_contact,
    turning_of,
)
from uvms_drake.station.scenario.contact import SensedContact
from uvms_drake.station.scenario.parts import command_path_of
from uvms_drake.station.scenario.scenario import Scenario, Supervision
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.unmodelled_dynamics import Motions, by_water, family

MONITOR_SLACK = 0.01
"""Relative excess that is not an exit: a constant d takes the deviation to its bound exactly, and
the integrator's error over a step of 0.02 s through contact is 0.7 %."""
MONITOR_FLOOR = 1e-4
"""Deviation that is not an exit [m, rad, m/s, rad/s]: the integrator makes 7e-5 of one that is
exactly zero. At most a tenth of the tube's smallest radius counts, see `monitor_floor`."""
TIMES = 2.0
"""Factor of declared times and disturbances at which they are exceeded for sure."""
TOUCH = 0.5
"""Share of the error of a reading above which a force is a touch."""
STATE_LOST = 0.5
"""Time without a state after which it is lost, where no navigation declares a gap [s]."""
LOST = 1.0
"""Time without a force after which the planned retreat is not waited for any longer [s]."""
STATIC = ("mass", "buoyancy_lever", "buoyancy", "payload")
"""Unknowns of a `ModelError` that load a robot at rest, beside `buoyancy_shift`."""
PHASES = 8
"""Number of headings, and of phases, of which the worst is that of a wave."""


def safety_of(scenario: Scenario, model: ContactModel) -> Safety | None:
    """Returns the parts of the supervisor of a sensed contact; None if it has none."""
    asked = scenario.supervisor
    if asked is None:
        return None
    known = next((part.known(model) for part in scenario.actuation
                  if isinstance(part, Thrusters)), None)
    retreat = RetreatSettings(
        np.asarray(sensed_contact(scenario).direction, dtype=float), asked.distance, asked.speed,
        asked.draw, asked.draw_speed, model.q_lower, model.q_upper, model.joint_speed,
        known if known is not None and known.power_cut else None)
    return Safety(thresholds_of(scenario, model), retreat,
                  None if known is None else Allocation.to(known))


def thresholds_of(scenario: Scenario, model: ContactModel) -> Thresholds:
    """Returns the thresholds.

    With ν the error of a reading, declared or the sensor's own if that is larger, ε of the measured
    state, F_max of the class and the radii of the tube:

    * force: the largest reading of the class, see `largest_reading`;
    * slope: that after the readings of the last second, see `detections.largest_force`, with the
      sensor's own errors, of which the part that never changes is apart, as far as the tool keeps
      its angle; the force turns with the tip and has a part older than the delay, a share of it;
    * tip, its angles, joints: the radii, and ε, see `tip_errors`;
    * fix: the longest gap, and a period of the fixes, which lie in between;
    * drift: the accelerations by all that is declared, see `declared_drift`, and twice the noise of
      the velocity through the observer;
    * cut: twice the delay of the vehicle's wrench; plan: all but two intervals of the horizon,
      and the time for which the solver is declared to fail, if that ends.
    """
    contact, tube = sensed_contact(scenario), resolved_radii(scenario.tube)
    reading, path = known_reading(scenario), command_path_of(scenario.actuation, model)
    navigation = next((part for part in scenario.sensing if isinstance(part, Navigation)), None)
    noise, velocity, turning, fix = np.zeros(3), 0.0, 0.0, STATE_LOST
    if navigation is not None:
        multiple, dvl = navigation.noise_multiple, navigation.dvl
        noise = multiple * np.array([navigation.position.noise, navigation.attitude.noise,
                                     navigation.joints.noise])
        noise[0] += navigation.drift.bound * (navigation.drift.rate > 0.0)
        velocity = multiple * float(np.max(dvl.noise)) + dvl.growth * dvl.gap
        turning = multiple * navigation.turning.noise
        fix = dvl.gap + 1.0 / dvl.rate + path.period
    asked = scenario.supervisor
    # The error of a reading, and the parts of it that may change and that never do.
    constant, changing, share, error = 0.0, contact.force_error, 0.0, contact.force_error
    if reading is not None:
        constant = float(np.linalg.norm(reading.constant[:3]))
        changing = float(np.linalg.norm((reading.error - reading.constant)[:3]))
        error = max(error, float(np.linalg.norm(reading.error[:3])))
        beta, omega, age = contact.tool_angle, turning_of(scenario), reading.lag + reading.period
        mu, missing = contact.friction, reading.missing(contact.delay)
        peak = np.hypot(1.0, mu) * contact.peak(contact.force, fastest_advance(contact))
        changing += constant * float(np.sin(beta) + 0.5 * (1.0 - np.cos(beta)))
        changing += reading.payload[0] + missing * float(peak)
        share = missing + omega * age * (np.sin(contact.angle) + mu * np.cos(contact.angle))
        share += 0.5 * omega**2 * (age**2 + reading.lag**2) * np.hypot(1.0, mu)
    if asked is not None and asked.reading is not None:
        error, changing, constant = (float(each) for each in asked.reading)
    require(contact.force > error, "contact.force", contact.force,
            f"more than {error:.3g} N, the error of a reading, for the supervisor")
    observer = getattr(getattr(scenario.ancillary, "vehicle", None), "observer", 0.0)
    drift = None if asked is None else asked.drift
    if drift is None:
        drift = declared_drift(scenario, model, error) + TIMES * observer * np.array(
            [velocity, turning])
    off = np.array([tube.position or 0.0, tube.orientation or 0.0, tube.joints or 0.0])
    off += np.sqrt([3.0, 3.0, model.num_joints]) * noise
    moved = tip_errors(scenario, model, noise)
    off[:2] += moved
    # A plan's tip changes its speed by twice the largest one in an interval at most.
    horizon, h = scenario.mpc.horizon, scenario.mpc.time_step
    faster = (tube.depth_speed or 0.0) + contact.walls.tilt * (tube.tip_speed or 0.0)
    faster += 2.0 * fastest_advance(contact) * spacing_of(scenario, path.period) / h
    outage = sum(each.duration or 0.0 for each in scenario.faults if each.place == "solver")
    return Thresholds(
        force=largest_reading(contact, error), error=changing, constant=constant,
        share=float(share), delay=contact.delay, walls=contact.walls, faster=faster,
        touch=TOUCH * error, depth_error=float(noise[0] + moved[0]),
        off=(1.0 + MONITOR_SLACK) * off + MONITOR_FLOOR, fix=fix, drift=drift,
        cut=TIMES * max(path.mean_delays[0], h),
        plan=max(horizon - 2, 1) * h + outage, lost=LOST, begin=scenario.mpc.hover)


def tip_errors(scenario: Scenario, model: ContactModel, noise: np.ndarray) -> np.ndarray:
    """Returns how far off tip and its angles (2,) are by errors of attitude and joints [m, rad].

    Those of the vehicle's attitude act by the lever on the tip, those of the joints on both: the
    norms of |J| times them, the larger ones of the start and the task.

    Args:
        scenario: The scenario.
        model: The controller's model.
        noise: Largest error of each position, angle and joint (3,) [m, rad, rad].
    """
    at_task = model.configuration(np.concatenate([scenario.task.pose, scenario.task.posture]))
    J = np.abs([model.task_jacobian(config)[:6] for config in (
        np.asarray(scenario.start.config, dtype=float), at_task)])
    J[:, 3:, 3:6] = 0.0  # The angles' own errors count already.
    off = J @ np.repeat([0.0, *noise[1:]], [3, 3, model.num_joints])
    largest: np.ndarray = np.max(np.linalg.norm(off.reshape(2, 2, 3), axis=2), axis=0)
    return largest


def largest_reading(contact: SensedContact, error: float) -> float:
    """Returns the largest reading along n of a static force F_max, a₊ F_max (1 + c₊⟨𝔭̇⟩) + ν [N].

    Args:
        contact: The declared contact.
        error: ν [N].
    """
    return contact.walls.largest_share * contact.peak(
        contact.force, fastest_advance(contact)) + error


def silent_conditions(scenario: Scenario, model: ContactModel) -> list[Condition]:
    """Returns the premises of the silence of a certified scenario's supervisor that may not hold.

    See control/theory.md#silence-of-the-supervisor. Its other thresholds are above the radii of the
    tube and the largest reading of the class by their definition, see `thresholds_of`.

    Args:
        scenario: The scenario, with its certified tube.
        model: The controller's model.
    """
    safety = safety_of(scenario, model) if scenario.contact.declared_wall() is not None else None
    if safety is None:
        return []
    limits, contact = safety.thresholds, sensed_contact(scenario)
    spacing = spacing_of(scenario, command_path_of(scenario.actuation, model).period)
    outage = sum(np.inf if each.duration is None else each.duration
                 for each in scenario.faults if each.place == "solver")
    watched = {
        "damping c₊⟨𝔭̇⟩ of a tip [-]": (contact.dissipation * (
            contact.largest_advance + limits.faster), MOST_DAMPING),
        "age of a reading, and time to the next one [s]": (contact.delay + spacing, WINDOW),
        "age of a plan [s]": (scenario.mpc.time_step + outage, limits.plan)}
    return [Condition(f"supervisor, largest {name}", float(largest), "<=", float(limit),
                      theorem="control/theory.md#silence-of-the-supervisor", topic="supervisor")
            for name, (largest, limit) in watched.items()]


def spacing_of(scenario: Scenario, period: float) -> float:
    """Returns the largest time between two readings that a supervisor keeps [s].

    It keeps that of the first update `SPACING` after the last one. Updates are the ticks of the
    clock, or at the beginning of every step of the integrator, one at each `log_period`.

    Args:
        scenario: The scenario.
        period: Period of the clock of the law [s]; zero for none.
    """
    regular = period or scenario.log_period
    whole = float(np.ceil(SPACING / regular - 1e-9)) * regular
    return whole if period or whole <= SPACING + 1e-9 else SPACING + regular


def declared_drift(scenario: Scenario, model: ContactModel, error: float) -> np.ndarray:
    """Returns the linear and angular acceleration (2,) of the vehicle by all that is declared.

    Of the robot at rest at the start: twice those by the drag of all flows, by each wave, by each
    unknown of weight, buoyancy and payload alone, for they are of either sign, and by joint
    friction; those by an error of the force at the tip and of the thrusters' own; and the bound of
    the disturbance, its largest semi-axes [m/s², rad/s²].

    Args:
        scenario: The scenario.
        model: The controller's model.
        error: ν [N].
    """
    config, unknown = np.asarray(scenario.start.config, dtype=float), scenario.model_error
    M = model.mass_matrix(model.kinematics(config))
    lever = float(np.linalg.norm(model.task_pose(config)[:3] - config[:3]))
    flow = float(np.linalg.norm(scenario.current)) + largest_speed(scenario.waves)
    effects = [drag_accelerations(model, config, flow)]
    effects += [wave_accelerations(model, config, wave) for wave in scenario.waves]
    friction = np.append(np.zeros(6), unknown.joint_friction.torques(model.num_joints)[1])
    effects += [norms(np.linalg.solve(M, each))
                for each in (friction, *unknown_forces(scenario, model, config))]
    force = error + largest_error(scenario.actuation) * sensed_contact(scenario).force
    axes = scenario.disturbance.axes(model.size)
    out: np.ndarray = TIMES * np.sum(effects, axis=0) + force * np.array(
        [1.0 / np.min(np.diag(M)[:3]), lever / np.min(np.diag(M)[3:6])]) + [
        np.max(axes[:3]), np.max(axes[3:6])]
    return out


def unknown_forces(scenario: Scenario, model: ContactModel, config: np.ndarray
                  ) -> Iterator[np.ndarray]:
    """Yields the generalised force (6+n,) on the robot at rest by each declared unknown alone."""
    still, unknown = np.zeros(model.size), scenario.model_error
    for error in (*(ModelError(**{name: getattr(unknown, name)}) for name in STATIC),
                  *(ModelError(buoyancy_shift=part) for part in np.diag(unknown.buoyancy_shift))):
        if error.size > 0.0:
            true, known = (each.inverse_dynamics(each.kinematics(config), still, still, np.zeros(6))
                           for each in (UvmsModel(simulated_uvms(scenario.model, error)), model))
            yield true - known


def supervisor_of(scenario: Scenario, model: ContactModel) -> Supervision | None:
    """Returns the settings of the supervisor, with drift and readings by all that is declared."""
    if scenario.supervisor is None or scenario.contact.declared_wall() is None:
        return scenario.supervisor
    limits = thresholds_of(scenario, model)
    return replace(scenario.supervisor, drift=limits.drift, reading=np.array(
        [limits.touch / TOUCH, limits.error, limits.constant]))


def norms(acceleration: np.ndarray) -> np.ndarray:
    """Returns the norms of the linear and the angular part of the vehicle's (2,)."""
    return np.array([np.linalg.norm(acceleration[:3]), np.linalg.norm(acceleration[3:6])])


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
            found = np.maximum(found, norms(
                model.drift(config, through) - model.drift(config, still)))
    return found


def wave_accelerations(model: ContactModel, config: np.ndarray, wave: Wave) -> np.ndarray:
    """Returns the largest linear and angular acceleration of the vehicle (2,) by a wave.

    Of a robot at rest, by drag, added mass and the pressure of the water that accelerates, (2) of
    `tube.unmodelled_dynamics`, over `PHASES` headings and phases.
    """
    heading, phase = (each.ravel() for each in np.meshgrid(*2 * [2.0 * np.pi / PHASES * np.arange(
        PHASES)]))
    configs = np.tile(config, (len(phase), 1))
    at = Motions(configs, np.zeros_like(configs), heading, phase, np.zeros((len(phase), 0)),
                 model.kinematics(configs))
    effect, _ = by_water(family(model, []), (0.0, 0.0), (wave.speed, wave.frequency))(at)
    largest: np.ndarray = np.max([norms(each) for each in effect], axis=0)
    return largest
