"""Runs a scenario: station, Simulator and logs to a `Record`."""

import time
import traceback
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import Context, Diagram, EventStatus

from uvms_drake.common.alarm import LOGGER
from uvms_drake.common.errors import InvalidParameter, RunFailed
from uvms_drake.common.progress import Progress, silent
from uvms_drake.common.wiring import release
from uvms_drake.control.limits import joint_limits
from uvms_drake.mission.law import DONE
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.diagram import make_station, read_logs
from uvms_drake.station.problem import load_model
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.step_size import with_step

PROGRESS_PERIOD = 0.1
"""Simulated time between two calls of `progress` [s]."""
REST = 3.0
"""Time for which a run goes on when all steps of its mission are done [s]."""
SIGNALS = ("state", "nominal_state", "acceleration", "u", "tau", "force")
"""Signals without which a run does not go on, once one is no number."""


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

    It ends before, `REST` after a mission that is done, as with a shorter duration. An exception
    inside of the run, of a law, the MPC, a sensor or the plant, ends it, and so does a signal that
    is no number any more: the record has all until then, and time and cause as `failure`. Before
    the second logged sample there is nothing to record, and it is raised.

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
        RunFailed: The run failed before there was anything to record.
    """
    model = model or load_model(scenario)
    if scenario.simulator.max_step_size == 0.0:
        scenario = with_step(scenario, model)
    station = make_station(scenario, meshcat=meshcat, certified=certified, model=model)
    declared = np.array(scenario.duration)
    try:
        simulator = Simulator(station)
        ApplySimulatorConfig(scenario.simulator, simulator)
        if realtime_rate is not None:
            simulator.set_target_realtime_rate(realtime_rate)
        context = simulator.get_mutable_context()
        simulator.set_monitor(
            _monitor(station, progress, stop, scenario.duration, scenario.log_period))
        # The run, which may end before its duration.
        progress("first plan", 0.0)
        wall_time, error = _run(simulator, scenario)
        if error is None:
            failure, scenario = "", replace(scenario, duration=context.get_time())
        else:
            failure = _words(error, context.get_time())
            if len(_sampled(station, context)) < 2 or "KeyboardInterrupt" in failure:
                if isinstance(error, InvalidParameter | RunFailed):
                    raise error
                raise RunFailed(failure) from error
        logs, not_finite = finite_part(read_logs(station, context))
    finally:
        release(station)
    if failure := not_finite or failure:
        LOGGER.error("the run FAILED %s", failure)
    return make_record(scenario, model, logs | {
        "failure": np.array(failure), "declared_duration": declared}, wall_time, certified)


def finite_part(logs: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], str]:
    """Returns the logs before the first signal that is no number, and in words when that was.

    All of the logs and an empty text if there is none.

    Raises:
        RunFailed: It was within the first two samples.
    """
    bad = {name: int(np.argmin(finite)) for name in SIGNALS
           if not np.all(finite := np.isfinite(logs[name]).all(axis=1))}
    if not bad:
        return logs, ""
    name, end = min(bad.items(), key=lambda each: each[1])
    failure = f"at t = {logs['time'][end]:.3f} s: {name} is not finite"
    if end < 2:
        raise RunFailed(failure)
    samples = np.count_nonzero(logs["mpc_time"] < logs["time"][end])
    return {key: values if key == "tube_report" else values[
        :samples if key.startswith("mpc_") or key == "step_seconds" else end]
        for key, values in logs.items()}, failure


def _run(simulator: Simulator, scenario: Scenario) -> tuple[float, BaseException | None]:
    """Simulates a run and logs it; returns the wall time [s], and the error that ended it."""
    station, context = simulator.get_system(), simulator.get_mutable_context()
    started, error = time.perf_counter(), None
    try:
        simulator.Initialize()
        started = time.perf_counter()  # Without the initialization.
        simulator.AdvanceTo(scenario.duration)
        if context.get_time() - _sampled(station, context)[-1] > 1e-6 * scenario.log_period:
            station.ForcedPublish(context)  # The period does not go into the duration.
    except (Exception, SystemExit) as raised:  # A failed assertion of Drake ends a program.
        error = raised
    return time.perf_counter() - started, error


def _sampled(station: Diagram, context: Context) -> np.ndarray:
    """Returns the instants of the log so far [s]."""
    times: np.ndarray = station.GetSubsystemByName("log.state").FindLog(context).sample_times()
    return times


def _words(error: BaseException, now: float) -> str:
    """Returns time [s] and cause of an error in a run in words, with its place in the source."""
    text = f"at t = {now:.3f} s: {' '.join(str(error).split())}"
    place = traceback.extract_tb(error.__traceback__)[-1]
    if isinstance(error, InvalidParameter | RunFailed) or place.filename == __file__:
        return text  # Of this package, or of Drake.
    return f"{text} ({type(error).__name__}, {Path(place.filename).name}, line {place.lineno})"


def _monitor(station: Diagram, progress: Progress, stop: Callable[[], bool] | None,
             duration: float, log_period: float) -> Callable[[Context], EventStatus]:
    """Returns a monitor of a Simulator that calls `progress`, and `stop` after the first log.

    A monitor is passive, while AdvanceTo in slices would end an integration step at each of them.
    """
    due, done = 0.0, np.inf

    def watch(context: Context) -> EventStatus:
        """Reports progress, polls `stop` and the mission, every `PROGRESS_PERIOD`."""
        nonlocal due, done
        now = context.get_time()
        if now >= due:
            due = now + PROGRESS_PERIOD
            progress(f"{now:.1f} of {duration:g} s", now / duration)
            if stop is not None and now >= log_period and stop():
                return EventStatus.ReachedTermination(station, "stopped")
            if station.HasOutputPort("mission_progress") and station.GetOutputPort(
                    "mission_progress").Eval(context)[1] == DONE:
                done = min(done, now)
                if now >= done + REST:
                    return EventStatus.ReachedTermination(station, "the mission is done")
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
