"""The law `tip first`: the arm holds the tip, the vehicle keeps station, each with its own gains.

Its outputs are y = (η, s): the vehicle's pose η, and n rows s of (χ, q), the tip's task, see
`tip_rows`. With e = y − ȳ, ẏ = J_y ζ, J_y = [J_η 0; J_sv J_sq], diagonal gains K and Σ, and δ̂ the
estimate of an observer, if there is one,

    v = ÿ̄ − (K + Σ)(ẏ − ẏ̄) − K Σ e − δ̂,    J_y ζ̇_des = v − J̇_y ζ,    τ = M ζ̇_des + b + Jᵀ𝔉_s.    (L)

(b: Coriolis forces, drag, weight and buoyancy; 𝔉_s: the measured contact force, or the model's.) If
the actuators give τ, the robot has ζ̇ = ζ̇_des + d, and each row is a loop of its own:

    ë + (k + σ) ė + kσ e = δ − δ̂,    δ = J_y d.                                               (R)

*The thrusters as they are.* They lag, have limits and dead time. Let τ_v be what they give the
vehicle now. The joints' torques are not those of (L) then, but those of

    M ζ̇_now + b + Jᵀ𝔉_s = (τ_v, τ_q),    J_s ζ̇_now = v_s − J̇_s ζ,    in (ζ̇_now, τ_q).           (A)

*The tip's rows obey (R) whatever the thrusters do.* The robot obeys M(ζ̇ − d) + b + Jᵀ𝔉 = (τ_v, τ_q)
with that very τ_v. The difference to (A) is M(ζ̇ − d − ζ̇_now) = Jᵀ(𝔉_s − 𝔉), so that ζ̇ = ζ̇_now + d'
with d' = d + M⁻¹Jᵀ(𝔉_s − 𝔉), and s̈ = J_s ζ̇ + J̇_s ζ = v_s + J_s d'. This is (R) with δ = J_s d'. ∎
What the thrusters give wrongly, τ_v + ε in truth, adds M⁻¹(ε, 0) to d, no more.

*When it has a solution.* (A) is [M_v; J_s] ζ̇_now = (τ_v − b_v, v_s − J̇_s ζ), M_v the vehicle's rows
of M, and then τ_q. det[M_v; J_s] = det M_vv det J_g with the generalised Jacobian
J_g = J_sq − J_sv M_vv⁻¹M_vq: how the tip moves by the joints of a robot whose vehicle floats free.
So (A) is solvable where J_g is regular, (L) where J_sq is. Near a singular posture the torques grow
as one over the smallest singular value and limits cut them; at one, the law refuses. A certificate
has to keep the robot away from there.

*An axis without thrusters*, such as the roll of a vehicle with five: the vehicle gets no torque
about it. In (L) its row of dynamics, with that torque, takes the place of its row of η, which is
not fed back; all other rows obey (R) as before.

The vehicle's rows obey (R) as far as τ_v is what (L) asks for. What a lag makes of them is in
`tube.loops.row_loop`. What is known in advance need not be late: where the command is known to
act ℓ later, the plan's forces of that time are asked for, τ + τ̄(t + ℓ) − τ̄(t), see
`control.feedback.feedforward_preview`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require, require_period, within
from uvms_drake.control.laws.law import AncillaryLaw, Command, Observed, Pair
from uvms_drake.control.laws.outputs import outputs_of
from uvms_drake.control.laws.tip_rows import POSE, tip_rows
from uvms_drake.model.uvms_model import UvmsModel

MAY_BE_UNDRIVEN = ("roll", "pitch")
"""Axes of the vehicle that weight and buoyancy hold, if no thruster does."""
LARGEST = 1e6
"""Acceleration [m/s², rad/s²] that only a singular posture asks for."""


@dataclass
class BlockGains:
    """Gains of a block of rows."""

    k: float
    """Gain of the velocity error [1/s]."""
    sigma: float
    """σ, gain of the error [1/s]."""
    observer: float = 0.0
    """λ of the observer of the disturbance [1/s]; zero for none."""

    def check(self) -> None:
        """Raises `InvalidParameter` for a gain that has no meaning."""
        for key in ("k", "sigma"):
            require(0.0 < getattr(self, key) < np.inf, key, getattr(self, key), "positive")
        require(0.0 <= self.observer < np.inf, "observer", self.observer, "zero or positive")


@dataclass
class TipFirst(AncillaryLaw):
    """The law `tip first`, its rows and its gains."""

    vehicle: BlockGains = field(default_factory=lambda: BlockGains(1.5, 0.4))
    """Gains of the vehicle's pose, which thrusters can follow."""
    tip: BlockGains = field(default_factory=lambda: BlockGains(20.0, 10.0))
    """Gains of the tip's task."""
    rows: list[str] = field(default_factory=list)
    """The tip's task, one row for each joint: of x, y, z, roll, pitch, yaw of the end-effector and
    q1, q2, ...; none for position first and then what the arm holds best."""
    undriven: list[str] = field(default_factory=list)
    """Axes of the vehicle that no thruster drives, of roll and pitch: not fed back."""
    observer_period: float = 0.02
    """Time between two estimates of the observer, if there is one [s]."""

    takes_force = takes_wrench = True

    def check(self, *, kinematic: bool = False) -> None:  # noqa: D102  see AncillaryLaw
        for key in ("vehicle", "tip"):
            with within(key):
                getattr(self, key).check()
        require_period("observer_period", self.observer_period)
        allowed = set(self.undriven) <= set(MAY_BE_UNDRIVEN)
        require(allowed, "undriven", self.undriven, f"of {', '.join(MAY_BE_UNDRIVEN)}")

    @property
    def name(self) -> str:  # noqa: D102  see AncillaryLaw
        return "tip-first"

    @property
    def undriven_rows(self) -> np.ndarray:
        """Indices in η of the axes that no thruster drives."""
        return np.array(sorted({POSE.index(name) for name in self.undriven}), dtype=int)

    def gains(self, key: str, num_joints: int) -> np.ndarray:
        """Returns a gain of `BlockGains` for each row of y (6+n,)."""
        return np.repeat([getattr(self.vehicle, key), getattr(self.tip, key)], [6, num_joints])

    def observed(self, model: UvmsModel) -> Observed | None:  # noqa: D102  see AncillaryLaw
        rates = self.gains("observer", model.num_joints)
        if not rates.any():
            return None
        rows = tip_rows(model, tuple(self.rows))
        return Observed(rates, self.observer_period, lambda now: outputs_of(now, rows))

    def command(self, model: UvmsModel, now: Pair, nominal_acceleration: Callable[[], np.ndarray],
                nominal_input: Callable[[], np.ndarray]) -> Command:
        """Returns τ of (L), with a wrench the joints' of (A), ahead if told; it asks for ζ̄̇ only."""
        n, out = model.num_joints, outputs_of(now, tip_rows(model, tuple(self.rows)))
        k, sigma = self.gains("k", n), self.gains("sigma", n)
        desired_output_acceleration = out.J[1] @ nominal_acceleration() + out.bias[1]  # ÿ̄
        desired_output_acceleration += -(k + sigma) * (out.rate[0] - out.rate[1]) - k * sigma * out.error
        if now.estimate is not None:
            desired_output_acceleration -= now.estimate
        measured, zeta = now.kinematics.at(0), now.zeta[0]
        M, b = model.mass_matrix(measured), model.inverse_dynamics(
            measured, zeta, np.zeros_like(zeta), now.contact)
        given = np.zeros(6) if now.wrench is None else now.wrench

        def torques(axes: np.ndarray) -> np.ndarray:
            """Returns τ (6+n,) where the vehicle gets what is given about these axes."""
            A, right = out.J[0].copy(), desired_output_acceleration - out.bias[0]
            A[axes], right[axes] = M[axes], given[axes] - b[axes]
            return M @ _solve(A, right, now.y[0, 6:]) + b

        undriven = self.undriven_rows
        tau = torques(undriven)
        if now.wrench is not None:
            tau[6:] = torques(np.arange(6))[6:]
        if now.preview is not None:
            tau += now.preview
        tau[undriven] = 0.0
        return Command(u=cache(lambda: np.linalg.solve(M, tau)), tau=lambda: tau, M=lambda: M)


def _solve(A: np.ndarray, right: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Returns A⁻¹ right, or refuses the joint angles q (n,) as a singular posture."""
    try:
        zeta_dot: np.ndarray = np.linalg.solve(A, right)
    except np.linalg.LinAlgError:
        zeta_dot = np.array([np.inf])
    if not (np.abs(zeta_dot) < LARGEST).all():
        raise InvalidParameter("ancillary.rows", "at the joint angles " + np.array2string(
            q, precision=3), "rows that the arm can hold, away from its singular postures")
    return zeta_dot
