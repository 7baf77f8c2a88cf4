"""Robots' files of tests, and the kinematics and masses of a URDF in plain NumPy."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

FILES = Path(__file__).parents[1] / "robot_files"
NAMES = sorted(path.name for path in FILES.iterdir() if path.suffix in (".urdf", ".sdf"))
FLIP = np.diag([1.0, -1.0, -1.0])
"""From z up to FRD."""


def rotation(rpy: np.ndarray) -> np.ndarray:
    """Returns Rz(yaw) Ry(pitch) Rx(roll), a product of three."""
    out = np.eye(3)
    for angle, (i, j) in zip(rpy, ((1, 2), (2, 0), (0, 1)), strict=True):
        R = np.eye(3)
        R[i, i] = R[j, j] = np.cos(angle)
        R[i, j], R[j, i] = -np.sin(angle), np.sin(angle)
        out = R @ out
    return out


def turn(axis: np.ndarray, angle: float) -> np.ndarray:
    """Returns the rotation about an axis, as a matrix exponential by its series."""
    x, y, z = angle * np.asarray(axis) / np.linalg.norm(axis)
    S = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
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
        self.pose: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        """Attitude and position of links in the root's frame."""
        children = {joint.find("child").get("link") for joint in self.joints.values()}
        for root in set(self.links) - children:
            self._place(root, np.eye(3), np.zeros(3), values)

    def _place(self, link: str, R: np.ndarray, p: np.ndarray, values: dict[str, float]) -> None:
        self.pose[link] = R, p
        for name, joint in self.joints.items():
            if joint.find("parent").get("link") != link:
                continue
            xyz, rpy = origin(joint)
            R_J, p_J = R @ rotation(rpy), p + R @ xyz
            axis = joint.find("axis")
            if axis is not None and joint.get("type") != "prismatic":
                R_J = R_J @ turn(numbers(axis.get("xyz")), values.get(name, 0.0))
            self._place(joint.find("child").get("link"), R_J, p_J, values)

    def inertia_about(self, base: str) -> np.ndarray:
        """Returns the 6×6 inertia of all links about a link's origin, in its axes turned to FRD."""
        R_B, p_B = self.pose[base]
        R_B = R_B @ FLIP
        total = np.zeros((6, 6))
        for name, link in self.links.items():
            inertial = link.find("inertial")
            if inertial is None:
                continue
            R, p = self.pose[name]
            xyz, rpy = origin(inertial)
            m = float(inertial.find("mass").get("value"))
            c = R_B.T @ (p + R @ xyz - p_B)
            R_C = R_B.T @ R @ rotation(rpy)
            entries = {key: float(value) for key, value in inertial.find("inertia").items()}
            central = np.array([[entries[f"i{min(a, b)}{max(a, b)}"] for b in "xyz"]
                                for a in "xyz"])
            S = np.array([[0.0, -c[2], c[1]], [c[2], 0.0, -c[0]], [-c[1], c[0], 0.0]])
            total += np.block([[m * np.eye(3), -m * S],
                               [m * S, R_C @ central @ R_C.T - m * S @ S]])
        return total

    def in_frd(self, base: str, link: str) -> tuple[np.ndarray, np.ndarray]:
        """Returns attitude and position of a link in the frame of another one, turned to FRD."""
        (R_B, p_B), (R, p) = self.pose[base], self.pose[link]
        return (R_B @ FLIP).T @ R, (R_B @ FLIP).T @ (p - p_B)


def numbers(text: str) -> np.ndarray:
    """Returns the numbers of a text."""
    return np.array(text.split(), dtype=float)


def origin(element: ET.Element) -> tuple[np.ndarray, np.ndarray]:
    """Returns xyz and rpy of an element's origin; zeros without one."""
    node = element.find("origin")
    return tuple(numbers("0 0 0" if node is None else node.get(key, "0 0 0"))
                 for key in ("xyz", "rpy"))
