"""Effect of the errors of a force sensor on the radii of the law `resolved`; see `sensor_error`."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from uvms_drake.tube.search.estimate import Check, no_estimates


@dataclass(frozen=True)
class SensorEffect:
    """Contribution of the errors of a sensor to the radii of the law `resolved`."""

    depth: float = 0.0
    """|n·𝔢_p| [m]."""
    depth_speed: float = 0.0
    """|n·𝔢̇_p| [m/s]."""
    position: float = 0.0
    """‖𝔢_p‖ [m]."""
    orientation: float = 0.0
    """‖𝔢_o‖ [rad]."""
    tip_speed: float = 0.0
    """‖𝔢̇_p‖ [m/s]."""
    r: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """𝔯 of ν₁ [m/s], ν₂ and q̇ [rad/s] (3,), 2-norms; as the next two."""
    p: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """𝔭₀ = J_x⁻¹𝔢_y, were J_x to stand still (3,) [m, rad]; its last is ‖𝔢_q‖."""
    z: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """𝔯 − σ𝔭₀, the linear part of ζ − ζ̄ (3,) [m/s, rad/s]."""
    u: np.ndarray | float = 0.0
    """The linear part of uᵢ − ūᵢ, with the error of the reading (6+n,) [m/s² (3), rad/s² (3+n)]."""
    w: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """The same of the blocks of ν₁, ν₂ and q̇ (3,), 2-norms."""
    depth_by_force: float = 0.0
    """‖A_f‖ of the row of n·𝔭̈ [1/kg]."""
    depth_by_normal: float = 0.0
    """|A_f n| of it [1/kg]."""
    turning: float = 0.0
    """ω, angular speed of the tip's axes [rad/s]."""
    jacobian_rate: float = np.inf
    """J̃, bound of ‖J̇_b‖ of the tip's position [1/s]."""
    proven: bool = False
    """Whether all of it is proven but `u` and `w`."""
    check: Check = no_estimates
    """Function that returns the estimates it rests on."""
    budget: dict[str, dict[str, float]] = field(default_factory=dict)
    """Parts of `depth`, `position` [m] and `depth_speed` [m/s] by their source."""
    of_others: Callable[[Any, float, float], "SensorEffect"] | None = None
    """Function that returns the effect of other `MeasuredForceBounds`, of the same lag and period,
    at bounds of ‖ν₂‖ and ‖q̇‖ [rad/s], by the same suprema."""
