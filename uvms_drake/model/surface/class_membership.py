"""Class membership of a surface: bounds that hold in a ball about a point of it."""

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.model.surface.geometry.geometry import Geometry
from uvms_drake.model.surface.normal_law import Linear
from uvms_drake.model.surface.surface_class import SurfaceClass


def class_of(geometry: Geometry, law: Linear, dissipation: float, friction: float,
             direction: np.ndarray, center: np.ndarray, reach: float) -> SurfaceClass:
    """Returns the class of a surface within `reach` [m] of `center` (3,).

    Its bounds are (3) of `model/surface/theory.md#class-of-a-shaped-surface`.

    Args:
        geometry: The shape.
        law: The static force by the depth.
        dissipation: c [s/m].
        friction: μ.
        direction: Unit vector n (3,) into the surface.
        center: Centre of the ball (3,) [m].
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
        direction=direction,
        stiffness=most * spread.stretch**2 + force * spread.bend,
        least_stiffness=max(least - force * spread.bend, 0.0) * float(np.cos(angle)),
        angle=angle, dissipation=dissipation * spread.stretch, friction=friction)
