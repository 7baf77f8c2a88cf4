"""What a controller may be told of a surface that it does not know: bounds that hold in a ball."""

from typing import NamedTuple

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.model.surface.geometry.geometry import Geometry
from uvms_drake.model.surface.normal_law import Linear


class SurfaceClass(NamedTuple):
    """Bounds of a surface, whatever its shape and its law are.

    With φ(p) the size of the static force and n a direction, for all p and p′ in the ball

        φ(p′) ≤ φ(p) + κ₊ (n·(p′ − p) + tan α ‖P_t(p′ − p)‖)₊,   P_t = I − nnᵀ,

    which is so if ∇φ is in a cone of half-angle α about n, and n·∇φ ≤ κ₊.
    """

    stiffness: float
    """κ₊ [N/m]."""
    least_stiffness: float
    """κ₋ [N/m]: n·∇φ is at least that past the transition."""
    angle: float
    """α, below π/2 [rad]."""
    dissipation: float
    """c₊ [s/m]: in motion the normal force is at least φ (1 + c₊δ̇)₊, δ̇ the speed along its normal,
    and on the way in at most that."""
    friction: float
    """Coefficient μ: the force along the surface is at most μ times the normal force."""


def class_of(geometry: Geometry, law: Linear, dissipation: float, friction: float,
             direction: np.ndarray, center: np.ndarray, reach: float) -> SurfaceClass:
    """Returns the class of a surface within `reach` [m] of `center` (3,).

    φ = f‖∇δ‖ with f(δ) the law's, so ∇φ = f′‖∇δ‖∇δ + f∇‖∇δ‖: a part along ∇δ of at least f′, and
    another of at most f‖∇‖∇δ‖‖, which turns it by no more than asin(f/f′ ‖∇‖∇δ‖‖). While the slope
    grows, f/f′ ≤ δ; where it falls from k on, f ≤ kδ, and f/f′ ≤ δ times k over the smallest slope.

    Args:
        geometry: The shape.
        law: The static force by the depth.
        dissipation: c [s/m].
        friction: μ.
        direction: Unit vector n (3,) into the surface.
        center: Middle of the ball (3,) [m].
        reach: Radius of the ball [m].

    Raises:
        InvalidParameter: The normal turns away from `direction` by π/2 or more.
    """
    spread = geometry.spread(direction, center, reach)
    deepest = geometry.depth(center) + spread.stretch * reach
    force, (least, most) = float(law.force(deepest)), law.slopes
    turn = spread.bend * max(float(deepest), 0.0) * law.stiffness / least
    angle = spread.angle + float(np.arcsin(min(turn, 1.0)))
    require(angle < 0.5 * np.pi, "reach", reach,
            "so short that the surface's normal stays within 90° of the direction")
    return SurfaceClass(
        stiffness=most * spread.stretch**2 + force * spread.bend,
        least_stiffness=max(least - force * spread.bend, 0.0) * float(np.cos(angle)),
        angle=angle, dissipation=dissipation * spread.stretch, friction=friction)
