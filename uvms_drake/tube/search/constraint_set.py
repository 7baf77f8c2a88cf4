"""Declared constraint set: the states over which the certificate's constants are suprema.

It has the limits of the real robot as plain numbers: joint angles in a box, roll and pitch of the
vehicle, pitch of the end-effector (the Euler angles are singular at π/2), norms of ν₁, ν₂ and q̇,
and a measure of the contact by the surface itself (`Surface.contact_measure`): for a plane the
depth of the tip, for a spring, which acts everywhere, its force. The position along a plane makes
no difference and is not limited.
"""

from dataclasses import dataclass

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require, vector
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.frames.spatial import in_ball

BOUND_SHARE = 0.2
"""Probability with which a sampled coordinate is put on one of its two bounds."""
FACE_SHARE = 0.25
"""Share of the samples that are moved onto |tip pitch| = tip_pitch, if that bound is active."""
BISECTIONS = 12
"""Halvings of a segment from a feasible to an infeasible sample: less than 1 mrad remains."""
BATCH = 2048
"""Number of candidates drawn at a time."""
TIP_PITCH = 4
"""Component of χ: pitch of the end-effector."""
MAX_ATTEMPTS = 200
"""Number of batches without a feasible sample until the set counts as empty."""


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
        """Returns values of the tip's pose χ (m, 6) that have to be in [−1, 1] (m, 2).

        Tip pitch over its bound; `Surface.contact_measure`.
        """
        return np.stack([chi[:, TIP_PITCH] / self.tip_pitch,
                         model.surface.contact_measure(chi, self.force_max)], axis=1)

    def sample(self, model: ContactModel, count: int,
               rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Returns `count` states 𝔮, ζ (count, 6+n) of the set: interior, faces, edges and corners.

        Attitude and joints are uniform in their box, each coordinate on a bound with probability
        `BOUND_SHARE`. Candidates with too much tip pitch are rejected, or moved towards a feasible
        one until they are just inside. Contact and velocities are then drawn independently.

        Raises:
            InvalidParameter: No attitude and joint angles within the box have the tip pitch.
        """
        require(model.num_joints == len(self.q_lower), "q_lower", self.q_lower,
                f"{model.num_joints} numbers, one for each joint")
        config = np.zeros((count, model.size))
        filled = attempts = 0
        while filled < count:
            found = self._attitudes_and_joints(model, BATCH, rng)
            found = found[: count - filled]
            config[filled: filled + len(found), 3:] = found
            filled += len(found)
            attempts += 1
            if filled == 0 and attempts >= MAX_ATTEMPTS:
                raise InvalidParameter(
                    "tip_pitch", self.tip_pitch,
                    "a pitch that the vehicle's attitude and the joints can keep")
        config[:, :3] = self._positions(model, config, rng)
        zeta = np.concatenate([
            in_ball(rng, count, 3, self.nu1), in_ball(rng, count, 3, self.nu2),
            in_ball(rng, count, model.num_joints, self.qdot)], axis=1)
        return config, zeta

    def _attitudes_and_joints(self, model: ContactModel, count: int,
                              rng: np.random.Generator) -> np.ndarray:
        lower, upper = self.box
        x = rng.uniform(lower, upper, size=(count, len(lower)))
        at_bound = rng.uniform(size=x.shape) < BOUND_SHARE
        x = np.where(at_bound, np.where(rng.uniform(size=x.shape) < 0.5, lower, upper), x)
        inside = self._pitch_is_kept(model, x)
        good, bad = x[inside], x[~inside]
        moved = bad[: int(FACE_SHARE / (1.0 - FACE_SHARE) * len(good))]
        if len(moved) == 0:
            return good
        start, end = good[rng.integers(len(good), size=len(moved))], moved
        low, high = np.zeros((len(moved), 1)), np.ones((len(moved), 1))
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            keeps = self._pitch_is_kept(model, start + middle * (end - start))[:, None]
            low, high = np.where(keeps, middle, low), np.where(keeps, high, middle)
        return rng.permutation(np.concatenate([good, start + low * (end - start)]))

    def _pitch_is_kept(self, model: ContactModel, x: np.ndarray) -> np.ndarray:
        config = np.concatenate([np.zeros((len(x), 3)), x], axis=1)
        return np.abs(model.task_pose(config)[:, TIP_PITCH]) <= self.tip_pitch

    def _positions(self, model: ContactModel, config: np.ndarray,
                   rng: np.random.Generator) -> np.ndarray:
        """Returns positions of the vehicle (m, 3) for tips at random contacts."""
        kinematics = model.kinematics(config)
        tip = model.surface.sample_contact(kinematics.chi, self.force_max, rng)
        arm = rotation_matrix(config[:, 3:6]) @ kinematics.p_BL[:, -1, :, None]
        return tip - arm[..., 0]
