"""Declared constraint set: the states over which the certificate's constants are suprema.

It has the limits of the real robot as plain numbers: joint angles in a box, roll and pitch of the
vehicle, pitch of the end-effector (the Euler angles are singular at π/2), the angle of the tool to
the direction n of a sensed contact, norms of ν₁, ν₂ and q̇,
and a measure of the contact by the surface itself (`Surface.contact_measure`): for a plane the
depth of the tip, for a spring, which acts everywhere, its force. The position along a plane makes
no difference and is not limited.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require, vector
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.frames.spatial import in_ball
from uvms_drake.model.uvms_model import UvmsModel

BOUND_SHARE = 0.2
"""Probability with which a sampled coordinate is put on one of its two bounds."""
FACE_SHARE = 0.25
"""Share of the samples that are moved onto |tip pitch| = tip_pitch, if that bound is active."""
BISECTIONS = 12
"""Halvings of a segment from a feasible to an infeasible sample: less than 1 mrad remains."""
MANY = 64
"""Number of samples, of which one is far from the limits that are no box."""
ROUNDING = 1e-9
"""Allowance for rounding at a limit."""
BATCH = 2048
"""Number of candidates drawn at a time."""
TIP_PITCH = 4
"""Component of χ: pitch of the end-effector."""
MAX_ATTEMPTS = 200
"""Number of batches without a feasible sample until the set counts as empty."""


def pulled(keeps: Callable[[np.ndarray], np.ndarray], x: np.ndarray, inside: np.ndarray,
           halvings: int) -> np.ndarray:
    """Returns points (m, d); those outside of a set are moved towards others into it.

    Args:
        keeps: Function that returns which of some points are in the set.
        x: The points (m, d).
        inside: Points of the set (m, d), or one.
        halvings: Number of halvings of the way.
    """
    out, bad = x.copy(), np.nonzero(~keeps(x))[0]
    if len(bad) == 0:
        return out
    start = np.broadcast_to(inside, x.shape)[bad]
    low, high = np.zeros((len(bad), 1)), np.ones((len(bad), 1))
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        kept = keeps(start + middle * (x[bad] - start))[:, None]
        low, high = np.where(kept, middle, low), np.where(kept, high, middle)
    out[bad] = start + low * (x[bad] - start)
    return out


@dataclass(frozen=True)
class ConstraintSet:
    """Bounds on the state (𝔮, ζ); the suprema of `constants` and `covering` are over this set."""

    q_lower: np.ndarray
    """Lower joint limits (n,) [rad]."""
    q_upper: np.ndarray
    """Upper joint limits (n,) [rad]."""
    roll: float
    """Largest |φ| of the vehicle [rad]."""
    pitch: float
    """Largest |θ| of the vehicle [rad]."""
    tip_pitch: float
    """Largest |𝔬_θ| of the end-effector [rad]."""
    nu1: float
    """Largest ‖ν₁‖₂ [m/s]."""
    nu2: float
    """Largest ‖ν₂‖₂ [rad/s]."""
    qdot: float
    """Largest ‖q̇‖₂ [rad/s]."""
    force_max: float = 50.0
    """Largest ‖force part of 𝔉‖₂ at rest [N]."""
    yaw: float = np.pi
    """Largest |ψ| of the vehicle [rad]; matters only to f, by where the surface is."""
    tool: tuple[float, float] | None = None
    """Slope of n of a sensed contact, its angle below the horizontal, and the largest angle between
    n and the tip's x-axis [rad]; None where none is limited."""

    def __post_init__(self) -> None:
        size = len(np.atleast_1d(self.q_lower))
        for key in ("q_lower", "q_upper"):
            object.__setattr__(self, key, vector(key, getattr(self, key), size))
        require(bool(np.all(self.q_lower <= self.q_upper)), "q_upper", self.q_upper,
                f"at least q_lower = {self.q_lower}, everywhere")
        for key in ("roll", "pitch"):
            value = getattr(self, key)
            require(0.0 <= value < 0.5 * np.pi, key, value, "in [0, π/2)")
        require(0.0 < self.tip_pitch < 0.5 * np.pi, "tip_pitch", self.tip_pitch, "in (0, π/2)")
        require(0.0 <= self.yaw <= np.pi, "yaw", self.yaw, "in [0, π]")
        for key in ("nu1", "nu2", "qdot", "force_max"):
            value = getattr(self, key)
            require(0.0 < value < np.inf, key, value, "positive")

    @property
    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (3+n,) of (φ, θ, ψ, q)."""
        attitude = np.array([self.roll, self.pitch, self.yaw])
        return (np.concatenate([-attitude, self.q_lower]),
                np.concatenate([attitude, self.q_upper]))

    def scale(self, model: ContactModel) -> np.ndarray:
        """Returns about how far each coordinate of (𝔮, ζ) can move in the set (2(6+n),)."""
        lower, upper = self.box
        position = model.surface.contact_reach(self.force_max)
        return np.concatenate([
            np.full(3, position), np.maximum(0.5 * (upper - lower), 1e-3),
            np.full(3, self.nu1), np.full(3, self.nu2), np.full(model.num_joints, self.qdot)])

    def normalised_tip(self, model: ContactModel, chi: np.ndarray) -> np.ndarray:
        """Returns values of the tip's pose χ (m, 6) that have to be in [−1, 1] (m, 3).

        Tip pitch and the slope of the tip's x-axis less that of n, over their bounds;
        `Surface.contact_measure`. Slopes differ by the angle of the axes at most, and by no less at
        the best heading: headings matter to nothing that is said of a sensed contact.
        """
        return np.column_stack([self._normalised_attitude(model, chi),
                                model.surface.contact_measure(chi, self.force_max)])

    def _normalised_attitude(self, model: UvmsModel, chi: np.ndarray) -> np.ndarray:
        """Returns the first two of `normalised_tip` (m, 2)."""
        tool, (theta, psi) = np.zeros(len(chi)), chi[:, TIP_PITCH:].T
        if self.tool is not None:
            x_E = np.stack([np.cos(theta) * np.cos(psi), np.cos(theta) * np.sin(psi),
                            -np.sin(theta)], axis=1)
            slope = np.arcsin(np.clip(x_E @ model.R_WT[2], -1.0, 1.0))
            tool = (slope - self.tool[0]) / self.tool[1]
        return np.stack([theta / self.tip_pitch, tool], axis=1)

    def keeps_attitude(self, model: UvmsModel, x: np.ndarray) -> np.ndarray:
        """Returns whether (φ, θ, ψ, q) (m, 3+n) keep tip pitch and tool angle (m,)."""
        return np.all(np.abs(self._normalised_attitude(model, self._tip(model, x)))
                      <= 1.0 + ROUNDING, axis=1)

    def centre(self, model: UvmsModel) -> np.ndarray:
        """Returns (φ, θ, ψ, q) (3+n,) of the set, far from the limits of tip pitch and tool angle.

        Raises:
            InvalidParameter: As of `sample`.
        """
        lower, upper = self.box
        x = np.vstack([0.5 * (lower + upper), self._kept_attitudes(
            model, MANY, np.random.default_rng(0))])
        worst = np.max(np.abs(self._normalised_attitude(model, self._tip(model, x))), axis=1)
        found: np.ndarray = x[np.argmin(worst)]
        return found

    @staticmethod
    def _tip(model: UvmsModel, x: np.ndarray) -> np.ndarray:
        """Returns χ (m, 6) at (φ, θ, ψ, q) (m, 3+n)."""
        return model.task_pose(np.concatenate([np.zeros((len(x), 3)), x], axis=1))[:, :6]

    def sample(self, model: ContactModel, count: int,
               rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Returns `count` states 𝔮, ζ (count, 6+n) of the set: interior, faces, edges and corners.

        Attitude and joints are uniform in their box, each coordinate on a bound with probability
        `BOUND_SHARE`. Candidates with too much tip pitch or tool angle are rejected, or moved
        towards a feasible one until they are just inside. Contact and velocities are then drawn
        independently.

        Raises:
            InvalidParameter: No attitude and joint angles within the box have the tip pitch.
        """
        require(model.num_joints == len(self.q_lower), "q_lower", self.q_lower,
                f"{model.num_joints} numbers, one for each joint")
        config = np.zeros((count, model.size))
        config[:, 3:] = self._kept_attitudes(model, count, rng)
        config[:, :3] = self._positions(model, config, rng)
        zeta = np.concatenate([
            in_ball(rng, count, 3, self.nu1), in_ball(rng, count, 3, self.nu2),
            in_ball(rng, count, model.num_joints, self.qdot)], axis=1)
        return config, zeta

    def _kept_attitudes(self, model: UvmsModel, count: int, rng: np.random.Generator
                        ) -> np.ndarray:
        """Returns (φ, θ, ψ, q) (count, 3+n) of the set."""
        out, attempts = np.empty((0, model.size - 3)), 0
        while len(out) < count:
            out = np.concatenate([out, self._attitudes_and_joints(model, BATCH, rng)])
            attempts += 1
            if len(out) == 0 and attempts >= MAX_ATTEMPTS:
                raise InvalidParameter(
                    "tip_pitch", self.tip_pitch,
                    "a pitch that the vehicle's attitude and the joints can keep")
        return out[:count]

    def _attitudes_and_joints(self, model: UvmsModel, count: int,
                              rng: np.random.Generator) -> np.ndarray:
        lower, upper = self.box
        x = rng.uniform(lower, upper, size=(count, len(lower)))
        at_bound = rng.uniform(size=x.shape) < BOUND_SHARE
        x = np.where(at_bound, np.where(rng.uniform(size=x.shape) < 0.5, lower, upper), x)
        inside = self.keeps_attitude(model, x)
        good, bad = x[inside], x[~inside]
        moved = bad[: int(FACE_SHARE / (1.0 - FACE_SHARE) * len(good))]
        if len(moved) == 0:
            return good
        start = good[rng.integers(len(good), size=len(moved))]
        return rng.permutation(np.concatenate([good, pulled(
            lambda x: self.keeps_attitude(model, x), moved, start, BISECTIONS)]))

    def _positions(self, model: ContactModel, config: np.ndarray,
                   rng: np.random.Generator) -> np.ndarray:
        """Returns positions of the vehicle (m, 3) for tips at random contacts."""
        kinematics = model.kinematics(config)
        tip = model.surface.sample_contact(kinematics.chi, self.force_max, rng)
        arm = rotation_matrix(config[:, 3:6]) @ kinematics.p_BL[:, -1, :, None]
        return tip - arm[..., 0]
