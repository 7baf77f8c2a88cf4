"""The controller of a scenario at the clock of one's own loop.

It is the Diagram of `make_controller`, advanced: `step(t)` simulates it to t with the samples of
the last step, puts in the new ones, handles the events of t, such as a plan, and reads the command
that is sampled then. So at regular times it equals `simulate` of a plant with these samples, bit
for bit. Other samples have these outcomes, and never an exception:

    early, or late by less than `longest_gap`    a tick like any other; late: an alarm
    repeated, out of order, time not finite      not used: the last command again; an alarm
    no state, NaN or of a wrong size             the plan's own command, without feedback; an alarm
    no force, NaN or of a wrong size             a missing reading, see `force_status`; an alarm
    an age of the fix that is not finite         no fix, for a supervisor
    an exception of the planner                  the last plan goes on; an alarm
    nothing of use for `longest_gap`, no plan,   stopped: keeps vehicle and joints at the last place
    any other exception                          known, see `station_keeping`, until `reset`; an
                                                 alarm

At a tick without a new state, stopped, its command is the equilibrium of that place, open loop.
"""

import math
import weakref
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator

from uvms_drake.actuation import SampledCommand
from uvms_drake.certificate.certificate import AnyCertificate, stale_reason
from uvms_drake.common.errors import InvalidParameter, RunFailed, require, vector, within
from uvms_drake.common.finite import is_finite
from uvms_drake.control.limits import resolved_radii
from uvms_drake.control.mpc.nominal_mpc import NominalMpc
from uvms_drake.loop.command import READ, LoopCommand, Mode, Outputs, alarms_of, mode_of
from uvms_drake.loop.planner_process import PlannerProcess
from uvms_drake.loop.station_keeping import station_command
from uvms_drake.model.signals.sample_and_hold import SAME
from uvms_drake.model.signals.sensor_actuator import MEASURED_FORCE, VEHICLE_WRENCH
from uvms_drake.station.contact.bounds import sensed_contact, sensing_of
from uvms_drake.station.controller import make_controller
from uvms_drake.station.problem import load_model, start_state
from uvms_drake.station.scenario.scenario import Scenario, Start
from uvms_drake.station.step_size import with_step

OVERDUE = 1.5
"""Time between two ticks in periods above which the second is late."""


