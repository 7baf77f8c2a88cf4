"""Motion of the tip between two instants: jerk of its plan, unevenness of its acceleration.

The jerk bounds the deviation of a plan from a parabola between two knots. The safe region takes the
tip's velocity between two readings of the force as that on the line between the velocities at the
readings; an acceleration that varies by a within their interval h takes it off that line by ah/4 at
most. A bound of a, from jumps and from steady changes:
tube/contact/theory.md#unevenness-of-the-tips-motion.
"""

from dataclasses import dataclass

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.spatial import times
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds
from uvms_drake.tube.estimates import Check
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.search_problem import SearchProblem
from uvms_drake.tube.search.second_search import claimed

JERK = "jerk of the tip"
"""Name of the estimate; on it rest the speed of a plan between its knots and the tip's largest."""
SAFETY = 1.1
"""Factor of the largest jerk of the tip that was found."""
DIFFERENCE = 1e-3
"""Step of the differences [s]."""
PATIENCE, LEADERS = 2, 16
"""Effort of the ascent, see `ascent.supremum`: the interval has more dimensions than a motion."""


def tip_jerk(model: ContactModel, planned: ConstraintSet, step: float, tool_angle: float,
             samples: int, seed: int = 0) -> tuple[float, Check]:
    """Returns the claim of the largest |d³(n·𝔭)/dt³| [m/s³] over the intervals of plans.

    In an interval ζ̄̇ is constant, so it is (ζ₁ − ζ₀)/h for two velocities of the set. An ascent from
    the worst of random intervals; with it comes its check.

    Args:
        model: The controller's; without contact, which has no part in it.
        planned: The set of the plans' states; `contact_measure` has no meaning here.
        step: h [s].
        tool_angle: Largest angle between n and the tip's x-axis [rad].
        samples: Number of intervals.
        seed: Seed of the search.
    """
    size, eye, rng = model.size, np.eye(model.size + 2), np.random.default_rng(seed)
    blocks = ((slice(0, 3), planned.nu1), (slice(3, 6), planned.nu2),
              (slice(6, size), planned.qdot), (slice(size, size + 2), 1.0))
    problem = _JerkProblem(
        model, planned, [(eye[:, block], radius) for block, radius in blocks], step, tool_angle)
    x = problem.draw(samples, rng)
    # The worst intervals end with the opposite velocity.
    turned = np.concatenate([-x[:, size: 2 * size], rng.choice([-0.7, 0.7], (samples, 2))], axis=1)
    claim, check = claimed(problem, [JERK], x, np.abs(problem.values(x, turned)), SAFETY, seed,
                           PATIENCE, LEADERS)
    return float(claim[0]), check


@dataclass(frozen=True)
class _JerkProblem(SearchProblem):
    """Search for the jerk; its errors are ζ₁ and the direction of n about the tip's x-axis."""

    step: float
    tool_angle: float

    @property
    def errors(self) -> int:
        """Number of components of the errors."""
        return self.size + 2

    @property
    def channels(self) -> list[slice]:
        """One channel."""
        return [slice(0, 1)]

    def values(self, x: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Returns d³(n·𝔭)/dt³ (..., 1) of motions x (..., 3(6+n)); ū has time and angle in it."""
        pose, before, share = np.split(x, 3, axis=-1)
        after, across = error[..., : self.size], error[..., self.size: self.size + 2]
        return _jerk(self.model, self.step, self.config(pose), before, after,
                     0.5 * (1.0 + share[..., :1]), self.tool_angle * share[..., 1] ** 2,
                     across)[..., None]


def _jerk(model: ContactModel, step: float, config: np.ndarray, before: np.ndarray,
          after: np.ndarray, share: np.ndarray, off: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Returns d³(n·𝔭)/dt³ (...) at a `share` (..., 1) of the interval between two knots.

    n is `off` (...) the tip's x-axis [rad], towards the direction `across` (..., 2).
    """
    rate = (after - before) / step
    zeta = before + share * (after - before)
    tilted = np.sin(off)[..., None] * across
    forward = np.broadcast_to(np.cos(off)[..., None], (*tilted.shape[:-1], 1))
    n_E = np.concatenate([forward, tilted], axis=-1)
    n = times(model.tip_kinematics(config).A_E[..., :3, :3], n_E)

    # n·𝔭̇ a little later, now and before, 𝔮 by the midpoint rule.
    time = DIFFERENCE * np.array([1.0, 0.0, -1.0]).reshape(3, *(1,) * zeta.ndim)
    at = config + 0.5 * time * configuration_rate(config, zeta)
    moved = config + time * configuration_rate(at, zeta + 0.5 * time * rate)
    J = model.tip_kinematics(moved).J_chi[..., :3, :]
    later, now, earlier = np.sum(n * times(J, zeta + time * rate), axis=-1)
    jerk: np.ndarray = (later - 2.0 * now + earlier) / DIFFERENCE**2
    return jerk


@dataclass(frozen=True)
class TipAcceleration:
    """Accelerations of the tip's deviation by their sources, along n and in all, under a law."""

    by_force: tuple[float, float]
    """‖A_f‖ of the row of n of J_EM⁻¹J_Eᵀ, and of all its rows of the position [1/kg]."""
    by_normal: tuple[float, float]
    """|A_f n| of the same [1/kg]."""
    turning: float
    """ω, angular speed of the tip's axes [rad/s]."""
    other: float
    """d, bound of the acceleration by the disturbance and by the turn of the Jacobian [m/s²]."""


def unevenness(tip: TipAcceleration, force: MeasuredForceBounds, period: float, planned: float,
               tilt: float = 0.0) -> float:
    """Returns a [m/s²], such that ⟨v⟩ is off the line between two readings by at most ah/4.

    With d and ω of `TipAcceleration`, the largest A and A_n of the rows n + αu, u ⟂ n, each that of
    n and α times that of all rows, the bounds of `MeasuredForceBounds` and the plan's variation p,

        a = 2√(1 + α²)d + A_n a_n + 2A a′ + ½h(A_n ρ + A(ρ′ + ωF̄)) + p,                      (4)

    but for the change of the feedback within h, which is assumed to add nothing.

    Args:
        tip: The deviation of the tip.
        force: Forces and their readings.
        period: h, between two readings [s].
        planned: p, largest variation of ⟨·⟩ of the plan's acceleration within h [m/s²].
        tilt: α of ⟨v⟩.
    """
    A, A_n = (along + tilt * whole for along, whole in (tip.by_force, tip.by_normal))
    # Steady changes count half: a line fits them best.
    steady = A_n * force.rate + A * (force.tangential_rate + tip.turning * force.size)
    jumps = (2.0 * np.hypot(1.0, tilt) * tip.other + A_n * force.ripple
             + 2.0 * A * force.tangential_ripple)
    return float(jumps + 0.5 * period * steady + planned)
