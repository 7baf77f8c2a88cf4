"""Law `tip first`: the arm holds the tip, the vehicle keeps station, each with its own gains.

Its outputs are y = (η, s): the vehicle's pose η, and n rows s of (χ, q), the tip's task, see
`tip_rows`. With e = y − ȳ, ẏ = J_y ζ, diagonal gains K and Σ, and δ̂ the estimate of an observer,

    v = ÿ̄ − (K + Σ)(ẏ − ẏ̄) − K Σ e − δ̂,    J_y ζ̇_des = v − J̇_y ζ,    τ = M ζ̇_des + b + Jᵀ𝔉_s.    (L)

If the actuators give τ, each row is a loop of its own, ë + (k + σ) ė + kσ e = δ − δ̂ with δ = J_y d.
If the thrusters give τ_v, the joints' torques are those of

    M ζ̇_now + b + Jᵀ𝔉_s = (τ_v, τ_q),    J_s ζ̇_now = v_s − J̇_s ζ,    in (ζ̇_now, τ_q),           (A)

with which the tip's rows obey the same equation whatever τ_v is. (A) is solvable where the
generalised Jacobian is regular, (L) where J_sq is; at a singular posture the law refuses. An axis
without thrusters, such as a roll, is commanded no torque and is not fed back: in (L) its row of the
dynamics, with the present torque, takes the place of its row of η. Proof:
control/laws/theory.md#law-tip-first.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated

import numpy as np

from uvms_drake.common.constraints import NotNegative, OneOf, Period, Positive
from uvms_drake.common.errors import RunFailed
from uvms_drake.control.laws.law import AncillaryLaw, Command, Observed, Pair
from uvms_drake.control.laws.outputs import POSE, outputs_of, tip_rows
from uvms_drake.model.uvms_model import UvmsModel

MAY_BE_UNDRIVEN = ("roll", "pitch")
"""Axes of the vehicle that weight and buoyancy stabilise without a thruster."""
LARGEST = 1e6
"""Acceleration [m/s², rad/s²] that occurs at singular postures only."""


@dataclass
class BlockGains:
    """Gains of a block of rows."""

    k: Annotated[float, Positive]
    """Gain of the velocity error [1/s]."""
    sigma: Annotated[float, Positive]
    """σ, gain of the error [1/s]."""
    observer: Annotated[float, NotNegative] = 0.0
    """λ of the observer of the disturbance [1/s]; zero for none."""


@dataclass
class TipFirst(AncillaryLaw):
    """Law `tip first`: its rows and its gains."""

    vehicle: BlockGains = field(default_factory=lambda: BlockGains(1.5, 0.4))
    """Gains of the vehicle's pose, within the bandwidth of the thrusters."""
    tip: BlockGains = field(default_factory=lambda: BlockGains(20.0, 10.0))
    """Gains of the tip's task."""
    rows: list[str] = field(default_factory=list)
    """Rows of the tip's task, one a joint: of x, y, z, roll, pitch, yaw of the end-effector and
    q1, q2, ...; none for the position first and then the rows that are best conditioned."""
    undriven: list[Annotated[str, OneOf(*MAY_BE_UNDRIVEN)]] = field(default_factory=list)
    """Axes of the vehicle that no thruster drives, of roll and pitch: not fed back."""
    observer_period: Annotated[float, Period] = 0.02
    """Time between two estimates of the observer, if there is one [s]."""

    takes_force = takes_wrench = True

    @property
    def name(self) -> str:  # noqa: D102  see AncillaryLaw
        return "tip-first"

    @property
    def undriven_rows(self) -> np.ndarray:
        """Indices in η of the axes that no thruster drives."""
        return np.array(sorted({POSE.index(name) for name in self.undriven}), dtype=int)

    def gains(self, key: str, num_joints: int) -> np.ndarray:
        """Returns a gain of `BlockGains` for each row of y (6+n,)."""
        return _of_rows(getattr(self.vehicle, key), getattr(self.tip, key), num_joints)

    def observed(self, model: UvmsModel) -> Observed | None:  # noqa: D102  see AncillaryLaw
        rates = self.gains("observer", model.num_joints)
        if not rates.any():
            return None
        rows = tip_rows(model, tuple(self.rows))
        return Observed(rates, self.observer_period, lambda now: outputs_of(now, rows))

    def command(self, model: UvmsModel, now: Pair, nominal_acceleration: Callable[[], np.ndarray],
                nominal_input: Callable[[], np.ndarray]) -> Command:
        """Returns τ of (L), τ_q of (A) for a given wrench, and the preview; it reads ζ̄̇ only."""
        n, out = model.num_joints, outputs_of(now, tip_rows(model, tuple(self.rows)))
        k, sigma = self.gains("k", n), self.gains("sigma", n)
        v = out.J[1] @ nominal_acceleration() + out.bias[1]  # ÿ̄
        v += -(k + sigma) * (out.rate[0] - out.rate[1]) - k * sigma * out.error
        if now.estimate is not None:
            v -= now.estimate
        measured, zeta = now.kinematics.at(0), now.zeta[0]
        M, b = model.mass_matrix(measured), model.inverse_dynamics(
            measured, zeta, np.zeros_like(zeta), now.contact)
        given = np.zeros(6) if now.wrench is None else now.wrench

        def torques(axes: np.ndarray) -> np.ndarray:
            """Returns τ (6+n,) with the given wrench, not the law's, on these axes."""
            A, right = out.J[0].copy(), v - out.bias[0]
            A[axes], right[axes] = M[axes], given[axes] - b[axes]
            return M @ _solve(A, right, now.y[0, 6:]) + b

        # Undriven axes are commanded no torque; the joints compensate the thrusters' wrench.
        undriven = self.undriven_rows
        tau = torques(undriven)
        if now.wrench is not None:
            tau[6:] = torques(np.arange(6))[6:]
        if now.preview is not None:
            tau += now.preview
        tau[undriven] = 0.0
        return Command(np.linalg.solve(M, tau), tau, M)


@lru_cache(maxsize=64)
def _of_rows(vehicle: float, tip: float, num_joints: int) -> np.ndarray:
    """Returns a gain of the vehicle's rows and then of the tip's (6+n,), read-only."""
    gains = np.repeat([vehicle, tip], [6, num_joints])
    gains.setflags(write=False)
    return gains


def _solve(A: np.ndarray, right: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Returns A⁻¹ right, or raises `RunFailed` for joint angles q (n,) that are singular."""
    try:
        zeta_dot: np.ndarray = np.linalg.solve(A, right)
    except np.linalg.LinAlgError:
        zeta_dot = np.array([np.inf])
    if not (np.abs(zeta_dot) < LARGEST).all():
        raise RunFailed("the arm came to a singular posture of its rows (ancillary.rows), with the "
                        f"joints at {np.array2string(q, precision=3)}")
    return zeta_dot
