"""Points of a motion, the arguments of limits and cost terms, and derivatives by them."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, wraps
from typing import Literal, NamedTuple, Self, get_args

import numpy as np

from uvms_drake.model.frames.euler import COMPLEX_STEP, inverse_rate_matrix
from uvms_drake.model.frames.spatial import cross, times
from uvms_drake.model.uvms_model import Kinematics, UvmsModel, configuration_rate_matrix

About = Literal["pose", "speed", "input"]
"""Arguments of a function of `Points`: (𝔮, y); these and ζ; or these and u and τ too."""


UNKNOWN = np.empty(0)
"""Value of a field of some points that is not known."""


def geometric(compute: Callable[["Points"], np.ndarray]) -> "cached_property[np.ndarray]":
    """Makes a cached property of a function of 𝔮 alone: a subset takes it from all points."""
    @wraps(compute)
    def value(points: "Points") -> np.ndarray:
        if points.whole is None:
            return compute(points)
        whole, index = points.whole
        taken: np.ndarray = getattr(whole, compute.__name__)[index]
        return taken

    return cached_property(value)


@dataclass(frozen=True)
class Points:
    """Stack of points of a motion, of any leading shape; arrays may be complex."""

    model: UvmsModel
    config: np.ndarray
    """Configuration 𝔮 (..., 6+n) [m, rad]."""
    y: np.ndarray
    """Extended task (χ, q) (..., 6+n) [m, rad]."""
    zeta: np.ndarray = field(default_factory=lambda: UNKNOWN)
    """Velocity ζ (..., 6+n) [m/s, rad/s]."""
    u: np.ndarray = field(default_factory=lambda: UNKNOWN)
    """Input (..., 6+n): 𝔲 [m/s², rad/s²]."""
    forces: np.ndarray = field(default_factory=lambda: UNKNOWN)
    """Generalised force τ (..., 6+n) [N, N m], if it is not M(𝔮)𝔲."""
    whole: tuple["Points", int | slice | np.ndarray] | None = None
    """Points that these were taken from, see `subset`."""

    @classmethod
    def known(cls, model: UvmsModel, config: np.ndarray, kinematics: Kinematics,
              unwrapped: Callable[[np.ndarray], np.ndarray], zeta: np.ndarray) -> Self:
        """Returns the points at 𝔮 with a known geometry.

        Args:
            model: The model.
            config: 𝔮 (..., 6+n).
            kinematics: Geometry at 𝔮.
            unwrapped: Function from y to the same y with Euler angles near those of a task.
            zeta: ζ (..., 6+n).
        """
        y = np.concatenate([kinematics.chi, config[..., 6:]], axis=-1)
        out = cls(model, config, unwrapped(y), zeta)
        vars(out)["kinematics"] = kinematics
        return out

    def subset(self, index: int | slice | np.ndarray, u: np.ndarray = UNKNOWN) -> Self:
        """Returns some of the points, with this input there; they share all geometry."""
        zeta = self.zeta if self.zeta is UNKNOWN else self.zeta[index]
        return type(self)(
            self.model, self.config[index], self.y[index], zeta, u, whole=(self, index))

    @geometric
    def config_y(self) -> np.ndarray:
        """Derivative ∂𝔮/∂y = Γ J_x⁻¹ (..., 6+n, 6+n) of real points."""
        return configuration_rate_matrix(self.config) @ self.model.inverse_extended(
            self.kinematics.J_chi)

    @cached_property
    def drift(self) -> np.ndarray:
        """Drift f(𝔮, ζ) (..., 6+n) [m/s², rad/s²]."""
        bias = self.model.inverse_dynamics(self.kinematics, self.zeta, np.zeros_like(self.zeta))
        return -times(self.inverse_mass, bias)

    @geometric
    def inverse_mass(self) -> np.ndarray:
        """Inverse M⁻¹ (..., 6+n, 6+n) of the mass matrix."""
        return np.linalg.inv(self.mass_matrix)

    @geometric
    def mass_matrix(self) -> np.ndarray:
        """Mass matrix M(𝔮) (..., 6+n, 6+n)."""
        return self.model.mass_matrix(self.kinematics)

    @geometric
    def by_tip_force(self) -> np.ndarray:
        """Derivative M⁻¹J_𝔭ᵀ (..., 6+n, 3) of ζ̇ by a force on the end-effector."""
        return self.inverse_mass @ np.swapaxes(self.tip_jacobian, -1, -2)

    @geometric
    def by_tip_force_rates(self) -> np.ndarray:
        """∂(M⁻¹J_𝔭ᵀ) = M⁻¹(∂J_𝔭ᵀ − ∂M M⁻¹J_𝔭ᵀ) (..., 6+n, 3, 6+n), the last axis that of 𝔮."""
        change = np.swapaxes(self.tip_jacobian_rates, -2, -3).copy()
        change[..., 6:] -= np.moveaxis(
            self._by_joints @ self.by_tip_force[..., None, :, :], -3, -1)
        shape = change.shape
        return (self.inverse_mass @ change.reshape(
            *shape[:-2], shape[-2] * shape[-1])).reshape(shape)

    @geometric
    def mass_matrix_rates(self) -> np.ndarray:
        """∂M/∂𝔮 (..., 6+n, 6+n, 6+n) of real points, the last axis that of 𝔮.

        In the vehicle's axes M does not depend on its pose: only the joints' part is not zero.
        """
        rates = np.zeros((*self.config.shape, *self.config.shape[-1:] * 2))
        rates[..., 6:, :, :] = self._by_joints
        return np.moveaxis(rates, -3, -1)

    @cached_property
    def _by_joints(self) -> np.ndarray:
        """Derivatives ∂M/∂qⱼ (..., n, 6+n, 6+n) of real points."""
        return self.model.mass_matrix_rates(self.kinematics)

    @geometric
    def tip_jacobian(self) -> np.ndarray:
        """Rows J_𝔭 of J(𝔮) (..., 3, 6+n) for the velocity of the end-effector, 𝔭̇ = J_𝔭 ζ."""
        return self.kinematics.J_chi[..., :3, :]

    @geometric
    def tip_jacobian_rates(self) -> np.ndarray:
        """∂J_𝔭/∂𝔮 (..., 3, 6+n, 6+n) of real points, the last axis that of 𝔮.

        As the vehicle turns by ω, J_𝔭 turns with it: ω × its columns. A joint turns the columns
        beyond it likewise; those before it are ωᵢ × (𝔭 − pᵢ), and 𝔭 moves by the joint's column.
        """
        n, R_WB = self.model.num_joints, self.kinematics.R_WB
        columns = np.swapaxes(self.tip_jacobian, -1, -2)
        # Axes that the columns turn about, in Σ_I; none of a translation.
        axes = np.zeros_like(columns)
        axes[..., 3:6, :] = np.swapaxes(R_WB, -1, -2)
        axes[..., 6:, :] = np.where(self.model.slides[:, None], 0.0, self.kinematics.axis
                                    @ np.swapaxes(R_WB, -1, -2))
        # rates[j, i] = ∂ column i/∂qⱼ, that is ω_min × column_max of i and j.
        turned = cross(axes[..., :, None, :], columns[..., None, :, :])
        rates = np.zeros((*self.config.shape, *columns.shape[-2:]))
        first = np.arange(6, 6 + n)[:, None], np.arange(6 + n)
        rates[..., 6:, :, :] = turned[..., np.minimum(*first), np.maximum(*first), :]
        rates[..., 3:6, :, :] = np.einsum(
            "...kj,...kic->...jic", inverse_rate_matrix(self.config[..., 3:6]),
            turned[..., 3:6, :, :])
        return np.moveaxis(rates, (-3, -1), (-1, -3))

    @cached_property
    def tip_velocity_y(self) -> np.ndarray:
        """Derivative ∂𝔭̇/∂y (..., 3, 6+n) of 𝔭̇ = J_𝔭 ζ at a fixed ζ, of real points."""
        rates = self.tip_jacobian_rates.swapaxes(-1, -2) @ self.zeta[..., None, :, None]
        return rates[..., 0] @ self.config_y

    @cached_property
    def kinematics(self) -> Kinematics:
        """Geometry at the points."""
        if self.whole is not None:
            points, index = self.whole
            return Kinematics(*(item[index] for item in points.kinematics))
        return self.model.kinematics(self.config)

    @cached_property
    def tau(self) -> np.ndarray:
        """Generalised force τ = M(𝔮)𝔲 (..., 6+n) [N, N m]."""
        if self.forces is not UNKNOWN:
            return self.forces
        return (self.mass_matrix @ self.u[..., None])[..., 0]


class Slopes(NamedTuple):
    """Derivatives of m values by y, ζ and u, each (..., m, 6+n), or None where they are zero."""

    y: np.ndarray | None = None
    zeta: np.ndarray | None = None
    u: np.ndarray | None = None

    def through(self, chain: "Slopes") -> np.ndarray:
        """Returns the derivatives (..., m, w) by w variables, those of y, ζ and u in `chain`."""
        first, *others = (slope @ by for slope, by in zip(self, chain, strict=True)
                          if slope is not None and by is not None)
        return sum(others, first)


def slopes(values: Callable[[Points], np.ndarray], at: Points, about: About) -> Slopes:
    """Returns the derivatives of `values` (..., m), a function of complex points, by complex steps.

    Args:
        values: A function of points.
        at: The points.
        about: Arguments that `values` reads.
    """
    step = 1j * COMPLEX_STEP * np.eye(at.model.size)
    turned = 1j * COMPLEX_STEP * np.swapaxes(at.config_y, -1, -2)
    config, y, zeta, u = (each if each is UNKNOWN else np.repeat(each[..., None, :], len(step), -2)
                          for each in (at.config, at.y, at.zeta, at.u))

    def by(config: np.ndarray, y: np.ndarray, zeta: np.ndarray, u: np.ndarray) -> np.ndarray:
        moved = values(Points(at.model, config, y, zeta, u))
        return np.swapaxes(moved.imag / COMPLEX_STEP, -1, -2)

    return Slopes(by(config + turned, y + step, zeta, u),
                  by(config, y, zeta + step, u) if about != "pose" else None,
                  by(config, y, zeta, u + step) if about == "input" else None)


def check_slopes(name: str, values: Callable[[Points], np.ndarray], at: Points, about: About
                 ) -> None:
    """Raises unless the derivatives of `values` by complex steps and by differences agree.

    They do not where it takes an absolute value, a norm or a real part, or has a kink.

    Args:
        name: Name of the function, for the message.
        values: A function of points.
        at: Points.
        about: Arguments that `values` reads.

    Raises:
        TypeError: They do not agree, or there is no such kind of values.
    """
    if about not in get_args(About):
        raise TypeError(f"{name}: about = {about!r}: must be one of {', '.join(get_args(About))}")
    dy, dzeta, du = 1e-6 * np.cos(np.arange(3 * at.model.size)).reshape(3, -1)
    forward, backward = (values(Points(
        at.model, at.config + sign * at.config_y @ dy, at.y + sign * dy, at.zeta + sign * dzeta,
        at.u + sign * du)) for sign in (1.0, -1.0))
    if np.shape(forward)[:-1] != np.shape(at.y)[:-1]:
        raise TypeError(f"{name}: its values at points (...) must be an array (..., m)")
    chain = Slopes(dy[:, None], dzeta[:, None], du[:, None])
    change = slopes(values, at, about).through(chain)[..., 0]
    scale = 1e-6 + np.max(np.abs(forward), initial=0.0)
    error, tolerance = np.abs(0.5 * (forward - backward) - change), 1e-4 * np.abs(change)
    if not np.all(error <= tolerance + 1e-11 * scale):
        raise TypeError(f"{name}: its derivative by complex steps is not that of differences; "
                        "it must be smooth and allow for complex points, and about = "
                        f"{about!r} must be 'speed' if it reads ζ, 'input' if it reads u or τ")
