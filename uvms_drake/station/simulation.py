"""Runs a scenario: station, Simulator and logs to a `Record`."""

import time
from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import Context, Diagram, EventStatus

from uvms_drake.common.errors import RunFailed
from uvms_drake.common.progress import Progress, silent
from uvms_drake.common.wiring import release
from uvms_drake.control.limits import joint_limits
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.diagram import make_station, read_logs
from uvms_drake.station.problem import load_model
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.step_size import with_step

PROGRESS_PERIOD = 0.1
"""Simulated time between two calls of `progress` [s]."""


def simulate(
    scenario: Scenario,
    *,
    model: ContactModel | None = None,
    certified: bool = False,
    meshcat: Meshcat | None = None,
    realtime_rate: float | None = None,
    progress: Progress = silent,
    stop: Callable[[], bool] | None = None,
) -> Record:
    """Returns the record of a run from t = 0 to the scenario's duration.

    Args:
        scenario: Everything the run depends on.
        model: The controller's model; loaded if left out.
        certified: Whether tube and terminal set of the scenario are certified; it is passed on.
        meshcat: Meshcat of an `Illustration`, if any; it does not change the result.
        realtime_rate: Replacement of the scenario's `simulator.target_realtime_rate`.
        progress: Progress callback; it does not change the result.
        stop: Function polled for an early end of the run, as with a shorter duration.

    Raises:
        InvalidParameter: A value of the scenario cannot be used.
        RunFailed: The run started, but failed.
    """
    model = model or load_model(scenario)
    if scenario.simulator.max_step_size == 0.0:
        scenario = with_step(scenario, model)
    station = make_station(scenario, meshcat=meshcat, certified=certified, model=model)
    try:
        simulator = Simulator(station)
        ApplySimulatorConfig(scenario.simulator, simulator)
        if realtime_rate is not None:
            simulator.set_target_realtime_rate(realtime_rate)
        context = simulator.get_mutable_context()
        simulator.set_monitor(
            _monitor(station, progress, stop, scenario.duration, scenario.log_period))
        progress("first plan", 0.0)
        wall_time = _run(simulator, scenario.duration)
        if context.get_time() < scenario.duration:
            scenario = replace(scenario, duration=context.get_time())
        sampled = station.GetSubsystemByName("log.state").FindLog(context).sample_times()
        if context.get_time() - sampled[-1] > 1e-6 * scenario.log_period:
            station.ForcedPublish(context)  # The period does not go into the duration.
        logs = read_logs(station, context)
    finally:
        release(station)
    require_finite(logs)
    return make_record(scenario, model, logs, wall_time, certified)


def require_finite(logs: dict[str, np.ndarray]) -> None:
    """Raises `RunFailed` for the first logged signal that is not a number at some time."""
    for name in ("state", "nominal_state", "u", "tau", "force"):
        finite = np.all(np.isfinite(logs.get(name, np.zeros((1, 1)))), axis=1)
        if not np.all(finite):
            raise RunFailed(f"{name} is not finite from t = "
                            f"{logs['time'][np.argmin(finite)]:.3f} s on")


def _run(simulator: Simulator, duration: float) -> float:
    """Simulates to `duration` [s] and returns the wall time without initialization [s]."""
    try:
        simulator.Initialize()
        started = time.perf_counter()
        simulator.AdvanceTo(duration)
    except RunFailed:
        raise
    except (RuntimeError, np.linalg.LinAlgError) as error:  # Of Drake and NumPy.
        reason = " ".join(str(error).split())
        now = simulator.get_context().get_time()
        raise RunFailed(f"the simulation stopped at t = {now:.3f} s: {reason}") from error
    return time.perf_counter() - started


