"""The surface, the forces on it as arrows and numbers, and the contact."""

from collections.abc import Callable

import numpy as np
from pydrake.geometry import Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from uvms_drake.model.surface.law import Surface
from uvms_drake.visual.objects.patch import draw_patch
from uvms_drake.visual.objects.props import GLASS, PLAN, REAL, Arrow, Mark, Polyline
from uvms_drake.visual.objects.readout import Readout
from uvms_drake.visual.objects.wall import DrawnWall
from uvms_drake.visual.stage import NED, Stage, frame_at

SPRING, CONTACT = Rgba(0.3, 0.3, 0.3), Rgba(1.0, 0.9, 0.2)
REAL_TEXT = (1.0, 0.62, 0.42)
ARROW = 0.3
"""Length of the arrow of the largest force expected, as a fraction of the scene's size."""
NUMBER_OFFSET = 0.07
"""Distance of the numbers from the end of the arrow, likewise."""
HEIGHT = 0.075
"""Height of a line of the numbers, likewise."""


class Pressing:
    """The surface and the forces on it.

    Args:
        stage: Stage to draw on.
        law: The surface, as the controller knows it.
        goal: Desired position of the end-effector (3,) [m].
        force: 𝔉_des of the task (6,) [N, N m].
        unit: The scene's size [m].
        facing: Attitude of the numbers, in Meshcat's axes.
    """

    def __init__(self, stage: Stage, law: Surface, goal: np.ndarray, force: np.ndarray,
                 unit: float, facing: RotationMatrix):
        self._stage, self._law, self._unit = stage, law, unit
        self._facing = facing
        largest = max(float(np.linalg.norm(force[:3])),
                      float(law.static_force(np.array([*goal, 0.0, 0.0, 0.0]))))
        self._newton = ARROW * unit / (largest or 1.0)
        self._show_surface = self._draw_surface(goal)
        self._force = Arrow(stage, f"{NED}/force", 0.016 * unit, REAL)
        self._desired = Arrow(stage, f"{NED}/desired_force", 0.024 * unit, GLASS)
        self._contact = Mark(stage, f"{NED}/contact", CONTACT, 0.017 * unit)
        stage.meshcat.SetTransform("numbers", RigidTransform(facing, np.zeros(3)))
        highest = max(2.0 * largest, 40.0)
        self._numbers = [
            Readout(stage, f"numbers/{name}", "", f" N {name}", highest, HEIGHT * unit, color,
                    tenths=False)
            for name, color in (("real", REAL_TEXT), ("desired", (1.0, 1.0, 1.0)))]

    def _draw_surface(self, goal: np.ndarray) -> Callable[[np.ndarray], None]:
        """Draws the surface; returns the function that shows its deformation by the tip at χ."""
        stage, law, rest_point, normal = self._stage, self._law, self._law.anchor, self._law.normal
        if normal is not None:
            wall = DrawnWall(stage, f"{NED}/wall", goal - ((goal - rest_point) @ normal) * normal,
                             normal)
            return lambda chi: wall.show(float(law.penetration(chi)))
        points = law.patch(goal, DrawnWall.SIZE, DrawnWall.MESH + 1)
        if points is not None:
            draw_patch(stage, f"{NED}/wall", points)
            return lambda chi: None
        stage.make(f"{NED}/rest", Sphere(0.02), PLAN, frame_at(rest_point))
        spring = Polyline(stage, f"{NED}/spring", 2, SPRING, 0.01)
        return lambda chi: spring.show(np.array([rest_point, chi[:3]]))

    def show(self, chi: np.ndarray, force: np.ndarray | None, desired: np.ndarray) -> None:
        """Draws surface and forces with the end-effector at χ.

        Args:
            chi: Pose χ of the end-effector (6,).
            force: 𝔉 (6,) [N, N m]; None: the force of the surface's law at the pose at rest.
            desired: 𝔉_des (6,).
        """
        tip = chi[:3]
        real = (self._law.force(chi, np.zeros(6)) if force is None else force)[:3]
        wanted = desired[:3]
        self._show_surface(chi)
        self._force.show(tip, self._newton * real)
        self._desired.show(tip, self._newton * wanted)
        self._contact.show(tip if np.any(real) else None)
        longest = max(real, wanted, key=np.linalg.norm)
        length = float(np.linalg.norm(longest)) or 1.0
        beyond = tip + (self._newton + NUMBER_OFFSET * self._unit / length) * longest
        place = self._facing.inverse() @ (beyond * [1.0, -1.0, -1.0])
        for number, value, line in zip(self._numbers, (real, wanted), (0.55, -0.55), strict=True):
            number.show(float(np.linalg.norm(value)),
                        place + [0.0, 0.0, line * HEIGHT * self._unit])
