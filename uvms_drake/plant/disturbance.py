"""Disturbances d(t) with ‖Ŵ⁻¹d(t)‖₂ ≤ d̃ at all times, by construction.

d is the paper's disturbance of the dynamics (eq:dynamics), a generalised acceleration
[m/s², rad/s²]. Ŵ is diagonal and its largest entry 1, so that ‖d‖₂ ≤ d̃ too; in the paper Ŵ = I, for
which metres and radians, a heavy hull and light joints are one. Otherwise d is in an ellipsoid
whose semi-axes Wᵢ = Ŵᵢd̃ are the bounds of each component alone. Functions of time are here,
state-dependent disturbances in `adversary`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from pydrake.systems import framework

from uvms_drake.common.constraints import Above, Finite, NotNegative, Positive, Rate
from uvms_drake.common.errors import require, vector
from uvms_drake.common.schema import check_values
from uvms_drake.common.wiring import WiredSystem, output_of
from uvms_drake.model.signals.fault import Fault
from uvms_drake.model.uvms_model import UvmsModel

_NEVER_ABOVE_ONE = 1.0 - 8.0 * np.finfo(float).eps  # So that rounding cannot exceed the bound.


def unit_vector(direction: np.ndarray, size: int) -> np.ndarray:
    """Returns e (size,) along `direction` with ‖e‖₂ ≤ 1; an empty direction means all ones."""
    values = np.ones(size) if np.size(direction) == 0 else vector("direction", direction, size)
    largest = float(np.max(np.abs(values), initial=0.0))
    require(largest > 0.0, "direction", values, "a vector that is not zero")
    values = values / largest
    return _NEVER_ABOVE_ONE * values / np.linalg.norm(values)


def ball_sample(size: int, seed: int, index: int) -> np.ndarray:
    """Returns point number `index` of a sequence of uniform random points of the unit ball.

    It is a pure function of its arguments: the direction of a Gaussian vector, and the `size`-th
    root of a uniform number as the radius, from a generator seeded with (seed, index).
    """
    random = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, index])))
    return random.random() ** (1.0 / size) * unit_vector(random.standard_normal(size), size)


def smooth_step(x: float) -> float:
    """Returns 3x² − 2x³ with x clipped to [0, 1]; its derivative is zero at both ends."""
    x = min(max(x, 0.0), 1.0)
    return x * x * (3.0 - 2.0 * x)


@dataclass
class Disturbance(ABC):
    """A disturbance of the robot; the fields of the dataclass are its settings.

    A certificate assumes the bound; the `TubeMonitor` reports its violations.
    """

    bound: Annotated[float, NotNegative] = 0.0
    """Bound d̃ of ‖d‖₂ [m/s², rad/s²], or in the units of the motion's disturbance."""
    weights: Annotated[np.ndarray, Positive] = field(
        default_factory=lambda: np.zeros(0), kw_only=True)
    """Bound of each component of d over `bound`, 6+n positive numbers: d is in the ellipsoid with
    the semi-axes `bound` times `weights`. Empty means ones, a ball."""

    @property
    def label(self) -> str:
        """Name of the kind, in tables."""
        return type(self).__name__

    @property
    def d_bound(self) -> float:
        """Bound d̃ of ‖d‖₂: the largest semi-axis."""
        return self.bound * float(np.max(self.weights)) if np.size(self.weights) else self.bound

    def relative_weights(self, size: int) -> np.ndarray:
        """Returns the diagonal of Ŵ (size,), the largest of it 1.

        Raises:
            InvalidParameter: Bound or weights are none.
        """
        check_values(self)
        if np.size(self.weights) == 0:
            return np.ones(size)
        weights = vector("weights", self.weights, size)
        return weights / np.max(weights)

    def axes(self, size: int) -> np.ndarray:
        """Returns the semi-axes Wᵢ of the ellipsoid (size,) [m/s², rad/s²]."""
        return self.d_bound * self.relative_weights(size)

    def norm(self, d: np.ndarray) -> np.ndarray:
        """Returns ‖Ŵ⁻¹d‖₂ (T,) of disturbances (T, size), which is to be at most d̃."""
        return np.linalg.norm(d / self.relative_weights(d.shape[1]), axis=1)

    @abstractmethod
    def add_to(self, builder: framework.DiagramBuilder, model: UvmsModel, seed: int,
               signals: Mapping[str, framework.OutputPort]) -> framework.OutputPort:
        """Adds the source of d and returns its port (6+n) [m/s², rad/s²], in the paper's order.

        Args:
            builder: Builder to add to.
            model: The robot's geometry.
            seed: Seed of random numbers, zero or positive.
            signals: Signals of the closed loop, with `e_y` and `r` (6+n) of its `TubeMonitor`.
        """


class OpenLoopDisturbance(Disturbance):
    """A disturbance that is a function of time and seed alone."""

    @abstractmethod
    def system(self, size: int, seed: int = 0) -> framework.LeafSystem:
        """Returns a system without inputs and with one output port, `disturbance` (size)."""

    def add_to(self, builder: framework.DiagramBuilder, model: UvmsModel, seed: int,
               signals: Mapping[str, framework.OutputPort]) -> framework.OutputPort:
        """Adds the source of d; see `Disturbance`."""
        return builder.AddNamedSystem(
            "disturbance", self.system(model.size, seed)).get_output_port()


