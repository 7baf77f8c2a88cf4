"""Interface of a surface: its force law, and the functions for controller and certificate.

χ = (𝔭, 𝔬) is the pose of the end-effector: position in Σ_I [m] and ZYX Euler angles [rad], about
the axes of Σ_I unless `task.frame` of a scenario has others. The end-effector exerts 𝔉 *on* the
environment: force in Σ_I [N] and the torque conjugate to the Euler-angle rates [N m]; the
generalised force on the robot is −J(𝔮)ᵀ𝔉.

A law 𝔉(χ, χ̇) is a function of arrays of any leading shape, and of complex numbers (see `euler`):
its derivatives are taken by a complex step, which `check_surface` tests.
"""

from abc import ABC, abstractmethod
from dataclasses import is_dataclass
from typing import ClassVar, NamedTuple, Self

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.common.schema import checked
from uvms_drake.model.frames.euler import COMPLEX_STEP
from uvms_drake.model.surface.geometry import Plane

TRIALS = 32
"""Poses at which `check_surface` compares derivatives; half of them at rest."""
TRIAL_FORCE = 10.0
"""Largest static force of the trials, if the surface can be touched that softly [N]."""
NEARBY = 0.01
"""Distance of random tips from the anchor along each axis, by default [m]."""
FIRST_DEPTH, FARTHEST, HALVINGS = 1e-3, 1.0, 60
"""First and last depth at which a force is sought [m], and the number of halvings between."""
DIFFERENCE = 1e-7
"""Half the step of the difference [m, rad, m/s, rad/s]."""
AGREEMENT = 1e-3
"""Rounding of a derivative over the largest by a coordinate of that kind."""
COORDINATES = [f"{kind}{name}" for kind in ("", "d/dt ")
               for name in ("x", "y", "z", "roll", "pitch", "yaw")]
"""Names of the components of (χ, χ̇)."""


class NotOffered(InvalidParameter):
    """A surface lacks an optional function."""


class StaticForceRows(NamedTuple):
    """A bound of the force at rest, linearised about poses, as lengths [m]: about as large as y."""

    rows: np.ndarray
    """(m, 6) derivative of `value` by χ."""
    value: np.ndarray
    """(..., m) limited quantity at the poses."""
    bound: float
    """Largest `value` that is allowed."""
    one_sided: bool
    """Whether value ≤ bound, a half-space (m = 1); else ‖value‖₂ ≤ bound, a cone."""


class TipErrors(NamedTuple):
    """Bounds of the error of the tip from a pose at rest."""

    position: float
    """Norm of the position error [m]."""
    depth: float
    """Position error along the surface's known normal [m]."""
    angle: float
    """Attitude error [rad]."""
    speed: float
    """Norm of the velocity error [m/s]."""
    depth_speed: float
    """Velocity error along the normal [m/s]."""


