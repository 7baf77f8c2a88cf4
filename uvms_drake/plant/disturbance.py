"""Disturbances d(t) with ‖d(t)‖₂ ≤ d̃ at all times, by construction.

d is the paper's disturbance of the dynamics (eq:dynamics), a generalised acceleration
[m/s², rad/s²]; the laws do not depend on what the components mean.
"""

from dataclasses import dataclass, field

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
)

from uvms_drake.common.errors import require, vector


@dataclass
class ConstantDisturbance:
    """d = d̃ e with the unit vector e along `direction`."""

    bound: float = 0.0
    """d̃ [m/s², rad/s²]."""
    direction: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Vector of any length; empty means the same in all components."""


@dataclass
class SinusoidalDisturbance:
    """d = d̃ e sin(ωt + phase) with the unit vector e along `direction`; the paper's kind."""

    bound: float = 0.0
    """d̃ [m/s², rad/s²]."""
    direction: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Vector of any length; empty means the same in all components."""
    frequency: float = 1.0
    """Angular frequency ω [rad/s]."""
    phase: float = 0.0
    """Argument of the sine at t = 0 [rad]."""


@dataclass
class RandomDisturbance:
    """Uniformly distributed points of the ball ‖d‖₂ ≤ d̃, smoothly interpolated in time."""

    bound: float = 0.0
    """d̃ [m/s², rad/s²]."""
    bandwidth: float = 0.5
    """Half the rate of the points [Hz]; nearly all power is below it."""


DisturbanceConfig = ConstantDisturbance | SinusoidalDisturbance | RandomDisturbance

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


class BoundedDisturbance(LeafSystem):
    """A disturbance with ‖d(t)‖₂ ≤ d̃, of one of three kinds.

    `RandomDisturbance` takes a point of the ball every 1/(2 bandwidth) and goes from one to the
    next by a convex combination, which stays in the ball; the weight is a smooth step, so that d(t)
    is continuously differentiable.

    .. pydrake_system::

        name: BoundedDisturbance
        output_ports:
        - disturbance

    - `disturbance` (size) [m/s², rad/s²]: d; to `Hydrodynamics.acceleration_disturbance`, through
      `ToDrakeOrder` if it is in the paper's order.

    The constant and the sinusoid do not have any state. The random kind has discrete state: the
    index i of the interval of time (1) and the two points at its ends (2 size). A point is a
    function of seed and index, and nothing is drawn in an output calculation, so that a cloned
    Context continues identically and the integrator's step size does not matter.

    Args:
        size: Number of components.
        config: `ConstantDisturbance`, `SinusoidalDisturbance` or `RandomDisturbance`.
        seed: Seed of the random kind, zero or positive.
    """

    def __init__(self, size: int, config: DisturbanceConfig, seed: int = 0):
        super().__init__()
        require(0.0 <= config.bound < np.inf, "bound", config.bound, "zero or positive")
        self._size = size
        self._bound = config.bound
        match config:
            case ConstantDisturbance():
                self._declare_constant(config)
            case SinusoidalDisturbance():
                self._declare_sinusoid(config)
            case RandomDisturbance():
                self._declare_random(config, seed)

    @staticmethod
    def AddToBuilder(
        builder: DiagramBuilder,
        size: int,
        config: DisturbanceConfig,
        seed: int = 0,
        name: str = "disturbance",
    ) -> "BoundedDisturbance":
        """Adds the system to `builder`; it has no inputs."""
        system = BoundedDisturbance(size, config, seed)
        builder.AddNamedSystem(name, system)
        return system

    def _declare_constant(self, config: ConstantDisturbance) -> None:
        value = self._bound * unit_vector(config.direction, self._size)
        self.DeclareVectorOutputPort(
            "disturbance", self._size, lambda context, output: output.SetFromVector(value),
            {self.nothing_ticket()})

    def _declare_sinusoid(self, config: SinusoidalDisturbance) -> None:
        for key in ("frequency", "phase"):
            value = getattr(config, key)
            require(bool(np.isfinite(value)), key, value, "finite")
        amplitude = self._bound * unit_vector(config.direction, self._size)
        frequency, phase = config.frequency, config.phase

        def calc(context: Context, output: BasicVector) -> None:
            output.SetFromVector(amplitude * np.sin(frequency * context.get_time() + phase))

        self.DeclareVectorOutputPort("disturbance", self._size, calc, {self.time_ticket()})

    def _declare_random(self, config: RandomDisturbance, seed: int) -> None:
        require(0.0 < config.bandwidth < np.inf, "bandwidth", config.bandwidth, "positive")
        require(seed >= 0, "seed", seed, "zero or positive")
        self._seed = seed
        self._rate = 2.0 * config.bandwidth
        self.DeclareDiscreteState(self._interval(0))
        self.DeclareInitializationDiscreteUpdateEvent(self._update)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / self._rate, 0.0, self._update)
        self.DeclareVectorOutputPort(
            "disturbance", self._size, self._calc_random, {self.time_ticket(), self.xd_ticket()})

    def _interval(self, index: int) -> np.ndarray:
        """Returns the discrete state (i, dᵢ, dᵢ₊₁)."""
        ends = [self._bound * ball_sample(self._size, self._seed, i) for i in (index, index + 1)]
        return np.concatenate([[index], *ends])

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        # The index follows from the time, so that a simulation may start at any time; at an
        # event, 2 bandwidth t is a whole number but for rounding.
        index = max(int(np.floor(self._rate * context.get_time() + 1e-6)), 0)
        discrete_state.set_value(self._interval(index))

    def _calc_random(self, context: Context, output: BasicVector) -> None:
        state = context.get_discrete_state_vector().value()
        start, end = state[1: 1 + self._size], state[1 + self._size:]
        weight = smooth_step(self._rate * context.get_time() - state[0])
        output.SetFromVector((1.0 - weight) * start + weight * end)
