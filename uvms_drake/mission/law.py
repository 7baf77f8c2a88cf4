"""Mission as a state machine: references by time, tip and contact.

    Approach   off the wall: at its place, less deep than `deepest`, force 0
               → searching:   the tip is at the place; `deepest` is `within` deeper than the tip
               searching: force F, as deep as it needs, up to `deepest`
               → done:        a touch, and |F̂ − F| ≤ tolerance during `settle`
    Hold       → done:        a touch, and |F̂ − F| ≤ tolerance during `seconds`
    Slide      → done:        its time is over, and the tip is at the end of the line
    Retreat    force 0, straight back to `deepest`, `distance` less deep than the tip
               → done:        the tip is there; next is the next spot, the same, or the end
    any but Retreat → failed: time-out, or operator stop
    Hold, Slide     → failed: no touch during `patience`, or the force or the state is lost

A failed step is followed by the Retreat of its spot, and that by `on_failure`, or after a stop by
the end; a Retreat that times out is the end. After the supervisor's it is by `on_retreat`.

*Every mission ends:* a spot is begun at most 1 + `retries` times, and all is over after as often
the sum of all time-outs and a clock period a step, and the supervisor's waits. It is `DONE` if
every step is; else `RETREATED` after a stop, an ending failure or a failed retreat; else `SKIPPED`.
"""

import math
from typing import NamedTuple

import numpy as np

from uvms_drake.mission.steps import REACHED, ROUNDING, Approach, Mission, Retreat

RUNNING, DONE, SKIPPED, RETREATED = range(4)
"""Outcomes of a mission; of a step `DONE`, or `SKIPPED` if it failed or was left out."""

TIME_OUT, CONTACT_LOST, FORCE_LOST, STOPPED, STATE_LOST, SUPERVISED = range(1, 7)
"""Reasons of a failed step."""
REASONS = {TIME_OUT: "time-out", CONTACT_LOST: "contact lost", FORCE_LOST: "force lost",
           STOPPED: "stopped", STATE_LOST: "state lost", SUPERVISED: "retreated"}


class Measured(NamedTuple):
    """Measurements of a mission; those that are not finite are missing."""

    tip: np.ndarray
    """Depth along n and place (a, b) of the tip (3,) [m]."""
    force: float
    """Measured force F̂ along n [N]."""
    touched: bool
    """Whether the last reading was a touch."""
    lost: bool = False
    """Whether the force is lost."""
    stop: bool = False
    """Whether the operator stops the mission."""
    retreated: bool = False
    """Whether the supervisor of the controller has left the plan and retreats."""
    stiffer: bool = False
    """Whether it retreats since the force is above, or the wall stiffer than the declared one."""


class Due(NamedTuple):
    """References of a mission at a time; the controller gets them `Mission.lead` earlier."""

    force: float
    """Desired force along n [N]."""
    place: np.ndarray
    """Place (a, b) (2,) [m]."""
    deepest: float
    """Largest target depth along n [m]; inf: as deep as the force needs."""


class State(NamedTuple):
    """State of a mission."""

    step: int
    """Index of the current step; the number of steps at the end."""
    since: float
    """Beginning of that step [s]."""
    tip: np.ndarray
    """Last measured tip (3,) [m]."""
    place: np.ndarray
    """Place at which the step began, or its destination (2,) [m]."""
    deepest: float
    """See `Due` [m]."""
    searching: bool
    """Whether an approach searches for the wall."""
    in_band: float
    """Time since which the force is within its tolerance [s]; NaN while it is not."""
    touch: float
    """Time of the last touch [s]."""
    after: int
    """Index of the step after the next retreat."""
    tries: int
    """Number of retries of the spot."""
    home: bool
    """Whether the next retreat is the end, because of a failure or a stop."""
    outcome: int
    """Outcome of the mission, or `RUNNING`."""
    outcomes: tuple[int, ...]
    """Outcome of each step; `RUNNING` if it is not over."""
    reason: int
    """Reason of the last failed step; 0 for none."""
    failures: int
    """Number of failed steps."""
    waits: bool
    """Whether the step begins only when the supervisor gives the robot back."""