@dataclass
class ConstantDisturbance(OpenLoopDisturbance):
    """d = d̃Ŵe with the unit vector e along `direction`."""

    label = "constant"

    direction: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Vector of any length; empty means the same in all components of e, that is, the same part of
    the bound of every component of d."""

    def system(self, size: int, seed: int = 0) -> framework.LeafSystem:
        """Returns the source; see `OpenLoopDisturbance`."""
        return DirectedDisturbance(
            self.axes(size) * unit_vector(self.direction, size), lambda time: 1.0)


@dataclass
class SinusoidalDisturbance(OpenLoopDisturbance):
    """d = d̃Ŵe sin(ωt + phase) with the unit vector e along `direction`; the paper's kind."""

    label = "sinusoid"

    direction: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Vector of any length; empty means the same in all components of e."""
    frequency: Annotated[float, NotNegative] = 1.0
    """Angular frequency ω [rad/s]."""
    phase: Annotated[float, Finite] = 0.0
    """Argument of the sine at t = 0 [rad]."""

    def system(self, size: int, seed: int = 0) -> framework.LeafSystem:
        """Returns the source; see `OpenLoopDisturbance`."""
        frequency, phase = self.frequency, self.phase
        return DirectedDisturbance(self.axes(size) * unit_vector(self.direction, size),
                                   lambda time: np.sin(frequency * time + phase))


@dataclass
class RandomDisturbance(OpenLoopDisturbance):
    """Uniformly distributed points of the ellipsoid, smoothly interpolated in time."""

    label = "random"

    bandwidth: Annotated[float, Rate] = 0.5
    """Half the rate of the points [Hz]; nearly all power is below it."""

    def system(self, size: int, seed: int = 0) -> framework.LeafSystem:
        """Returns the source; see `OpenLoopDisturbance`."""
        return RandomPoints(self.axes(size), self.bandwidth, seed)


class DirectedDisturbance(WiredSystem):
    """A disturbance d(t) = g(t) a along one direction.

    .. pydrake_system::

        name: DirectedDisturbance
        output_ports:
        - disturbance

    - `disturbance` (size) [m/s², rad/s²]: d, to the input port `disturbance` of a plant.

    It has no state.

    Args:
        amplitude: a (size,).
        factor: g of the time [s], |g| ≤ 1.
    """

    def __init__(self, amplitude: np.ndarray, factor: Callable[[float], float]):
        super().__init__()
        output_of(self, "disturbance", len(amplitude),
                  lambda c: amplitude * factor(c.get_time()), {self.time_ticket()})


class RandomPoints(WiredSystem):
    """A disturbance that takes a random point of an ellipsoid every 1/(2 bandwidth).

    It goes from one to the next by a convex combination, which stays inside; the weight is a
    smooth step, so that d(t) is continuously differentiable.

    .. pydrake_system::

        name: RandomPoints
        output_ports:
        - disturbance

    - `disturbance` (size) [m/s², rad/s²]: d, to the input port `disturbance` of a plant.

    The discrete state is the index i of the interval of time (1) and the two points at its ends
    (2 size). A point is a function of seed and index, and nothing is drawn in an output
    calculation, so that a cloned Context continues identically and the integrator's step size does
    not matter.

    Args:
        axes: Semi-axes of the ellipsoid (size,).
        bandwidth: Half the rate of the points [Hz].
        seed: Seed of the points, zero or positive.
    """

    def __init__(self, axes: np.ndarray, bandwidth: float, seed: int):
        super().__init__()
        self._size, self._axes, self._seed = len(axes), axes, seed
        self._rate = 2.0 * bandwidth
        self.DeclareDiscreteState(self._interval(0))
        self.DeclareInitializationDiscreteUpdateEvent(self._update)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / self._rate, 0.0, self._update)
        self.DeclareVectorOutputPort(
            "disturbance", len(axes), self._calc, {self.time_ticket(), self.xd_ticket()})

    def _interval(self, index: int) -> np.ndarray:
        """Returns the discrete state (i, dᵢ, dᵢ₊₁)."""
        ends = [self._axes * ball_sample(self._size, self._seed, i) for i in (index, index + 1)]
        return np.concatenate([[index], *ends])

    def _update(self, context: framework.Context, discrete_state: framework.DiscreteValues) -> None:
        # The index follows from the time, so that a simulation may start at any time; at an
        # event, 2 bandwidth t is a whole number but for rounding.
        index = max(int(np.floor(self._rate * context.get_time() + 1e-6)), 0)
        discrete_state.set_value(self._interval(index))

    def _calc(self, context: framework.Context, output: framework.BasicVector) -> None:
        state = context.get_discrete_state_vector().value()
        start, end = state[1: 1 + self._size], state[1 + self._size:]
        weight = smooth_step(self._rate * context.get_time() - state[0])
        output.SetFromVector((1.0 - weight) * start + weight * end)


@dataclass
class ExcessDisturbance(Fault):
    """The simulated disturbance exceeds its bound d̃, on which everything else relies."""

    place = "disturbance"

    factor: Annotated[float, Above(1)] = 2.0
    """Factor of the disturbance beyond its declared bound."""
