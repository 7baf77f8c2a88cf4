"""Shapes and surfaces that are put together, turned and moved, for several tests."""

import numpy as np

from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.surface.contact_laws import Bilinear, Hardening, Linear
from uvms_drake.model.surface.geometry import Bead, Bumpy, Cylinder, Plane
from uvms_drake.model.surface.shaped_surface import ShapedSurface

R = rotation_matrix(np.array([0.7, -0.4, 2.1]))
SHIFT = np.array([2.0, -0.3, 1.1])
SHAPES = {
    "plane": Plane(), "pole": Cylinder(radius=0.3), "pipe": Cylinder(radius=0.45, inside=True),
    "bumpy": Bumpy(amplitude=0.01, wavelength=0.15, seed=3),
    "bead": Bead(height=0.002, width=0.2)}
LAWS = {
    "linear": Linear(830.0, 0.003), "bilinear": Bilinear(900.0, 0.002, 3.0, 0.008),
    "yielding": Bilinear(900.0, 0.002, 0.25, 0.008),
    "hardening": Hardening(700.0, 0.002, 6.0, 0.03)}


def turned(shape):
    """Returns a shape in no special place."""
    return shape.moved(R, SHIFT)


def surfaces(**settings):
    """Returns every shape with every law, in no special place."""
    return {f"{name} {kind}": ShapedSurface(turned(shape), law, **settings)
            for name, shape in SHAPES.items() for kind, law in LAWS.items()}


def near(shape, count, rng, depths=(-0.01, 0.03), half=0.1):
    """Returns positions (count, 3) close to the surface, near its point."""
    return shape.point_at(rng.uniform(-half, half, (count, 2)), rng.uniform(*depths, count))


def in_ball_of(center, reach, count, rng):
    """Returns positions (count, 3) within a distance of a point."""
    x = rng.normal(size=(count, 3))
    x *= rng.uniform(size=(count, 1))**(1.0 / 3.0) / np.linalg.norm(x, axis=1, keepdims=True)
    return center + reach * x