class Controller(AbstractContextManager["Controller"]):
    """Controller of a scenario for a loop of one's own: samples in, a command out, at each tick.

    With `wait` it has a process, which `close` ends, as does a `with` statement.

    Attributes:
        scenario: The scenario, with the certificate's tube and the loop's clock.
        model: The controller's model.
        period: Period of regular ticks [s].
        tube: Radii of the tube, for display.

    Args:
        scenario: The scenario; of its plant, sensors and faults nothing is simulated, but the
            declared properties of the force sensor count. Its `SampledCommand` is the clock of the
            loop, with the delay from a tick until thrusters and joints get its command.
        certificate: Its certificate, whose tube is used; None: the declared tube.
        period: Period of the ticks [s], if the scenario has no `SampledCommand`; by default 0.02 s.
        wait: Longest time that a step waits for a plan [s], which a process of its own computes,
            see `mpc.in_advance`; None: the step computes it itself, however long that takes.
        longest_gap: Time without a sample of use after which it stops [s].

    Raises:
        InvalidParameter: A value cannot be used, or the certificate is not that of the scenario.
    """

    def __init__(self, scenario: Scenario, certificate: AnyCertificate | None = None, *,
                 period: float = 0.02, wait: float | None = None, longest_gap: float = 0.5):
        if certificate is not None:
            changed = stale_reason(certificate, scenario)
            require(certificate.certified and not changed, "certificate", certificate.verdict,
                    f"that of this scenario: {changed} has changed since" if changed else "one "
                    "that holds")
            scenario = certificate.applied_to(scenario)
        # The clock of the loop, of the scenario or regular.
        clock = next((part for part in scenario.actuation
                      if isinstance(part, SampledCommand)), None)
        if clock is None:
            clock = SampledCommand(period, delay=0.0)
            scenario = replace(scenario, actuation=[clock, *scenario.actuation])
        require(longest_gap > clock.period, "longest_gap", longest_gap,
                f"more than the period, {clock.period:g} s")
        require(wait is None or scenario.mpc.in_advance, "mpc.in_advance", False,
                "true: only a plan that comes at the next sample can be computed beside the loop")
        if scenario.contact.declared_wall() is not None:  # A reading is held until the next tick.
            look, repeats = sensed_contact(scenario).period, sensing_of(scenario).repeats
            require(not repeats or clock.period <= look * (repeats - 1.0 + SAME), "contact.period",
                    look, f"at least {clock.period / (repeats - 1):.3g} s: {repeats} readings that "
                    f"are equal are a frozen sensor's, and one is held for {clock.period:g} s")
        self.model, self.period, self._delay = load_model(scenario), clock.period, clock.delay
        if scenario.simulator.max_step_size == 0.0:
            scenario = with_step(scenario, self.model)
        self.scenario, self.tube = scenario, resolved_radii(scenario.tube)
        self._longest_gap, self._wait = longest_gap, wait
        self._diagram = make_controller(scenario, self.model, measured=True)
        self._outputs = Outputs(scenario, self.model, clock.period)
        self._mpc: NominalMpc = self._diagram.GetSubsystemByName("tube_mpc").GetSubsystemByName(
            "nominal_mpc")
        self._computer: PlannerProcess | None = None
        self._simulator: Simulator | None = None

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the process of the planner, if there is one; only `reset` begins anew."""
        self._simulator = None
        if self._computer is not None:
            self._computer.close()

    def reset(self, state: np.ndarray, force: np.ndarray | None = None) -> None:
        """Begins anew at a state, at rest within the limits, and makes the first plan.

        It takes seconds; the clock starts at the first step after it. The task is the scenario's.

        Args:
            state: Measured (𝔮, ζ) (2(6+n),) [m, rad, m/s, rad/s].
            force: 𝔉_s (6,) [N, N m], of a tared sensor; None: no contact.

        Raises:
            InvalidParameter: The state has another size, is not finite, or outside of the limits.
            RunFailed: There is no plan from it.
        """
        size, scenario = self.model.size, self.scenario
        state = vector("state", state, 2 * size)
        with within("state"):
            start_state(replace(scenario, start=Start(state[:6], state[6:size])), self._mpc.ocp)
        self.close()
        if self._wait is not None:
            self._computer = PlannerProcess(scenario, self._wait)
            weakref.finalize(self, self._computer.close)  # The Diagram outlives it.
        self._mpc.computer, self._mpc.raises = self._computer, False
        simulator = Simulator(self._diagram)
        ApplySimulatorConfig(scenario.simulator, simulator)
        simulator.set_target_realtime_rate(0.0)
        self._simulator, self._ticks, self._unused, self._due = simulator, 0, 0, [0.0]
        self._zero = self._heard = math.nan
        self._state, self._spent, self._stopped = state, 0.0, ""
        self._put(state, np.zeros(6) if force is None else vector("force", force, 6), 0.0)
        simulator.Initialize()
        self._command = self._station(0.0, None, mode=Mode.REPEATED)

    def set_task(self, force: np.ndarray | None = None, place: np.ndarray | None = None) -> None:
        """Changes the task from the next step on; None leaves a part of it.

        Of a known surface the problem of a new force is made here: no command for about a second,
        perhaps beyond `longest_gap`. The next step has an alarm then. With `wait` its first plan
        must be there at the next sample: one that is late is begun anew at each, with an alarm.

        Args:
            force: 𝔉_des (6,) [N, N m]; one that cannot be held is refused, which is an alarm.
            place: Place across the direction of a sensed contact (3,) [m].

        Raises:
            InvalidParameter: A value has no meaning, or the scenario does not take it.
        """
        for name, value, size in (("desired_force", force, 6), ("place", place, 3)):
            if value is not None:
                require(self._diagram.HasInputPort(name), name, value, "left out: the scenario "
                        "has a mission, or its surface is known")
                self._fix({name: vector(name, value, size)})
        if force is not None:
            began = perf_counter()
            self._mpc.planner.solver_for(np.asarray(force, dtype=float))
            self._spent += perf_counter() - began

    def step(self, time: float, state: np.ndarray | None = None, force: np.ndarray | None = None,
             fix_age: float = 0.0) -> LoopCommand:
        """Returns the command for the samples of a tick; see the module for bad ones.

        Args:
            time: Time of the tick by the loop's clock [s].
            state: Measured (𝔮, ζ) (2(6+n),) [m, rad, m/s, rad/s]; None: missing.
            force: 𝔉_s (6,) [N, N m]; None: missing, or the scenario has no sensor of it.
            fix_age: Age of the fix of position and velocity behind `state`, for a supervisor [s].

        Raises:
            InvalidParameter: There was no `reset` before.
        """
        self._begun()
        now = float(sample_of([time], 1)[0])
        if not self._stopped:
            try:
                return self._stepped(now, state, force, fix_age)
            except Exception as error:  # In the loop, whatever has failed.
                why = "" if isinstance(error, RunFailed) else "it failed: "
                self._stopped = f"stopped: {why}{' '.join(str(error).split())}"
            self._heard = self._command.time
        return self._keep_station(now, state)

    def signal(self, name: str) -> Any:
        """Returns a signal of the last tick, an output port of `make_controller`."""
        return self._diagram.GetOutputPort(name).Eval(self._begun().get_context())

    def _begun(self) -> Simulator:
        if self._simulator is None:
            raise InvalidParameter("reset", "missing", "called before the first step")
        return self._simulator

    def _fix(self, values: dict[str, np.ndarray]) -> None:
        """Puts in values, of those for which there are ports."""
        context = self._begun().get_mutable_context()
        for name, value in values.items():
            if self._diagram.HasInputPort(name):
                self._diagram.GetInputPort(name).FixValue(context, value)

    def _put(self, state: np.ndarray, force: np.ndarray, fix_age: float) -> None:
        """Puts in a tick and its samples."""
        self._fix({"tick": np.array([float(self._ticks)]), "state": state, MEASURED_FORCE: force,
                   "fix_age": np.array([fix_age])})

    def _stepped(self, time: float, state: np.ndarray | None, force: np.ndarray | None,
                 fix_age: float) -> LoopCommand:
        simulator = self._begun()
        if not self._ticks and math.isfinite(time):
            self._zero = self._heard = time
        now, last = time - self._zero, simulator.get_context().get_time()
        if not (last < now < math.inf if self._ticks else now == 0.0):
            return self._passed_over(time)
        # The samples, which count as missing if they cannot be read.
        gap, measured, read = now - last, sample_of(state, 2 * self.model.size), sample_of(force, 6)
        if is_finite(measured):
            self._state, self._heard = measured, time
        # Too long without any; the time in `set_task` is no gap.
        longest, self._spent = self._longest_gap + self._spent, 0.0
        for what, since in (("sample", gap), ("state", time - self._heard)):
            if since > longest:
                raise RunFailed(f"no {what} for {since:.3g} s")
        # The Diagram to this instant, with the samples before; then the new ones, and its events.
        for instant in sorted({now, *self._due}):
            if last < instant <= now:
                simulator.AdvanceTo(instant)
        self._due = [due for due in (*self._due, now + self._delay) if due > now]
        self._ticks, self._unused = self._ticks + 1, 0
        self._put(measured, read, np.nan_to_num(sample_of([fix_age], 1), nan=math.inf)[0])
        limited = self.signal("input_limited")  # After the events the law would be evaluated again.
        simulator.AdvancePendingEvents()
        signals = {name: self.signal(name) for name in READ if self._diagram.HasOutputPort(name)}
        trouble = self._computer.trouble if self._computer is not None else ""
        alarms = [text for text, holds in (
            (f"late: {gap:.3g} s since the last tick", gap > OVERDUE * self.period),
            ("the state is missing", not is_finite(measured)),
            ("the force is missing",
             self._diagram.HasInputPort(MEASURED_FORCE) and not is_finite(read)),
            (trouble, trouble)) if holds]
        self._command = self._outputs.of(
            time, self.signal("newest_command"), self._state, read if is_finite(read) else None,
            signals.get(VEHICLE_WRENCH), int(signals["safety"][4]) if "safety" in signals else 0,
            mode=mode_of(signals),
            alarms=(*alarms, *alarms_of({**signals, "input_limited": limited})),
            plan=self.signal("plan"))
        return self._command

    def _passed_over(self, time: float) -> LoopCommand:
        """Returns the last command again, for a tick whose time cannot be; stops after many."""
        self._unused += 1
        alarm = f"the time {time:g} s is not after that of the last tick, {self._command.time:g} s"
        if self._unused * self.period > self._longest_gap:
            raise RunFailed(alarm)
        return replace(self._command, mode=Mode.REPEATED, alarms=(alarm,))

    def _keep_station(self, time: float, state: np.ndarray | None) -> LoopCommand:
        """Returns the command while stopped, of a time that is NaN if it cannot be read."""
        measured = sample_of(state, 2 * self.model.size)
        is_new = is_finite(measured) and time > self._heard
        self._heard = self._heard if math.isnan(time) else time
        for given in (measured, None) if is_new else (None,):
            alarms = (self._stopped, *(["without a state: open loop"] if given is None else []))
            self._command = replace(self._command, mode=Mode.STOPPED, alarms=alarms)
            with suppress(Exception):  # As at a state without an inverse: then the next one.
                self._command = self._station(time, given, mode=Mode.STOPPED, alarms=alarms,
                                              isolated=self._command.isolated)
                break
        return self._command

    def _station(self, time: float, state: np.ndarray | None, **others: Any) -> LoopCommand:
        """Returns the command that keeps station at the last place; None: without a state."""
        place = self._state[: self.model.size]
        state = np.append(place, np.zeros(self.model.size)) if state is None else state
        return self._outputs.of(time, station_command(self.scenario, self.model, place, state),
                                state, np.zeros(6), **others)


def sample_of(value: object, size: int) -> np.ndarray:
    """Returns a sample (size,); NaN if it is missing, of a wrong size, or not finite."""
    with suppress(InvalidParameter):
        return vector("sample", value, size)
    return np.full(size, np.nan)