def _monitor(station: Diagram, progress: Progress, stop: Callable[[], bool] | None,
             duration: float, log_period: float) -> Callable[[Context], EventStatus]:
    """Returns a monitor of a Simulator that calls `progress`, and `stop` after the first log.

    A monitor is passive, while AdvanceTo in slices would end an integration step at each of them.
    """
    due = 0.0

    def watch(context: Context) -> EventStatus:
        """Reports progress and polls `stop` every `PROGRESS_PERIOD`."""
        nonlocal due
        now = context.get_time()
        if now >= due:
            due = now + PROGRESS_PERIOD
            progress(f"{now:.1f} of {duration:g} s", now / duration)
            if stop is not None and now >= log_period and stop():
                return EventStatus.ReachedTermination(station, "stopped")
        return EventStatus.DidNothing()

    return watch


def make_record(scenario: Scenario, model: ContactModel, logs: dict[str, np.ndarray],
                wall_time: float, certified: bool) -> Record:
    """Returns the record of a station's logs, with derived signals.

    Args:
        scenario: The scenario of the run.
        model: The controller's.
        logs: As `read_logs` returns them.
        wall_time: Of the simulation [s].
        certified: As in `simulate`.
    """
    size = model.size
    joint_lower, joint_upper = joint_limits(scenario.limits, model.q_lower, model.q_upper)
    arrays = logs | {
        "effective_disturbance": effective_disturbance(
            model, logs["state"], sent_input(model, logs), logs["acceleration"],
            scenario.contact.force_in_law(logs)),
        "penetration": logs["penetration"].reshape(-1),
        "state_lost": logs["state_lost"].reshape(-1),
        "input_limited": logs["input_limited"].reshape(-1),
        "chi_nominal": model.task_pose(logs["nominal_state"][:, :size])[:, :6],
        "chi_des": _goal(scenario, model, logs),
        "joint_lower": joint_lower,
        "joint_upper": joint_upper,
        "certified": np.array(certified),
    }
    known = {f.name for f in fields(Record)}
    signals = {name: logs[name] for name in logs if name not in known}
    record = Record(scenario=scenario, wall_time_s=wall_time, signals=signals,
                    **{name: value for name, value in arrays.items() if name in known})
    vars(record)["model"] = model  # Loaded already: the cached property of that name.
    return record


def effective_disturbance(model: ContactModel, state: np.ndarray, u: np.ndarray,
                          acceleration: np.ndarray, contact: np.ndarray | None = None
                          ) -> np.ndarray:
    """Returns ζ̇ − f(𝔮, ζ) − 𝔲 (T, 6+n) [m/s², rad/s²]: all that the controller does not model.

    The disturbance, errors of the model, another surface, a current, a stuck joint: every deviation
    from ζ̇ = f + 𝔲, in the units of d̃. It is d where there is nothing
    else. 𝔲 is the sent command, after limits and the hold of a clock, which d̃ does not cover; see
    `sent_input`.

    Args:
        model: The controller's.
        state: (𝔮, ζ) (T, 2(6+n)).
        u: 𝔲, the command (T, 6+n).
        acceleration: ζ̇ of the robot (T, 6+n).
        contact: The force that the law takes in place of the surface's, if it does (T, 6).
    """
    config, zeta = np.split(state, 2, axis=1)
    return acceleration - model.drift(config, zeta, contact) - u


def sent_input(model: ContactModel, logs: dict[str, np.ndarray]) -> np.ndarray:
    """Returns 𝔲 as it is sent (T, 6+n): M⁻¹τ of a clock's hold, the law's if there is none."""
    if "zoh_command" not in logs:
        return logs["u"]
    M = model.mass_matrix(model.kinematics(logs["state"][:, : model.size]))
    sent: np.ndarray = np.linalg.solve(M, logs["zoh_command"][..., None])[..., 0]
    return sent


def _goal(scenario: Scenario, model: ContactModel, logs: dict[str, np.ndarray]) -> np.ndarray:
    """Returns the pose χ_des (6,) that the end-effector was to have at the end.

    In a sensed contact it is the last target, in the attitude of the task.
    """
    pose = model.surface.pose_for(logs["desired_force"][-1], scenario.task.pose)
    if "target" not in logs:
        return pose
    return np.concatenate([logs["target"][-1], pose[3:]])
