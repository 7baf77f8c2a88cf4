"""A robot in one HTML file: each joint goes through its limits, with frames, centres, thrusters."""

from pathlib import Path

import numpy as np
from pydrake.geometry import Cylinder, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.trim import trim_of
from uvms_drake.model.uvms import Uvms
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.visual.objects import Arrow, DrawnRobot
from uvms_drake.visual.stage import NED, Stage, frame_at, open_meshcat

RATE = 20.0
"""Pictures in a second."""
SWEEP = 3.0
"""Time of a joint from the posture to both limits and back [s]."""
AXES = {"x": Rgba(0.0, 0.45, 0.70, 1.0), "y": Rgba(0.84, 0.37, 0.0, 1.0),
        "z": Rgba(0.0, 0.62, 0.45, 1.0)}
CENTERS = {"mass": Rgba(0.84, 0.37, 0.0, 1.0), "buoyancy": Rgba(0.0, 0.45, 0.70, 1.0)}
THRUST = Rgba(0.9, 0.9, 0.2, 1.0)


def write_page(uvms: Uvms, model: str, posture: np.ndarray, path: Path) -> None:
    """Writes the page.

    Args:
        uvms: The robot, in a finalized plant.
        model: Name of a shipped robot, or a robot's folder.
        posture: Joint angles (n,) [rad] from which the joints start.
        path: Of the file.
    """
    meshcat, chain = open_meshcat(), UvmsModel(uvms)
    scene = _Scene(Stage(meshcat), uvms, model, chain)
    meshcat.StartRecording(frames_per_second=RATE, set_visualizations_while_recording=False)
    for i, angles in enumerate(sweeps(posture, chain.q_lower, chain.q_upper)):
        scene.show(angles, i / RATE)
    meshcat.StopRecording()
    meshcat.PublishRecording()
    meshcat.SetProperty("/Grid", "visible", False)
    meshcat.SetProperty("/Axes", "visible", False)
    eye = np.array([0.95, -1.1, 0.65]) * scene.size
    meshcat.SetCameraPose(eye + scene.middle, scene.middle)
    path.write_text(meshcat.StaticHtml(), encoding="utf-8")


def sweeps(posture: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Returns postures (T, n): one joint after the other to both its limits and back.

    A joint without limits turns by half a turn either way.
    """
    phase = 2.0 * np.pi * np.arange(int(SWEEP * RATE)) / (SWEEP * RATE)
    frames = [posture]
    for joint, angle in enumerate(posture):
        down = np.sin(phase) < 0.0
        margin = np.where(down, angle - max(lower[joint], angle - np.pi),
                        min(upper[joint], angle + np.pi) - angle)
        moved = np.tile(posture, (len(phase), 1))
        moved[:, joint] += margin * np.sin(phase)
        frames += list(moved)
    return np.array([*frames, posture])


class _Scene:
    """The robot at the origin, level, and the objects drawn with it."""

    def __init__(self, stage: Stage, uvms: Uvms, model: str, chain: UvmsModel):
        self._stage, self._uvms, self._chain = stage, uvms, chain
        self._robot = DrawnRobot(stage, "robot", model)
        corners = np.abs(chain.task_pose(np.zeros(chain.size))[:3])
        self.size = float(max(0.6, np.max(corners)))
        self.middle = np.array([0.2 * self.size, 0.0, -0.1 * self.size])
        for frame, length in (("vehicle", 0.35), ("tip", 0.2)):
            for i, (name, color) in enumerate(AXES.items()):
                path = f"{NED}/{frame}/{name}"
                axis = RotationMatrix.MakeFromOneVector(np.eye(3)[i], 2)
                stage.make(path, Cylinder(0.006 * self.size, length * self.size), color,
                           RigidTransform(axis, 0.5 * length * self.size * np.eye(3)[i]))
                stage.see_through(path)
        for name, color in CENTERS.items():
            stage.make(f"{NED}/centres/{name}/ball", Sphere(0.02 * self.size), color)
            stage.see_through(f"{NED}/centres/{name}/ball", order=2.0)
        if uvms.thrusters is not None:
            self._draw_thrusters(ThrusterModel.of(uvms.thrusters),
                                 [item.position for item in uvms.thrusters.thrusters.values()])

    def _draw_thrusters(self, thrusters: ThrusterModel, places: list[np.ndarray]) -> None:
        """Draws where each pushes to, as long as its largest force."""
        length = 0.35 * self.size / float(np.max(thrusters.upper))
        for name, place, B, force in zip(thrusters.names, places, thrusters.B.T, thrusters.upper,
                                         strict=True):
            Arrow(self._stage, f"{NED}/thrusters/{name}", 0.006 * self.size, THRUST).show(
                np.asarray(place), length * force * B[:3])

    def show(self, posture: np.ndarray, time: float) -> None:
        """Draws the robot in a posture."""
        self._stage.begin(time)
        config = np.concatenate([np.zeros(6), posture])
        self._robot.show(config)
        at, trim = self._chain.kinematics(config), trim_of(self._uvms, posture)
        self._stage.move(f"{NED}/tip", RigidTransform(RotationMatrix(at.R_BL[-1]), at.p_BL[-1]))
        self._stage.move(f"{NED}/centres/mass", frame_at(trim.center_of_mass))
        self._stage.move(f"{NED}/centres/buoyancy", frame_at(trim.center_of_buoyancy))