def begin(mission: Mission, tip: np.ndarray, t: float) -> State:
    """Returns the state at the start: off the wall, at the depth of the tip.

    Args:
        mission: Checked, with one step at least.
        tip: Depth and place (3,) [m].
        t: Now [s].
    """
    nothing = State(0, t, tip, tip[1:], float(tip[0]), searching=False, in_band=np.nan, touch=t,
                    after=0, tries=0, home=False, outcome=RUNNING,
                    outcomes=(RUNNING,) * len(mission.steps), reason=0, failures=0, waits=False)
    return _entered(mission, nothing, 0, t)


def due_at(mission: Mission, state: State, t: float) -> Due:
    """Returns the references due at a time t [s], if the current step lasts until then."""
    if state.outcome != RUNNING:
        return Due(0.0, state.place, state.deepest)
    step, spent = mission.steps[state.step], t - state.since
    return Due(step.desired_force(spent, state.searching), state.place + step.displacement(spent),
               state.deepest)


def advance(mission: Mission, state: State, measured: Measured, t: float
            ) -> tuple[State, Due]:
    """Returns the state after a measurement, and the references due then.

    It makes one transition at most.

    Args:
        mission: Checked.
        state: The state so far.
        measured: Measurements now.
        t: Now [s]; not less than before.
    """
    after = _advanced(mission, state, measured, t)
    return after, due_at(mission, after, t)


def _advanced(mission: Mission, state: State, measured: Measured, t: float) -> State:
    if state.outcome != RUNNING:
        return state
    step = mission.steps[state.step]
    state = _seen(mission, state, measured, t)
    if measured.retreated:
        return _waiting(mission, state, measured, t)
    if state.waits and not measured.stop:
        return state._replace(waits=False, since=t, touch=t)
    if isinstance(step, Retreat):
        if measured.stop:
            state = state._replace(after=len(mission.steps), home=True, reason=STOPPED)
        if _there(mission, state):
            return _entered(mission, _marked(state, DONE), state.after, t)
        if t - state.since >= step.timeout - ROUNDING:
            state = state._replace(home=True, reason=TIME_OUT, failures=state.failures + 1)
            return _over(_marked(state, SKIPPED))
        return state
    if reason := _failure(mission, state, measured, t):
        return _failed(mission, state, reason, t)
    if step.is_done(t - state.since, t - state.in_band, _there(mission, state), state.searching):
        return _entered(mission, _marked(state, DONE), state.step + 1, t)
    if isinstance(step, Approach) and not state.searching and _there(mission, state):
        return state._replace(searching=True, deepest=float(state.tip[0]) + step.within)
    return state


def _seen(mission: Mission, state: State, measured: Measured, t: float) -> State:
    """Returns the state with the measurements of now."""
    step = mission.steps[state.step]
    if np.all(np.isfinite(measured.tip)):
        first = math.isnan(state.deepest)  # The tip was not measured at the start.
        state = state._replace(
            tip=measured.tip, deepest=float(measured.tip[0]) if first else state.deepest)
    in_contact = measured.touched and not measured.lost
    asked = due_at(mission, state, t).force
    good = in_contact and asked > 0.0 and abs(measured.force - asked) <= step.tolerance
    since = (t if math.isnan(state.in_band) else state.in_band) if good else np.nan
    return state._replace(in_band=since, touch=t if in_contact else state.touch)


def _there(mission: Mission, state: State) -> bool:
    """Returns whether the tip is at the step's destination: back, a place, the end of a line."""
    step = mission.steps[state.step]
    if isinstance(step, Retreat):
        return bool(state.tip[0] <= state.deepest + REACHED)
    return bool(np.linalg.norm(state.tip[1:] - (state.place + step.along)) <= REACHED)


