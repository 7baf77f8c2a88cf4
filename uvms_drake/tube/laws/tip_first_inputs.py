"""Disturbance inputs of the rows of `tip first`: gain × bound, by block and source.

See (1) and (2) of `tube.laws.tip_first`.
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.tube.contact.sensor_error import (
    SOURCES,
    MeasuredForceBounds,
    by_source,
    reading_input,
    reading_off,
)
from uvms_drake.tube.contact.sensor_gains import OperatorNorms, Suprema
from uvms_drake.tube.contact.sensor_gains_proof import claimed_suprema
from uvms_drake.tube.estimates import Check, no_estimates, together
from uvms_drake.tube.law_tube import Basis
from uvms_drake.tube.laws.tip_first_image import Arm
from uvms_drake.tube.row_gains import instant_gains, lagged_gains, moments

VEHICLE, ATTITUDE, TIP, DEPTH, JOINTS = "vehicle", "attitude", "position", "depth", "joints"
"""The blocks by their names in the budget; `DEPTH` is the row n·e_p, `JOINTS` x_q of (2)."""
Parts = dict[str, np.ndarray]
"""Bounds (4,) of e, ė, w and ë by source."""


E, RATE, W, ACCELERATION = range(4)
"""Columns of gains and bounds of e, ė, w and ë."""


class LoopGains(NamedTuple):
    """Gains of a loop, to e, ė, w and ë (4,)."""

    known: np.ndarray
    """Gains from any δ."""
    missed: np.ndarray
    """Gains from a force to the effect of its delayed measurement."""
    moment: np.ndarray
    """First moments ∫t|g|."""


def loop_gains(k: float, sigma: float, basis: Basis) -> LoopGains:
    """Returns the gains of a row with k and σ; see `lagged_gains`."""
    # ë is the feedback, and the disturbance.
    gains, moment, contact = instant_gains(k, sigma)[:3], moments(k, sigma)[:3], basis.contact
    known = np.array([*gains, 1.0 + gains[W]])
    missed = 2.0 * known
    if contact is not None:
        missed[:3] = lagged_gains(k, sigma, contact.lag, contact.period)[:3]
    return LoopGains(known, missed, np.array([*moment, moment[W]]))


class DisturbanceInputs:
    """Disturbance inputs of the rows: d, and the force sensor's error, see (3) of `sensor_error`.

    Without J̃‖𝔯‖ in (3): here the rows themselves are driven by A(q)(F̂ − F).

    Args:
        basis: The data.
    """

    reading: np.ndarray
    """Contribution of the error of the reading to u and τ (2(6+n),), see `reading_input`."""
    check: Check = no_estimates
    turning = 0.0
    """ω, angular speed of the tip's axes [rad/s]."""

    def __init__(self, basis: Basis):
        self._basis, contact = basis, basis.contact
        self._found: Suprema | None = None
        self.reading = np.zeros(2 * basis.model.size)
        if contact is None:
            return
        declared, settings = basis.declared, basis.settings
        claimed = claimed_suprema(basis.model, declared, contact.tool_angle,
                                  safety_factor=settings.safety_factor, seed=settings.seed)
        self._found = found = claimed.suprema
        self.turning = declared.nu2 + found.turning * declared.qdot
        self.reading, check = reading_input(
            basis.model, declared, reading_off(contact, self.turning), contact.torque_error,
            settings)
        self.check = together(claimed.check, check)
        stretch, sine = euler_stretch(declared.pitch), np.sin(declared.pitch)
        turning = stretch * np.hypot(stretch, np.sqrt(1.0 + sine**2) / (1.0 - sine**2))
        vehicle, attitude = self.zeta([0]), self.zeta([1])
        tip_turned = self.turning * float(found.position.force)
        self._rows: dict[str, tuple[OperatorNorms, float]] = {
            VEHICLE: (vehicle, declared.nu2 * float(vehicle.force)),
            ATTITUDE: (OperatorNorms(*(stretch * size for size in attitude)),
                       float(declared.nu2 * turning * attitude.force)),
            TIP: (found.position, tip_turned), DEPTH: (found.depth, tip_turned)}
        """Suprema of A of each block, and the rate of A by the turn of its axes."""

    @property
    def depth_norms(self) -> tuple[float, float]:
        """‖A_f‖ and |A_f n| of the row of n·𝔭̈ [1/kg]."""
        A = self._rows[DEPTH][0]
        return float(A.force), float(A.normal)

    def zeta(self, blocks: list[int]) -> OperatorNorms:
        """Returns suprema of some of the rows of ν₁, ν₂ and q̇ (0, 1, 2) of M⁻¹J_Eᵀ."""
        assert self._found is not None
        return OperatorNorms(*(float(np.linalg.norm(np.asarray(size)[blocks]))
                       for size in self._found.zeta))

    def of(self, loop: LoopGains, norm: float, name: str) -> Parts:
        """Returns the bounds of a block by source.

        Args:
            loop: Gains of its loop.
            norm: Bound of ‖J_bŴ‖.
            name: Name of the block.
        """
        by_d = {"d": self._basis.d_bound * norm * loop.known}
        return by_d if self._found is None else by_d | self.sensor_parts(loop, *self._rows[name])

    def sensor_parts(self, loop: LoopGains, A: OperatorNorms, turned: float = 0.0) -> Parts:
        """Returns the effect of the sensor's errors on rows with suprema A, by source."""
        contact, basis = self._basis.contact, self._basis
        assert contact is not None
        return _sensor_parts(contact, loop, A, self.turning, basis.declared.qdot, turned)

    def for_other(self, force: MeasuredForceBounds, nu2: float, qdot: float, loop: LoopGains,
                  name: str) -> Parts:
        """Returns the effect on a block of the tip's rows for other forces, by source.

        Args:
            force: The forces, of the same sensor.
            nu2: Bound of ‖ν₂‖ [rad/s].
            qdot: Bound of ‖q̇‖ [rad/s].
            loop: Gains of the tip's loop.
            name: Name of the block.
        """
        assert self._found is not None
        turning = nu2 + self._found.turning * qdot
        turned = turning * float(self._found.position.force)
        return _sensor_parts(force, loop, self._rows[name][0], turning, qdot, turned)


