"""Plan of the kinematics, whose decision is the velocity ζ̄, and its terminal ingredients."""

from dataclasses import dataclass, replace

import numpy as np
from pydrake.systems.controllers import DiscreteTimeLinearQuadraticRegulator

from uvms_drake.control.plan.plan import Plan, advance_one, roll_out
from uvms_drake.control.plan.terminal import INFLATION, Terminal


@dataclass(frozen=True)
class KinematicPlan(Plan):
    """A plan of velocities, constant on every interval."""

    zeta: np.ndarray
    """ζ̄ on the intervals (N, 6+n)."""

    @staticmethod
    def from_velocities(start_time: float, time_step: float, config: np.ndarray, zeta: np.ndarray
                        ) -> "KinematicPlan":
        """Returns the plan that starts at 𝔮 (6+n,) and has the velocities (N, 6+n)."""
        configs = roll_out(config, zeta, np.zeros_like(zeta), time_step)
        return KinematicPlan(start_time, time_step, configs, zeta)

    @property
    def decision(self) -> np.ndarray:
        """Velocities ζ̄."""
        return self.zeta

    @property
    def start(self) -> np.ndarray:
        """First configuration 𝔮̄ (6+n,)."""
        return self.config[0]

    def redone(self, start: np.ndarray, decision: np.ndarray) -> "KinematicPlan":
        """Returns the plan from another 𝔮 or with other velocities."""
        return KinematicPlan.from_velocities(self.start_time, self.time_step, start, decision)

    def at(self, time: float, since: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Returns 𝔮̄ and ζ̄ (6+n,); at a knot, ζ̄ is that of the interval that ends there."""
        index, duration = self._interval(time, since)
        zeta = self.zeta[index]
        return advance_one(self.config[index], zeta, np.zeros_like(zeta), duration), zeta

    def shifted(self, last_decision: np.ndarray) -> "KinematicPlan":
        """Returns the plan one interval later, with this ζ̄ (6+n,) at its end."""
        last = advance_one(
            self.config[-1], last_decision, np.zeros_like(last_decision), self.time_step)
        return KinematicPlan(
            self.start_time + self.time_step, self.time_step,
            np.concatenate([self.config[1:], last[None]]),
            np.concatenate([self.zeta[1:], last_decision[None]]))

    def after(self, knot: int) -> "KinematicPlan":
        """Returns the part of the plan after one of its knots."""
        return replace(self, start_time=self.start_time + knot * self.time_step,
                       config=self.config[knot:], zeta=self.zeta[knot:])

    def preceded(self, other: "KinematicPlan", intervals: int) -> "KinematicPlan":
        """Returns the plan with the first intervals of another one, which end where it begins."""
        return replace(self, start_time=other.start_time,
                       config=np.concatenate([other.config[:intervals], self.config]),
                       zeta=np.concatenate([other.zeta[:intervals], self.zeta]))


def kinematic_terminal_ingredients(
    J_x: np.ndarray, Q: np.ndarray, R: np.ndarray, time_step: float, radius: float,
    inflation: float = INFLATION,
) -> Terminal:
    """Returns the ingredients for ξ⁺ = ξ + hJ_x ζ, ξ = y − y_des, and the input ζ.

    Args:
        J_x: Jacobian of the extended task (6+n, 6+n) at the equilibrium.
        Q: Diagonal weight of ξ (6+n, 6+n); where the joints' is zero, they are left out of the
            design, and of P.
        R: Weight of ζ (6+n, 6+n).
        time_step: h [s].
        radius: ε.
        inflation: μ ≥ 0.
    """
    size = len(J_x)
    weighted = np.diag(Q) > 0.0
    kept = np.ix_(weighted, weighted)
    K, riccati = DiscreteTimeLinearQuadraticRegulator(
        A=np.eye(size)[kept], B=time_step * J_x[weighted], Q=time_step * Q[kept], R=time_step * R)
    P, gain = np.zeros((size, size)), np.zeros((size, size))
    P[kept] = 0.5 * (1.0 + inflation) * (riccati + riccati.T)
    gain[:, weighted] = -K
    return Terminal(P=P, gain=gain, radius=radius)