class Surface(ABC):
    """A surface that the end-effector presses on; the dataclass of its YAML settings.

    A closed loop needs the abstract methods. The others serve a limit on the static force
    (`force_jacobian`, `static_force_rows`), a certificate or a campaign; they have a default, or
    raise `NotOffered`. A flat surface of one's own has all of them, and so a certificate, as a
    `UnilateralPlane` with a `force`, a `penetration_for` and a `force_jacobian` of its own. A shape
    alone may be a `Geometry` of a `ShapedSurface`, which adds the static force by the depth,
    damping and friction.
    """

    normal: np.ndarray | None = None
    """Unit normal into the water (3,) in Σ_I of a flat surface; None: it is not flat, and a desired
    force is a vector."""
    exerts_force: ClassVar[bool] = True
    """Whether 𝔉 is not zero everywhere, as it is in free water."""

    @property
    @abstractmethod
    def anchor(self) -> np.ndarray:
        """Point of the undeformed surface (3,) in Σ_I [m]."""

    def checked(self) -> Self:
        """Returns the surface with its parameters as arrays, or raises; itself without any."""
        return checked(self) if is_dataclass(self) else self

    @abstractmethod
    def force(self, chi: np.ndarray, chi_dot: np.ndarray) -> np.ndarray:
        """Returns 𝔉 (..., 6) [N, N m] at the pose χ (..., 6) moving with χ̇ (..., 6).

        Also for complex numbers, by which derivatives are taken: an array for it is made with
        `np.zeros_like(chi)`, and nothing takes an absolute value, a real part or `math.sqrt`.

        Args:
            chi: Position in Σ_I and ZYX Euler angles of the end-effector [m, rad].
            chi_dot: Its rate [m/s, rad/s].
        """

    def is_clear(self, position: np.ndarray) -> bool:
        """Returns whether a tip at a position (3,) exerts no force, whatever its motion.

        By default that is not known: False.
        """
        return False

    @abstractmethod
    def penetration(self, chi: np.ndarray) -> np.ndarray:
        """Returns the penetration of the end-effector (...) [m]."""

    def pose_for(self, force: np.ndarray, pose: np.ndarray | None) -> np.ndarray:
        """Returns χ_des (6,) at rest for 𝔉_des (6,); `pose` (6,) fixes the free coordinates.

        By default it moves `pose` along the force to where the surface gives that force.
        """
        size = float(np.linalg.norm(force[:3]))
        if pose is None:
            raise InvalidParameter("pose", pose, "given: the surface leaves coordinates free")
        require(size > 0.0, "force", force, "not zero")
        start, along = pose, np.concatenate([force[:3] / size, np.zeros(3)])

        def excess(depth: float) -> float:
            return float(self.static_force(start + depth * along)) - size

        low, high = -FIRST_DEPTH, FIRST_DEPTH
        while excess(low) > 0.0 and low > -FARTHEST:
            low *= 2.0
        while excess(high) < 0.0 and high < FARTHEST:
            high *= 2.0
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if excess(middle) > 0.0 else (middle, high)
        chi: np.ndarray = start + low * along
        given = self.force(chi, np.zeros(6))
        require(bool(np.allclose(given, force, rtol=0.0, atol=1e-3 * size)), "force", force,
                f"one that the surface gives along its direction from the pose; it gives {given}")
        return chi

    def force_jacobian(self) -> np.ndarray:
        """Returns G (m, 6) [N/m, N/rad]: at rest the force changes by at most ‖G dχ‖₂ with χ."""
        raise self._lacks("force_jacobian")

    def sample_contact(self, chi: np.ndarray, force_max: float, rng: np.random.Generator
                       ) -> np.ndarray:
        """Returns random positions (m, 3) of a tip with the attitudes of χ (m, 6) in contact.

        Or close to it. The static force is at most `force_max` [N]. By default they are near
        `anchor`.
        """
        many = np.tile(chi, (TRIALS, 1))
        many[:, :3] = self.anchor + rng.uniform(-NEARBY, NEARBY, (len(many), 3))
        soft = self.static_force(many) <= force_max
        # Of the trials of each tip the first one that is soft enough; the anchor if none is.
        first = np.argmax(soft.reshape(TRIALS, -1), axis=0)
        found: np.ndarray = many.reshape(TRIALS, -1, 6)[first, np.arange(len(chi)), :3]
        found[~soft.reshape(TRIALS, -1).any(axis=0)] = self.anchor
        return found

    def static_force(self, chi: np.ndarray) -> np.ndarray:
        """Returns ‖force part of 𝔉‖₂ (...) [N] at the pose χ (..., 6), not moving."""
        return np.linalg.norm(self.force(chi, np.zeros_like(chi))[..., :3], axis=-1)

    @property
    def stiffness_bound(self) -> float:
        """Largest change of the static force with the position, ‖G_p‖₂ [N/m]."""
        return float(np.linalg.norm(self.force_jacobian()[:, :3], 2))

    def force_radius(self, position: float, angle: float) -> float:
        """Returns the largest change of the static force by an error of the pose [N].

        For a spring it assumes that no Euler angle is π away from its equilibrium's.

        Args:
            position: Largest error of the position [m].
            angle: Largest error of the attitude [rad].
        """
        G = self.force_jacobian()
        return float(np.linalg.norm(G[:, :3], 2) * position
                     + np.linalg.norm(G[:, 3:], 2) * angle)

    def patch(self, center: np.ndarray, size: float, count: int) -> np.ndarray | None:
        """Returns points (count, count, 3) of the undeformed surface in Σ_I, or None: for pictures.

        The grid is a square with sides of at most `size` [m] about the point of the surface next to
        `center` (3,). By default it is flat, and none without a `normal`.
        """
        return None if self.normal is None else Plane(self.anchor, self.normal).patch(
            center, size, count)

    def turned(self, chi: np.ndarray) -> np.ndarray:
        """Returns the distance (...) of the attitudes of χ (..., 6) from a jump of 𝔉.

        It is in [0, 1]; 1 is at the jump. By default there is none.
        """
        return np.zeros(chi.shape[:-1])

    def slip_damping(self, force: float) -> float:
        """Returns the largest slope of friction by the tip's speed [N s/m], at a static force [N].

        By default there is no friction.
        """
        return 0.0

    def penetration_for(self, force: float) -> float | None:
        """Returns the penetration at a static force [N], or None if not a function of it."""
        return None

    def static_force_rows(self, chi: np.ndarray, bound: float) -> StaticForceRows:
        """Returns the bound [N] of the static force, linearised about χ (..., 6)."""
        raise self._lacks("static_force_rows")

    def contact_measure(self, chi: np.ndarray, force_max: float) -> np.ndarray:
        """Returns a measure (m,), in [−1, 1] for the poses χ (m, 6) of a certificate.

        Those are the poses that `sample_contact` makes.
        """
        raise self._lacks("contact_measure")

    def contact_reach(self, force_max: float) -> float:
        """Returns the approximate extent of the poses of `contact_measure` [m]."""
        raise self._lacks("contact_reach")

    def force_error(self, chi: np.ndarray, wrench: np.ndarray, off: TipErrors) -> float:
        """Returns the largest change of the force part of 𝔉 from that at rest at χ (6,) [N].

        Args:
            chi: Pose of the task.
            wrench: 𝔉_des (6,), which the surface gives there [N, N m].
            off: Errors of the tip.
        """
        raise self._lacks("force_error")

    def stiffened(self, factor: float) -> Self:
        """Returns the surface with `factor` times the stiffness."""
        raise self._lacks("stiffened")

    def moved(self, R: np.ndarray, shift: np.ndarray) -> Self:
        """Returns the surface, every point 𝔭 of it moved to R𝔭 + `shift` (3,)."""
        raise self._lacks("moved")

    def _lacks(self, method: str) -> NotOffered:
        return NotOffered("surface", type(self).__name__, f"one that has `{method}`")


