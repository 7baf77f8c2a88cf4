"""Robots' files of tests, and the kinematics and masses of a URDF in plain NumPy."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from support.robot_reading import NAMES as NUMBERS
from support.robot_reading import inertia_of, numbers, origin, skew

FILES = Path(__file__).parents[1] / "robot_files"
NAMES = sorted(path.name for path in FILES.iterdir() if path.suffix in (".urdf", ".sdf"))
FLIP = np.diag([1.0, -1.0, -1.0])
"""From z up to FRD."""


def turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """Returns the rotation (3, 3) about an axis, as a matrix exponential by its series."""
    S = skew(angle * np.asarray(axis) / np.linalg.norm(axis))
    out = term = np.eye(3)
    for k in range(1, 40):
        term = term @ S / k
        out = out + term
    return out


class PlainUrdf:
    """A URDF as poses, masses and inertias, at given values of its joints.

    Args:
        file: Its path.
        values: Of joints by name [rad, m]; the others are at zero.
    """

    def __init__(self, file: Path, values: dict[str, float]):
        robot = ET.parse(file).getroot()
        self.links = {link.get("name"): link for link in robot.findall("link")}
        self.joints = {joint.get("name"): joint for joint in robot.findall("joint")}
        self.pose: dict[str, np.ndarray] = {}
        """Poses (4, 4) of links in the root's frame."""
        children = {joint.find("child").get("link") for joint in self.joints.values()}
        for root in set(self.links) - children:
            self._place(root, np.eye(4), values)

    def _place(self, link: str, X: np.ndarray, values: dict[str, float]) -> None:
        self.pose[link] = X
        for name, joint in self.joints.items():
            if joint.find("parent").get("link") == link:
                X_J, axis = X @ origin(joint), joint.find("axis")
                if axis is not None and joint.get("type") != "prismatic":
                    X_J[:3, :3] @= turn(numbers(axis.get("xyz"), 3), values.get(name, 0.0))
                self._place(joint.find("child").get("link"), X_J, values)

    def inertia_about(self, base: str) -> np.ndarray:
        """Returns the 6×6 inertia of all links about a link's origin, in its axes turned to FRD."""
        total = np.zeros((6, 6))
        for name, link in self.links.items():
            if (inertial := link.find("inertial")) is not None:
                X = self.in_frd(base, name) @ origin(inertial)
                m, S = float(inertial.find("mass").get("value")), skew(X[:3, 3])
                inertia = inertial.find("inertia")
                central = inertia_of([float(inertia.get(key, 0.0)) for key in NUMBERS], X[:3, :3])
                total += np.block([[m * np.eye(3), -m * S], [m * S, central - m * S @ S]])
        return total

    def in_frd(self, base: str, link: str) -> np.ndarray:
        """Returns the pose (4, 4) of a link in the frame of another one, turned to FRD."""
        turned = self.pose[base].copy()
        turned[:3, :3] @= FLIP
        return np.linalg.inv(turned) @ self.pose[link]
