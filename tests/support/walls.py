"""Walls of a `SurfaceClass`, constructed without its inequality."""

from typing import NamedTuple

import numpy as np

from uvms_drake.model.surface.surface_class import SurfaceClass


def random_direction(rng: np.random.Generator) -> np.ndarray:
    direction = rng.normal(size=3)
    return direction / np.linalg.norm(direction)


def rotated_from_x(direction: np.ndarray) -> np.ndarray:
    """A rotation whose first column is `direction`."""
    others = np.eye(3)[np.argsort(np.abs(direction))[:2]]
    Q, R = np.linalg.qr(np.column_stack([direction, *others]))
    return Q * np.sign(R[0, 0])


class Wall(NamedTuple):
    """A ball or a half-space of a material that is soft up to `knee` and stiff from there on."""

    point: np.ndarray
    normal: np.ndarray
    """Unit vector into the wall, at the contact."""
    radius: float
    """Radius of a ball with its centre inside the wall; inf: a half-space."""
    soft: float
    stiff: float
    knee: float

    def depth(self, p: np.ndarray) -> np.ndarray:
        if np.isinf(self.radius):
            return (p - self.point) @ self.normal
        centre = self.point + self.radius * self.normal
        return self.radius - np.linalg.norm(p - centre, axis=-1)

    def static(self, p: np.ndarray) -> np.ndarray:
        depth = self.depth(p)
        return (self.soft * np.clip(depth, 0.0, self.knee)
                + self.stiff * np.maximum(depth - self.knee, 0.0))


def random_walls(surface: SurfaceClass, rng: np.random.Generator, count: int) -> list[Wall]:
    """Walls through the origin's neighbourhood of ± 2 cm, in all of the class's angles."""
    R = rotated_from_x(surface.direction)
    walls = []
    for i in range(count):
        curved = i % 2 == 1
        # The normal of a ball turns by 8 cm over its radius; the tip keeps within 4 cm.
        radius = 0.08 / (0.4 * np.sin(surface.angle)) if curved else np.inf
        tilt = surface.angle * (rng.uniform(0.0, 0.4) if curved else rng.uniform())
        around = rng.uniform(0.0, 2.0 * np.pi)
        normal = R @ [np.cos(tilt), np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around)]
        soft, stiff = surface.stiffness * rng.uniform(0.1, 1.0, 2)
        walls.append(Wall(rng.uniform(-0.005, 0.005, 3), normal, radius, soft, stiff,
                          rng.uniform(0.0, 0.005)))
    return walls
