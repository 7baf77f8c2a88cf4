"""Identification of parameters: windows, estimate, refusals, held-out prediction, residual."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.common.progress import Progress, part_of, silent
from uvms_drake.identification.checks import LATEST, clock_shift, complaint
from uvms_drake.identification.estimate import (
    NOISE,
    Estimate,
    estimated,
    hydrostatics,
    own_of,
    products_of,
    quadratic_of,
    student,
)
from uvms_drake.identification.log import GRID, STATE, Log, gravity_in_body
from uvms_drake.identification.output_error import OWN, STEP, simulated
from uvms_drake.identification.parameters import VOLUME, Parameter, error_of, parameters_of
from uvms_drake.identification.windows import INSTANTS, WINDOW, Windows, windows_of
from uvms_drake.model.frames.spatial import times
from uvms_drake.model.robot import Robot
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.model_error import ModelError

LEAST_WINDOWS = 12
"""Smallest number of windows."""
LEAST_FREEDOM = 2.0
"""Degrees of freedom of an interval below which a parameter is known by one log or window alone."""
LEAST_LOGS = 8
"""Number of logs from which on their errors are taken as independent in place of those of windows:
a constant moment of a run is in all of its windows."""
UNINFORMED = 0.5
"""Ratio of a parameter's standard deviation to that before any log from which on it is unknown."""
LARGEST_ERROR = 0.5
"""Largest half-width of an interval over the value; over the scale of a place or volume."""
NUMERICAL = 0.003
"""Numerical error of an estimate over its value, by grid and step of the prediction; over the scale
of a place or volume. In tutorial 8, with little noise, the vehicle's are off by 0.0022 at most."""
OUTLIER = 15.0
"""Ratio of a window's cost to the median from which on it is left out."""
DRIVEN = 0.1
"""Smallest range of a joint or of the wrench that moves the vehicle [rad, N]."""


