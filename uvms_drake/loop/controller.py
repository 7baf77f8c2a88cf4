"""The controller of a scenario at the clock of one's own loop.

It is the Diagram of `make_controller`, advanced: `step(t)` simulates it to t with the samples of
the last step, puts in the new ones, handles the events of t, such as a plan, and reads the command
that is sampled then. So at regular times it equals `simulate` of a plant with these samples, bit
for bit. Other samples have these outcomes, and never an exception:

    early, or late by less than `longest_gap`    a tick like any other; late: an alarm
    repeated, out of order, time not finite      not used: the last command again; an alarm
    no state, NaN or of a wrong size             the plan's own command, without feedback; an alarm
    no force, NaN or of a wrong size             a missing reading, see `force_status`; an alarm
    nothing of use for `longest_gap`; a failure  stopped: keeps station, until `reset`; an alarm

Stopped, it keeps vehicle and joints at the last place known, by the law of a retreat
(`control.supervisor.retreat`), within the limits: without plan, observer, or force on a surface. At
a tick without a new state its command is the equilibrium of that place, open loop.
"""

import math
import weakref
from collections.abc import Callable, Iterator
from dataclasses import replace
from time import perf_counter
from typing import Self

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator

from uvms_drake.actuation import SampledCommand
from uvms_drake.certificate.certificate import AnyCertificate, stale_reason
from uvms_drake.common.errors import InvalidParameter, RunFailed, require, vector, within
from uvms_drake.common.finite import is_finite
from uvms_drake.control.feedback.ancillary import limited_input
from uvms_drake.control.laws.law import pair_of
from uvms_drake.control.laws.tip_first import BlockGains
from uvms_drake.control.limits import resolved_radii
from uvms_drake.control.mpc.nominal_mpc import NominalMpc
from uvms_drake.control.mpc.planner import HOVERED, TROUBLE
from uvms_drake.control.supervisor.detections import CAUSES
from uvms_drake.control.supervisor.retreat import WATCHING, law_of_retreat
from uvms_drake.loop.command import LoopCommand, Mode, Outputs
from uvms_drake.loop.planner_process import PlannerProcess
from uvms_drake.model.signals.sample_and_hold import SAME, TickedVector
from uvms_drake.model.signals.sensor_actuator import MEASURED_FORCE, VEHICLE_WRENCH
from uvms_drake.sensing.force_fault_detector import ForceStatus
from uvms_drake.station.contact.bounds import sensed_contact, sensing_of
from uvms_drake.station.controller import make_controller
from uvms_drake.station.problem import load_model, make_ocp, start_state
from uvms_drake.station.scenario.scenario import Scenario, Start
from uvms_drake.station.step_size import with_step

PERIOD = 0.02
"""Period of a loop whose scenario has no clock [s]."""
STATION = BlockGains(2.0, 1.0)
"""Largest gains of the vehicle while stopped; stiffer ones overshoot from afar, at a limit of u."""
FORCE_ALARMS: dict[str, Callable[[int], str]] = {
    "force_lost": lambda lost: "no force for so long that the tip retreats",
    "force_status": lambda status: f"the force is {ForceStatus(status).name.lower()}"}
"""Alarms by the signals that are not zero then."""
OVERDUE = 1.5
"""Time between two ticks in periods above which the second is late."""


class _Stop(Exception):
    """The samples are such that the loop stops; the text says why."""


