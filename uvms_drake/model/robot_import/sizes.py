"""Sizes of bodies by the shadows of their shapes, beside the volume that they displace.

Shapes in another unit (millimetres for metres), or out of place, are far from it. They are asked
about, and give their proportions alone.
"""

import numpy as np

from uvms_drake.model.robot_import.bodies import Body
from uvms_drake.model.robot_import.shapes import triangles_of
from uvms_drake.model.robot_import.tree import Notes

Size = tuple[np.ndarray, np.ndarray]
"""Least and largest corner (2, 3) [m] of a body; areas of its shadows along the axes (3,) [m²]."""
STRIPS = 40
"""Number of strips of a shadow, besides those between its corners."""
FITS = 3.0
"""Factor between the volume by shadows and the displaced one from which shapes are not believed; of
an open frame, or of a hull with wings, it is 2 to 3."""
DENSEST = 0.1
"""The same below, if the mass is all that is known: of a body of steel it is 0.13."""


def shadow(triangles: np.ndarray, axis: int) -> float:
    """Returns the area [m²] of the shadow of triangles (k, 3, 3) [m] in light along an axis.

    A line through the middle of a strip cuts triangles in intervals: their union is its length.
    """
    # Strips between corners of the triangles, and between lines of equal distances.
    u, v = np.moveaxis(np.delete(triangles, axis, axis=2), 2, 0)
    least, most = v.min(axis=1), v.max(axis=1)
    share, area = np.linspace(0.0, 1.0, STRIPS + 1), 0.0
    edges = np.unique([*np.quantile(np.unique(v), share, method="nearest"),
                       *(v.min() + share * np.ptp(v))])
    for at, width in zip(0.5 * (edges[1:] + edges[:-1]), np.diff(edges), strict=True):
        near = (least <= at) & (most >= at)
        U, V = u[near], v[near]
        with np.errstate(divide="ignore", invalid="ignore"):
            part = (at - V) / (np.roll(V, -1, axis=1) - V)
            cut = np.where((part >= 0.0) & (part <= 1.0),
                           U + part * (np.roll(U, -1, axis=1) - U), np.nan)
        intervals = np.stack([np.fmin.reduce(cut, axis=1), np.fmax.reduce(cut, axis=1)])
        low, high = intervals[:, np.argsort(intervals[0])]
        reached = np.fmax.accumulate(high)
        before = np.append(-np.inf, reached)[:-1]
        area += float(width * np.nansum(np.maximum(reached - np.maximum(low, before), 0.0)))
    return area


def size_by_shapes(body: Body) -> Size | None:
    """Returns the size by visuals of a body, or else by its collision shapes; None without any."""
    for shapes in (body.visuals, body.collisions):
        found = [each for shape in shapes if (each := triangles_of(shape)) is not None]
        if found:
            triangles = np.concatenate(found)
            return (np.array([triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))]),
                    np.array([shadow(triangles, axis) for axis in range(3)]))
    return None


def plausible_size(body: Body, density: float, notes: Notes) -> Size | None:
    """Returns the size by shapes for an estimate, and asks if it is not of the displaced volume.

    Args:
        body: With its displaced volume, or else its mass.
        density: Of the water [kg/m³].
        notes: Ask about shapes.
    """
    if (size := size_by_shapes(body)) is None:
        return None
    # Of a box √(A_x A_y A_z) is its volume, and of no body less (Loomis and Whitney).
    (box, areas), volume = size, body.volume or body.mass / density
    shadows = float(np.sqrt(np.prod(areas)))
    ratio = shadows / volume if volume > 0.0 < shadows else 1.0
    if (1.0 / FITS if body.volume else DENSEST) <= ratio <= FITS:
        return size
    edges = " × ".join(f"{edge:.3g}" for edge in np.ptp(box, axis=0))
    question = (f"the shapes of '{body.name}' in your file, scale: {edges} m, by their shadows "
                f"{shadows:.3g} m³, which is {ratio:.2g} times the {volume:.3g} m³ of water "
                "that it displaces, or weighs (10⁹ times if millimetres are read as metres). "
                "ESTIMATE: their proportions, with the size of that volume")
    notes.asked += [question] if question not in notes.asked else []
    return ratio ** (-1.0 / 3.0) * box, ratio ** (-2.0 / 3.0) * areas