def _sensor_parts(force: MeasuredForceBounds, loop: LoopGains, A: OperatorNorms, turning: float,
                  qdot: float, turned: float) -> Parts:
    """Returns the effect of a sensor's errors on rows with suprema A, by source."""
    terms = np.array([
        by_source(force, A, known, missed, turning=turning, qdot=qdot, turned=turned,
                  integral=float(loop.known[E]) if column == RATE else None)
        for column, (known, missed) in enumerate(zip(loop.known, loop.missed, strict=True))])
    return dict(zip(SOURCES, terms.T, strict=True))


def in_joints(basis: Basis, arm: Arm, tip: LoopGains, inputs: DisturbanceInputs) -> Parts:
    """Returns the bounds of x_q by source, by (2)."""
    J_dot, weights = basis.value("J_dot_max"), basis.weights
    lost = J_dot / arm.regular * tip.moment
    carried = arm.carried * float(np.max(weights[:6]))
    out = {"d": basis.d_bound * ((float(np.max(weights[6:])) + carried) * tip.known
                                 + lost)}
    if basis.contact is None:
        return out
    own, moved = (inputs.sensor_parts(tip, inputs.zeta(blocks)) for blocks in ([2], [0, 1]))
    whole = inputs.sensor_parts(tip._replace(known=np.ones(4), missed=np.full(4, 2.0)),
                        inputs.zeta([0, 1, 2]))
    return out | {source: own[source] + arm.carried * moved[source] + lost * whole[source]
                  for source in SOURCES}


def euler_stretch(angle: float) -> float:
    """Returns (1 − sin θ)^−½, the norm of the map from angular velocity to Euler rates."""
    return float((1.0 - np.sin(angle)) ** -0.5)
