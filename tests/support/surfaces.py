"""A plane, a spring and a user-defined surface, and operations on them for several tests."""

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.surface.law import Surface, check_surface
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.surface.spring import BilateralSpring

STIFFNESS, DISSIPATION, TRANSITION = 830.0, 1.7, 0.003  # N/m, s/m, m
NORMALS = [np.array([-1.0, 0.0, 0.0]),
           rotation_matrix(np.array([0.7, -0.4, 2.1])) @ np.array([-1.0, 0.0, 0.0])]
AT_REST = np.zeros(6)


def plane(normal=NORMALS[1], dissipation=DISSIPATION, point=(2.0, -0.3, 1.1)):
    return check_surface(UnilateralPlane(
        np.array(point), normal, STIFFNESS, dissipation, TRANSITION))


def stiffness_matrix():
    A = np.random.default_rng(0).normal(size=(6, 6))
    return A @ A.T + np.eye(6)


def spring():
    return check_surface(BilateralSpring(
        stiffness_matrix(), np.array([0.4, -0.2, 1.3, 0.1, -0.3, 0.7])))


def tip_at(law, depth, rng=None):
    """Returns χ at a depth in a plane, anywhere along the plane."""
    tangent = np.zeros(3) if rng is None else rng.normal(size=3)
    tangent -= law.normal * (tangent @ law.normal)
    rpy = np.array([0.3, -0.2, 0.5]) if rng is None else rng.uniform(-1.4, 1.4, 3)
    return np.concatenate([law.point + tangent - depth * law.normal, rpy])


def moving(law, rate):
    """Returns χ̇ that enters a plane at `rate` while it slides and turns."""
    tangent = np.cross(law.normal, [0.2, -0.7, 0.4])
    return np.concatenate([-rate * law.normal + tangent, [0.4, -0.9, 1.1]])


class Sphere(Surface):
    """A ball of rubber that pushes along its radius: a surface of one's own."""

    def __init__(self, radius=np.sqrt, stiffness=500.0):
        self.radius, self.stiffness = radius, stiffness

    @property
    def anchor(self):
        return np.array([-1.0, 0.0, 0.0])

    def checked(self):
        require(self.stiffness > 0.0, "stiffness", self.stiffness, "positive")
        return self

    def force(self, chi, chi_dot):
        p = chi[..., :3]
        distance = self.radius(np.sum(p * p, axis=-1))
        push = self.stiffness * np.where(distance.real < 1.0, 1.0 - distance, 0.0)
        return np.concatenate([-push[..., None] * p, np.zeros_like(p)], axis=-1)

    def penetration(self, chi):
        return np.maximum(1.0 - np.linalg.norm(chi[..., :3], axis=-1), 0.0)

    def force_jacobian(self):
        return self.stiffness * np.eye(3, 6)
