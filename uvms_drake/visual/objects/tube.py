"""The tube at the tip, to scale and enlarged."""

import math

import numpy as np
from pydrake.geometry import Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from uvms_drake.visual.objects.props import PLAN, REAL
from uvms_drake.visual.stage import Stage, frame_at
from uvms_drake.visual.textured import label


class DrawnTube:
    """The tube at the tip to scale, and enlarged in an inset with the real tip in it.

    Args:
        stage: Stage to draw on.
        path: Path of the tube on the stage, in Σ_I.
        inset: Path of the inset, in Meshcat's own axes; its text is at the origin, all else below.
        radius: Radius of the tube in position [m].
        magnification: Magnification of the inset.
        text: Caption of the inset.
        height: Height of a line of the text [m].
        facing: Attitude of the text.
    """

    def __init__(self, stage: Stage, path: str, inset: str, radius: float, magnification: float,
                 text: str, height: float, facing: RotationMatrix):
        self._stage, self._path, self._inset = stage, path, inset
        self._magnification = magnification
        stage.make(f"{path}/scale", Sphere(radius), Rgba(1.0, 1.0, 1.0, 0.2))
        large = radius * magnification
        self._middle = np.array([0.0, 0.0, -large - height * (1 + text.count("\n"))])
        stage.make(f"{inset}/tube", Sphere(large), Rgba(1.0, 1.0, 1.0, 0.22),
                   frame_at(self._middle))
        stage.make(f"{inset}/nominal", Sphere(0.16 * height), PLAN, frame_at(self._middle))
        stage.make(f"{inset}/real/dot", Sphere(0.22 * height), REAL)
        stage.make(f"{inset}/text", label(text, height), None, RigidTransform(facing, np.zeros(3)))

    def show(self, tip: np.ndarray, nominal_tip: np.ndarray) -> None:
        """Draws the tube about the nominal tip (3,) and the real one (3,) in it, both in Σ_I."""
        self._stage.move(self._path, frame_at(nominal_tip))
        deviation = self._magnification * (tip - nominal_tip) * [1.0, -1.0, -1.0]
        self._stage.move(f"{self._inset}/real", frame_at(self._middle + deviation))


def round_magnification(radius: float, wanted: float) -> float:
    """Returns 1, 2, 5, 10, 20, ... such that `radius` times it is at most about `wanted`."""
    if radius <= 0.0 or radius >= wanted:
        return 1.0
    exponent = math.floor(math.log10(wanted / radius))
    return max(step * 10.0**exponent for step in (1.0, 2.0, 5.0)
               if step * 10.0**exponent <= 1.25 * wanted / radius)
