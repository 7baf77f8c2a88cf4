"""The force across n as a law with a clock should take it: slowly.

A law cancels the force that it measures, and with a computer it does so a time τ late. Let friction
hold a tip that moves across n at v with cv, c = μF/v₀ below its creep v₀, and let m be the tip's
inertia there, (𝔱ᵀJ M⁻¹Jᵀ𝔱)⁻¹ along 𝔱. With u the acceleration that the law means,

    m v̇ = mu − c v(t) + c v(t − τ) ≈ mu − cτ v̇,    v̇ ≈ m/(m + cτ) u:

the tip is heavier by cτ than the law believes. For an arm on a vehicle of 10 kg that is more than
m: 1.9 kg beside 1.5 for 8 N, μ = 0.2, v₀ = 25 mm/s and τ = 30 ms. Such a tip goes half along with
a vehicle that turns, friction rubs, and thrusters cancel that later still: swings that do not end.

Friction that is not cancelled damps. So the law follows the force across n with a time constant T,

    T 𝔣˙ = P_t 𝔉 − 𝔣,    𝔉_law = n n·𝔉 + 𝔣,                                                  (S)

which takes of friction what lasts, on a slide or on a wall off n, and leaves what rubs. Along n
nothing is late by it: there a reading that is τ late makes no inertia of the wall's stiffness κ,
but damping: −κx(t) + κx(t − τ) ≈ −κτ v + ½κτ² v̇, and ½κτ² is 0.2 kg at 500 N/m.

A wall that is left takes its friction with it at once, 𝔣 does not. So 𝔣 counts up to `LARGEST_RATIO` of what
is felt along n: without a force there is none across it.

No proof covers (S): what it leaves out is not in the error of a reading that is declared.
"""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    DiscreteValues,
    LeafSystem,
    OutputPort,
)

from uvms_drake.common.errors import require, vector
from uvms_drake.common.wiring import added

LARGEST_RATIO = 1.5
"""Largest part that friction and a wall off n may have of the force along n: more is of a wall that
was left, or of a force that is lost."""


def followed(slow: np.ndarray, force: np.ndarray, direction: np.ndarray, ratio: float
             ) -> np.ndarray:
    """Returns 𝔣 (3,) a period later [N], exact for a force that is constant meanwhile.

    Args:
        slow: 𝔣 now (3,) [N].
        force: 𝔉 now (3,) [N].
        direction: n (3,).
        ratio: The period over T.
    """
    across = force - (direction @ force) * direction
    return across + np.exp(-ratio) * (slow - across)


class TangentialFilter(LeafSystem):
    """Passes a force on, what of it is across n behind a lag.

    .. pydrake_system::

        name: TangentialFilter
        input_ports:
        - measured
        output_ports:
        - force

    - `measured`: 𝔉 in Σ_I (6) [N, N m]; 𝔣 stays as it is while that is not finite.
    - `force`: 𝔉_law of (S), 𝔣 cut to `LARGEST_RATIO` of what is along n, its torque as it is measured (6)
      [N, N m].

    The discrete state is 𝔣 (3), updated once in a period; zero at the start.

    Args:
        direction: n (3,).
        lag: T [s].
        period: Time between two readings [s].
    """

    def __init__(self, direction: np.ndarray, lag: float, period: float):
        super().__init__()
        for key, value in (("lag", lag), ("period", period)):
            require(0.0 < value < np.inf, key, value, "positive")
        self._direction, self._ratio = vector("direction", direction, 3), period / lag
        self._port = self.DeclareVectorInputPort("measured", 6)
        self.DeclareDiscreteState(np.zeros(3))
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        self.DeclareVectorOutputPort(
            "force", 6, self._calc, {self.xd_ticket(), self.all_input_ports_ticket()})

    def _update(self, context: Context, state: DiscreteValues) -> None:
        force = self._port.Eval(context)[:3]
        if np.isfinite(force).all():
            state.set_value(followed(context.get_discrete_state_vector().value(), force,
                                     self._direction, self._ratio))

    def _calc(self, context: Context, output: BasicVector) -> None:
        force = self._port.Eval(context).copy()
        along, slow = self._direction @ force[:3], context.get_discrete_state_vector().value()
        size, most = np.linalg.norm(slow), LARGEST_RATIO * np.maximum(along, 0.0)
        force[:3] = along * self._direction + (slow if size <= most else slow * (most / size))
        output.SetFromVector(force)

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, direction: np.ndarray, lag: float, period: float, *,
                     measured: OutputPort, name: str = "tangential_filter") -> "TangentialFilter":
        """Adds the system behind the force that `measured` gives."""
        return added(builder, name, TangentialFilter(direction, lag, period), measured=measured)