class Result(NamedTuple):
    """A parameter and its interval."""

    parameter: Parameter
    """The parameter."""
    theta: float
    """Error θ of the file; zero if it was not identified."""
    half: float
    """Half-width of the interval of θ; inf if it was not identified."""
    why: str
    """Reason that it was not identified; empty if it was."""

    @property
    def value(self) -> float:
        """Its value, in its unit."""
        return self.parameter.value_at(self.theta)

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the interval, in its unit."""
        return (self.parameter.value_at(self.theta - self.half),
                self.parameter.value_at(self.theta + self.half))


@dataclass(frozen=True)
class Identification:
    """The parameters of a robot by its logs."""

    robot: Robot
    """The robot by its file."""
    confidence: float
    """Confidence of each interval."""
    results: tuple[Result, ...]
    """All parameters that the file has."""
    windows: Windows
    """The windows that were used."""
    estimate: Estimate
    """The last estimate."""
    fitted: tuple[Parameter, ...]
    """Its parameters."""
    validation: np.ndarray
    """Error of a prediction of x from its measured value at the beginning of windows, with
    parameters one step from the estimate to those of the other half (W, K, 9); nan where nothing
    was measured."""
    residual: np.ndarray
    """d = ν̇ − f (W, K, 6) [m/s², rad/s²]; nan where ν̇ was not measured."""
    refused: tuple[str, ...]
    """Logs and windows that were not used, a line each."""

    @property
    def identified(self) -> tuple[Result, ...]:
        """The parameters that were identified."""
        return tuple(each for each in self.results if not each.why)

    @property
    def error(self) -> ModelError:
        """The errors of the file that were identified."""
        return error_of({each.parameter.name: each.theta for each in self.identified})

    @property
    def unknowns(self) -> ModelError:
        """The half-widths of the intervals as errors of the identified robot."""
        return error_of({each.parameter.name: each.half / (
            1.0 + each.theta if each.parameter.relative else 1.0) for each in self.identified})

    @property
    def used(self) -> list[Log]:
        """The logs that have windows."""
        return [self.windows.logs[i] for i in np.unique(self.windows.log_of)]

    @property
    def excitation(self) -> dict[str, float]:
        """The largest ‖ν₁‖, ‖ν₂‖, ‖ν̇₁‖, ‖ν̇₂‖ and ‖q̇‖ of the logs that were used."""
        def largest(rows: list[np.ndarray]) -> float:
            sizes = np.linalg.norm(np.concatenate(rows), axis=1)
            return float(np.max(sizes[np.isfinite(sizes)], initial=0.0))

        logs = self.used
        return {"nu1": largest([log.state[log.known, 3:6] for log in logs]),
                "nu2": largest([log.state[log.known, 6:] for log in logs]),
                "nu1_dot": largest([log.rate[log.known, 3:6] for log in logs]),
                "nu2_dot": largest([log.rate[log.known, 6:] for log in logs]),
                "qdot": largest([log.q_dot[log.known] for log in logs])}


def identify(model: str | Robot, logs: Sequence[Log], confidence: float = 0.95,
             progress: Progress = silent) -> Identification:
    """Returns the hydrodynamic parameters of a robot by its logs, with intervals.

    Args:
        model: Name or folder of a robot.
        logs: The logs, as of `readers.read_log`.
        confidence: Of each interval.
        progress: Receives the stages.

    Raises:
        InvalidParameter: No log can be used, they have too few windows, or identify nothing.
        RunFailed: The estimate does not converge.
    """
    require(0.5 <= confidence < 1.0, "--confidence", confidence, "at least 0.5, and less than 1")
    robot = Robot.load(model) if isinstance(model, str) else model
    base, parameters = parameters_of(robot)
    first_with = dict[bytes, str]()
    for log in logs:
        samples = log.q.tobytes() + log.state.tobytes()
        require(samples not in first_with, "LOG", log.name,
                f"logs that differ: it has the samples of {first_with.get(samples)}")
        first_with[samples] = log.name
    complaints = [complaint(log) for log in logs]
    refused = [f"{log.name}: {why}" for log, why in zip(logs, complaints, strict=True) if why]
    sound = [log for log, why in zip(logs, complaints, strict=True) if not why]
    require(bool(sound), "LOG", len(logs), "; ".join(["logs without a fault", *refused]))
    windows = _enough(windows_of(sound, UvmsModel(robot.uvms), base, parameters), refused)
    if not np.any(windows.resting):
        refused.append("no rest: the hydrostatics are from motion alone")
    theta = hydrostatics(windows, parameters)

    # Logs whose clock is off.
    shifts = _clocks(windows, theta)
    refused += [f"{log.name}: clock: its attitude is {shift:.2g} s later than arm and wrench ask "
                f"for, and must be within {LATEST:g} s"
                for log, shift in zip(sound, shifts, strict=True) if abs(shift) > LATEST]
    windows = with_velocities(
        _enough(windows.of(np.abs(shifts[windows.log_of]) <= LATEST), refused), theta)

    # All parameters that the windows say something about; then those that prove to be known.
    why, kept = dict[str, str](), np.arange(len(parameters))
    about = own_of(windows, NOISE)
    first = quadratic_of(products_of(windows, theta, about.mean, part_of(progress, 0.0, 0.1)),
                         about.mean, about, NOISE)
    outlier = first.cost > OUTLIER * np.median(first.cost)
    for i in np.unique(windows.log_of[outlier]):
        refused.append(f"{windows.logs[i].name}: {np.sum(outlier & (windows.log_of == i))} windows "
                       "are outliers: the model does not reproduce their motion")
    windows, own = windows.of(~outlier), None
    require(len(windows.start) >= LEAST_WINDOWS, "LOG", len(windows.start),
            f"at least {LEAST_WINDOWS} windows that are no outliers")
    informed = _informed(first.H[~outlier], parameters)
    if not np.any(np.isfinite(windows.state[:, 2:6])):  # The weight in water moves it up and down.
        informed &= np.array([each.name != VOLUME for each in parameters])
    done = 0.1
    while True:  # Without those that are not known, until all that is left is.
        for i in kept[~informed]:
            why[parameters[i].name] = why.get(parameters[i].name, "the logs do not excite it")
        kept, begun, done = kept[informed], done, 0.5 * (done + 0.9)
        used, some = [parameters[i] for i in kept], windows._replace(
            dynamics=windows.dynamics.only(kept))
        require(bool(used), "LOG", len(sound), "logs that identify a parameter")
        estimate = estimated(some, used, theta[kept], part_of(progress, begun, done), own)
        theta[kept], own = estimate.theta, estimate.own
        sigma, freedom = estimate.deviations(_clusters(some))
        half = np.hypot(student(confidence, np.maximum(freedom, 1.0)) * sigma,
                        NUMERICAL * np.array([each.scale for each in used]))
        reasons = _unknown(estimate, used, half, freedom)
        why |= {each.name: reason for each, reason in zip(used, reasons, strict=True) if reason}
        informed = np.array([not reason for reason in reasons])
        if np.all(informed):
            break
    why |= _disagreements(estimate, some, used, confidence)
    halves = dict(zip([each.name for each in used], half, strict=True))
    results = tuple(Result(each, float(theta[i]), float(halves[each.name]), "")
                    if each.name not in why else Result(each, 0.0, np.inf, why[each.name])
                    for i, each in enumerate(parameters))
    progress("held-out prediction", 0.95)
    return Identification(robot, confidence, results, some, estimate, tuple(used),
                          _validation(some, estimate), _residual(some, estimate), tuple(refused))


def _enough(windows: Windows, refused: list[str]) -> Windows:
    """Returns windows, or raises if they are too few, with the reasons."""
    count = len(windows.start)
    if count < LEAST_WINDOWS:
        raise InvalidParameter("LOG", f"{count} windows", "; ".join(
            [f"logs with at least {LEAST_WINDOWS} windows of {WINDOW:g} s", *refused]))
    return windows


def _informed(H: np.ndarray, parameters: list[Parameter]) -> np.ndarray:
    """Returns whether the windows lessen the uncertainty of each parameter (P,)."""
    prior = np.array([each.scale for each in parameters]) ** -2.0
    spread = np.sqrt(np.diag(np.linalg.inv(np.sum(H, axis=0) + np.diag(prior))) * prior)
    out: np.ndarray = spread < UNINFORMED
    return out


def _clusters(windows: Windows) -> np.ndarray:
    """Returns the log of each window if there are enough, else its own number (W,)."""
    enough = len(np.unique(windows.log_of)) >= LEAST_LOGS
    return windows.log_of if enough else np.arange(len(windows.start))


def _half(windows: Windows) -> np.ndarray:
    """Returns whether a window is of the first half (W,): every other log, or half of one."""
    each = np.unique(windows.log_of, return_inverse=True)[1]
    count = len(each)
    out: np.ndarray = each % 2 == 0 if each[-1] else np.arange(count) < count // 2
    return out


def _unknown(estimate: Estimate, parameters: list[Parameter], half: np.ndarray,
             freedom: np.ndarray) -> list[str]:
    """Returns why each parameter is not known well enough; empty if it is."""
    shares, out = estimate.known_by_prior(), list[str]()
    for i, parameter in enumerate(parameters):
        size = 1.0 + estimate.theta[i] if parameter.relative and parameter.scale == 1.0 else (
            parameter.scale)
        out.append(
            "the logs do not excite it" if shares[i] > UNINFORMED else
            "one log or window alone excites it" if freedom[i] < LEAST_FREEDOM else
            f"known to {half[i] / size:.0%} only" if half[i] > LARGEST_ERROR * size else "")
    return out


def _disagreements(estimate: Estimate, windows: Windows, parameters: list[Parameter],
                   confidence: float) -> dict[str, str]:
    """Returns a line for each parameter of which the halves of the logs have different values.

    It is Welch's test, of all parameters at once. They stay in the fit, as excited as they are.
    """
    first, cluster = _half(windows), _clusters(windows)
    (one, s, v), (other, s_other, v_other) = (
        (estimate.of(which), *estimate.deviations(cluster, which)) for which in (first, ~first))
    both = s**2 + s_other**2
    degrees = both**2 / np.maximum(s**4 / np.maximum(v, 1.0)
                                   + s_other**4 / np.maximum(v_other, 1.0), 1e-300)
    t = student(1.0 - (1.0 - confidence) / len(parameters), np.maximum(degrees, 1.0))
    apart = np.abs(one - other) > t * np.sqrt(both)
    return {each.name: f"the halves of the logs disagree: {each.value_at(float(one[i])):.3g} and "
                       f"{each.value_at(float(other[i])):.3g} {each.unit}"
            for i, each in enumerate(parameters) if apart[i]}


def _clocks(windows: Windows, theta: np.ndarray) -> np.ndarray:
    """Returns the time by which the attitude of each log is late [s]; zero where it is unknown.

    Where neither arm nor wrench moves the vehicle, there is nothing that it could be late to.
    """
    out, known = np.zeros(len(windows.logs)), np.unique(windows.log_of)
    measured, predicted = windows.measured()[..., :2], _predicted(windows, theta)[..., :2]
    for i in known:
        log, its = windows.logs[i], windows.log_of == i
        if any(np.max(np.ptp(x[log.known], axis=0), initial=0.0) > DRIVEN
               for x in (log.q, log.wrench)):
            out[i] = clock_shift(measured[its].reshape(-1, 2), predicted[its].reshape(-1, 2),
                                 STEP * GRID) or 0.0
    return out


def _predicted(windows: Windows, theta: np.ndarray) -> np.ndarray:
    """Returns x (W, K, 9) from its measured value at the beginning of each window."""
    own = np.zeros((len(windows.start), OWN))
    own[:, :len(STATE)] = windows.first_state()
    return simulated(windows.dynamics.with_parameters(theta), windows.wrench, windows.start,
                     INSTANTS, own, sensitive=False).state


def with_velocities(windows: Windows, theta: np.ndarray) -> Windows:
    """Returns windows that begin with the predicted ν₁ of those before them; logs begin at rest.

    A vehicle that is not trimmed rises, which without a measured velocity no window shows.
    """
    place, velocity = windows.place_in_run(), windows.velocity.copy()
    for k in range(1, int(np.max(place, initial=0)) + 1):
        at = np.flatnonzero(place == k)
        before = windows._replace(velocity=velocity).of(at - 1)
        velocity[at] = _predicted(before, theta)[:, -1, 3:6]
    return windows._replace(velocity=velocity)


def _validation(windows: Windows, estimate: Estimate) -> np.ndarray:
    """Returns the errors (W, K, 9) of each half, predicted with `Estimate.of` the other."""
    first = _half(windows)
    out = np.empty((len(first), INSTANTS, len(STATE)))
    for which in (first, ~first):
        some = windows.of(which)
        out[which] = some.measured() - _predicted(some, estimate.of(~which))
    return out


def _residual(windows: Windows, estimate: Estimate) -> np.ndarray:
    """Returns d = ν̇ − f (W, K, 6), with the simulated ν where none was measured."""
    moved, d = windows.dynamics.with_parameters(estimate.theta), []
    x = simulated(moved, windows.wrench, windows.start, INSTANTS, estimate.own,
                  sensitive=False).state
    rate = np.concatenate([log.rate for log in windows.logs])
    for k in range(INSTANTS):
        at = windows.start + STEP * k
        measured, dynamics = windows.state[at], moved.at(at)
        state = np.where(np.isfinite(measured), measured, x[:, k])
        force = dynamics.force(state[:, None, 3:], gravity_in_body(state)[:, None])[:, 0]
        inverse = np.linalg.inv(dynamics.composite.inertia)
        d.append(rate[at, 3:] - times(inverse, windows.wrench[at] - force))
    return np.stack(d, axis=1)