class Controller:
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
                 period: float = PERIOD, wait: float | None = None, longest_gap: float = 0.5):
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
        require(wait is None or scenario.mpc.in_advance, "mpc.in_advance",
                scenario.mpc.in_advance,
                "true: only a plan that comes at the next sample can be computed beside the loop")
        self.model, self.period = load_model(scenario), clock.period
        if scenario.simulator.max_step_size == 0.0:
            scenario = with_step(scenario, self.model)
        self.scenario, self.tube = scenario, resolved_radii(scenario.tube)
        self._delay, self._longest_gap = clock.delay, longest_gap
        self._diagram = make_controller(scenario, self.model, measured=True)
        _check_detector(scenario, clock.period)
        self._senses = self._diagram.HasInputPort(MEASURED_FORCE)
        self._known = {name for name in FORCE_ALARMS if self._diagram.HasOutputPort(name)}
        self._ticked = next(system for system in self._diagram.GetSystems()
                            if isinstance(system, TickedVector))
        self._outputs = Outputs(scenario, self.model, clock.period)
        self._mpc: NominalMpc = self._diagram.GetSubsystemByName("tube_mpc").GetSubsystemByName(
            "nominal_mpc")
        self._computer = None if wait is None else PlannerProcess(scenario, wait)
        if self._computer is not None:
            self._mpc.compute_by(self._computer)
            weakref.finalize(self, self._computer.close)  # The Diagram outlives it.
        self._supervised = self._diagram.HasOutputPort("safety")
        self._has_wrench = scenario.ancillary.takes_wrench and self._diagram.HasOutputPort(
            VEHICLE_WRENCH)
        law = law_of_retreat(scenario.ancillary, self.model.num_joints)
        self._station_law = replace(law, vehicle=BlockGains(
            min(law.vehicle.k, STATION.k), min(law.vehicle.sigma, STATION.sigma)))
        self._simulator: Simulator | None = None

    def __enter__(self) -> Self:
        return self

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
            start_state(replace(scenario, start=Start(state[:6], state[6:size])),
                        make_ocp(scenario, self.model))
        if self._computer is not None:
            self._computer.forget()
        simulator = Simulator(self._diagram)
        ApplySimulatorConfig(scenario.simulator, simulator)
        simulator.set_target_realtime_rate(0.0)
        self._simulator, self._ticks = simulator, 0
        self._zero = self._now = self._heard = math.nan
        self._unused, self._state, self._spent, self._stopped = 0, state, 0.0, ""
        self._fix("tick", np.zeros(1))
        self._put(state, np.zeros(6) if force is None else vector("force", force, 6))
        simulator.Initialize()
        self._command = self._station(0.0, Mode.REPEATED, (), None)

    def set_task(self, force: np.ndarray | None = None, place: np.ndarray | None = None) -> None:
        """Changes the task from the next step on; None leaves a part of it.

        Of a known surface the problem of a new force is made here, which takes seconds. The next
        step may be as much later, beyond `longest_gap`; it has an alarm then.

        Args:
            force: 𝔉_des (6,) [N, N m]; one that cannot be held is refused, which is an alarm.
            place: Place across the direction of a sensed contact (3,) [m].

        Raises:
            InvalidParameter: A value has no meaning, or the scenario does not take it.
        """
        self._begun()
        for name, value, size in (("desired_force", force, 6), ("place", place, 3)):
            if value is not None:
                require(self._diagram.HasInputPort(name), name, value, "left out: the scenario "
                        "has a mission, or its surface is known")
                self._fix(name, vector(name, value, size))
        if force is not None:
            began = perf_counter()
            self._mpc.prepare(np.asarray(force, dtype=float))
            self._spent += perf_counter() - began

    def step(self, time: float, state: np.ndarray | None = None, force: np.ndarray | None = None
             ) -> LoopCommand:
        """Returns the command for the samples of a tick; see the module for bad ones.

        Args:
            time: Time of the tick by the loop's clock [s].
            state: Measured (𝔮, ζ) (2(6+n),) [m, rad, m/s, rad/s]; None: missing.
            force: 𝔉_s (6,) [N, N m]; None: missing, or the scenario has no sensor of it.

        Raises:
            InvalidParameter: There was no `reset` before.
        """
        self._begun()
        now = float(sample_of([time], 1)[0])
        if not self._stopped:
            try:
                return self._stepped(now, state, force)
            except _Stop as why:
                self._stopped = f"stopped: {why}"
            except Exception as error:  # In the loop, whatever has failed.
                self._stopped = f"stopped: it failed: {' '.join(str(error).split())}"
            self._heard = self._command.time
        return self._keep_station(now, state)

    def signal(self, name: str) -> np.ndarray:
        """Returns a signal of the last tick, an output port of `make_controller`."""
        value: np.ndarray = self._diagram.GetOutputPort(name).Eval(self._begun().get_context())
        return value

    def _begun(self) -> Simulator:
        if self._simulator is None:
            raise InvalidParameter("reset", "missing", "called before the first step")
        return self._simulator

    def _fix(self, name: str, value: np.ndarray) -> None:
        self._diagram.GetInputPort(name).FixValue(
            self._begun().get_mutable_context(), value)

    def _put(self, state: np.ndarray, force: np.ndarray) -> None:
        """Puts in measured state and force."""
        self._fix("state", state)
        if self._senses:
            self._fix(MEASURED_FORCE, force)

    def _stepped(self, time: float, state: np.ndarray | None, force: np.ndarray | None
                 ) -> LoopCommand:
        if math.isnan(self._zero) and math.isfinite(time):  # The first tick.
            self._zero = self._heard = time
        now, last = time - self._zero, self._now
        if not (last < now < math.inf or (math.isnan(last) and now == 0.0)):
            return self._passed_over(time)
        gap = 0.0 if math.isnan(last) else now - last
        alarms = [f"late: {gap:.3g} s since the last tick"] if gap > OVERDUE * self.period else []
        # The samples, which count as missing if they cannot be read.
        size = self.model.size
        measured, read = sample_of(state, 2 * size), sample_of(force, 6)
        if is_finite(measured):
            self._state, self._heard = measured, time
        else:
            alarms.append("the state is missing")
        if self._senses and not is_finite(read):
            alarms.append("the force is missing")
        # Too long without any; the time in `set_task` is no gap.
        longest, self._spent = self._longest_gap + self._spent, 0.0
        if gap > longest:
            raise _Stop(f"no sample for {gap:.3g} s")
        if time - self._heard > longest:
            raise _Stop(f"no state for {time - self._heard:.3g} s")
        # The Diagram to this instant, with the samples before; then the new ones, and its events.
        simulator = self._begun()
        if self._computer is not None:
            self._computer.until = perf_counter() + self._computer.wait
        if gap > 0.0:
            self._advance(simulator, now)
        self._ticks += 1
        self._fix("tick", np.array([float(self._ticks)]))
        self._put(measured, read)
        simulator.AdvancePendingEvents()
        self._now, self._unused = now, 0
        tau = self._ticked.newest(self._diagram.GetSubsystemContext(
            self._ticked, simulator.get_context()))
        plan = self._diagram.GetOutputPort("plan").Eval(simulator.get_context())
        self._command = self._outputs.of(
            time, tau, self._state, read if self._senses and is_finite(read) else None,
            self._mode(), (*alarms, *self._alarms()), plan,
            self.signal(VEHICLE_WRENCH) if self._has_wrench else None)
        return self._command

    def _advance(self, simulator: Simulator, now: float) -> None:
        """Advances the Diagram, with the end of a step where the last command begins to act."""
        due, periods = self._now + self._delay, self._now / self.period
        if self._now < due < now and abs(periods - round(periods)) > SAME:
            simulator.AdvanceTo(due)
        simulator.AdvanceTo(now)

    def _mode(self) -> Mode:
        if self._supervised and self.signal("safety")[0] != WATCHING:
            return Mode.RETREATING
        return Mode.HOVERING if self.signal("report")[1] == HOVERED else Mode.RUNNING

    def _alarms(self) -> Iterator[str]:
        """Yields the alarms of the controller at the last tick."""
        status, refused = self.signal("report")[[1, 6]]
        if self._mode() == Mode.RETREATING:
            cause = list(CAUSES)[int(self.signal("safety")[1]) - 1]
            yield f"retreats: {cause}: {CAUSES[cause]}"
        if self._computer is not None and self._computer.trouble:
            yield self._computer.trouble
        if status in TROUBLE:
            yield TROUBLE[status]
        if refused:
            yield "the desired force is refused"
        if self.signal("input_limited")[0]:
            yield "a limit cuts the command"
        for name in self._known:
            if value := int(self.signal(name)[0]):
                yield FORCE_ALARMS[name](value)

    def _passed_over(self, time: float) -> LoopCommand:
        """Returns the last command again, for a tick whose time cannot be; stops after many."""
        self._unused += 1
        alarm = f"the time {time:g} s is not after that of the last tick, {self._command.time:g} s"
        if self._unused * self.period > self._longest_gap:
            raise _Stop(alarm)
        return replace(self._command, mode=Mode.REPEATED, alarms=(alarm,))

    def _keep_station(self, time: float, state: np.ndarray | None) -> LoopCommand:
        """Returns the command while stopped, of a time that is NaN if it cannot be read."""
        measured = sample_of(state, 2 * self.model.size)
        is_new = is_finite(measured) and time > self._heard
        self._heard = self._heard if math.isnan(time) else time
        for given in (measured, None) if is_new else (None,):
            alarms = (self._stopped, *(["without a state: open loop"] if given is None else []))
            try:
                self._command = self._station(time, Mode.STOPPED, alarms, given)
                break
            except Exception:  # As at a state without an inverse: then the next one.
                self._command = replace(self._command, mode=Mode.STOPPED, alarms=alarms)
        return self._command

    def _station(self, time: float, mode: Mode, alarms: tuple[str, ...],
                 state: np.ndarray | None) -> LoopCommand:
        """Returns the command that keeps station at the last place; None: without a state."""
        model, still, limits = self.model, np.zeros(self.model.size), self.scenario.limits
        place = np.concatenate([self._state[: model.size], still])
        state = place if state is None else state
        wanted = self._station_law.command(
            model, pair_of(model, state, place).given(contact=np.zeros(6)), lambda: still,
            lambda: still)
        _, tau, _ = limited_input(wanted.u, wanted.tau, wanted.M, np.asarray(limits.u),
                                  None if limits.tau is None else np.asarray(limits.tau))
        if not is_finite(tau):
            raise RunFailed("the command is not finite")
        return self._outputs.of(time, tau, state, np.zeros(6), mode, alarms)


def sample_of(value: object, size: int) -> np.ndarray:
    """Returns a sample (size,); NaN if it is missing, of a wrong size, or not finite."""
    try:
        sample = np.array(value, dtype=float)
    except (TypeError, ValueError):
        sample = np.empty(0)
    usable = sample.shape == (size,) and bool(np.isfinite(sample).all())
    return sample if usable else np.full(size, np.nan)


def _check_detector(scenario: Scenario, period: float) -> None:
    """Raises if the readings of a loop with a period [s] would be taken for a frozen sensor's.

    The detector counts equal readings at its own period, and a reading is held until the next tick.
    """
    if scenario.contact.declared_wall() is None:
        return
    look, repeats = sensed_contact(scenario).period, sensing_of(scenario).repeats
    looks = math.ceil(period / look - SAME)
    require(repeats == 0 or looks < repeats, "contact.period", look,
            f"more than {period / repeats:.3g} s: a reading is held over {looks} looks of the "
            f"detector of frozen sensors, in a loop of {period:g} s, and {repeats} are frozen")