def _failure(mission: Mission, state: State, measured: Measured, t: float) -> int:
    """Returns the reason for which a step other than a retreat has failed; 0 if it has not."""
    step = mission.steps[state.step]
    for reason, holds in (
            (STOPPED, measured.stop),
            (STATE_LOST, step.touches and measured.lost and not np.all(np.isfinite(measured.tip))),
            (FORCE_LOST, step.touches and measured.lost),
            (CONTACT_LOST, step.touches and t - state.touch > mission.patience),
            (TIME_OUT, t - state.since >= step.timeout - ROUNDING)):
        if holds:
            return reason
    return 0


def _failed(mission: Mission, state: State, reason: int, t: float) -> State:
    """Returns the state in the retreat of the spot at which the current step has failed."""
    choice = mission.steps[state.step].on_failure
    first, last = mission.spot(state.step)
    again = choice == "retry" and state.tries < mission.retries and reason != STOPPED
    home = choice == "home" or reason == STOPPED
    after = len(mission.steps) if home else first if again else last + 1
    outcomes = tuple(SKIPPED if state.step <= i < last else outcome
                     for i, outcome in enumerate(state.outcomes))
    state = state._replace(outcomes=outcomes, reason=reason, failures=state.failures + 1,
                           tries=state.tries + again, home=home)
    return _entered(mission, state, last, t)._replace(after=after)


def _waiting(mission: Mission, state: State, measured: Measured, t: float) -> State:
    """Returns the state while the supervisor retreats; it waits for the time-out of a step.

    A stop is the end, and so is a retreat on the way to the end. The tip stays where it is.
    """
    stop, state = measured.stop, state._replace(deepest=float(state.tip[0]))
    if state.waits:
        timed_out = t - state.since >= mission.steps[state.step].timeout - ROUNDING
        if not stop and not timed_out:
            return state
        return _over(state._replace(home=True, failures=state.failures + 1,
                                    reason=STOPPED if stop else TIME_OUT))
    state = state._replace(failures=state.failures + 1, reason=STOPPED if stop else
                           state.reason if state.home else SUPERVISED)
    if stop or state.home or mission.on_retreat == "end":
        return _over(_marked(state, SKIPPED)._replace(home=True))
    first, last = mission.spot(state.step)
    if (mission.on_retreat == "retry" and state.tries < mission.retries and state.step < last
            and not measured.stiffer):
        state = _entered(mission, state._replace(tries=state.tries + 1), first, t)
    else:
        state = _entered(mission, state._replace(outcomes=tuple(
            SKIPPED if state.step <= i <= last else outcome
            for i, outcome in enumerate(state.outcomes))), last + 1, t)
    return state._replace(waits=state.outcome == RUNNING)


def _marked(state: State, outcome: int) -> State:
    """Returns the state with the current step's outcome."""
    i = state.step
    return state._replace(outcomes=(*state.outcomes[:i], outcome, *state.outcomes[i + 1:]))


def _entered(mission: Mission, state: State, i: int, t: float) -> State:
    """Returns the state at the beginning of a step, from the one at the end of another."""
    if i == len(mission.steps):
        return _over(state._replace(step=i))
    if i < state.step:  # The spot once more.
        outcomes = tuple(RUNNING if j >= i else outcome
                         for j, outcome in enumerate(state.outcomes))
        state = state._replace(outcomes=outcomes)
    step, before = mission.steps[i], mission.steps[min(state.step, i)]
    place, deepest, tries = state.place + before.along, state.deepest, state.tries
    if isinstance(step, Approach):
        place, tries = step.at, 0 if i > state.step else tries
    elif isinstance(step, Retreat):
        place, deepest = state.tip[1:], min(deepest, float(state.tip[0]) - step.distance)
    return state._replace(step=i, since=t, place=place, deepest=deepest, searching=False,
                          in_band=np.nan, touch=t, after=i + 1, tries=tries, waits=False)


def _over(state: State) -> State:
    """Returns the state at the end, with the outcome of the mission; other steps are skipped."""
    outcomes = tuple(SKIPPED if outcome == RUNNING else outcome for outcome in state.outcomes)
    outcome = (DONE if all(each == DONE for each in outcomes)
               else RETREATED if state.home else SKIPPED)
    return state._replace(outcome=outcome, outcomes=outcomes, waits=False)