def check_surface(surface: Surface) -> Surface:
    """Returns a surface for its consumers, after `Surface.checked` and a test of its law.

    Raises:
        InvalidParameter: A parameter is invalid, or a complex step of the law along one of the
            coordinates of (χ, χ̇) does not agree with a difference.
    """
    surface = surface.checked()
    rng = np.random.default_rng(0)
    chi = np.concatenate([np.zeros((TRIALS, 3)), rng.uniform(-0.5, 0.5, (TRIALS, 3))], axis=1)
    chi[:, :3] = surface.sample_contact(chi, TRIAL_FORCE, rng)
    chi_dot = rng.uniform(-0.1, 0.1, (TRIALS, 6)) * (np.arange(TRIALS) % 2)[:, None]
    at = np.concatenate([chi, chi_dot], axis=1)

    def force(step: complex) -> np.ndarray:
        """𝔉 (12, TRIALS, 6) after a step along each coordinate."""
        moved = at + step * np.eye(12)[:, None, :]
        return surface.force(moved[..., :6], moved[..., 6:])

    name = type(surface).__name__
    try:
        by_complex = force(1j * COMPLEX_STEP).imag / COMPLEX_STEP
    except (TypeError, ValueError) as error:
        raise InvalidParameter("force", name, f"a function of complex numbers too ({error})"
                               ) from None
    require(by_complex.shape == (12, TRIALS, 6), "force", name,
            f"(..., 6) for χ (..., 6), it is {by_complex.shape} for {(12, TRIALS, 6)}")
    by_difference = (force(DIFFERENCE) - force(-DIFFERENCE)) / (2.0 * DIFFERENCE)
    # Derivatives by position, attitude and their rates have units of their own.
    scale = np.max(np.abs(by_difference).reshape(4, -1), axis=1)
    excess = np.abs(by_complex - by_difference) - AGREEMENT * np.repeat(scale, 3)[:, None, None]
    worst = np.unravel_index(np.argmax(excess), excess.shape)
    # Below this, a difference is rounding and no derivative.
    rounding = 1e-13 / DIFFERENCE * max(1.0, float(np.max(np.abs(force(0.0)))))
    require(bool(excess[worst] <= rounding), "force", name,
            "analytic in complex numbers, without a cast to real or an absolute value: by "
            f"{COORDINATES[worst[0]]} a complex step gives {by_complex[worst]:g}, a difference "
            f"{by_difference[worst]:g}")
    return surface
