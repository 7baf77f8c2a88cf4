"""A run as an animation in one HTML file that needs no server."""

from pathlib import Path
from typing import cast

import numpy as np
from pydrake.geometry import Box, Meshcat, MeshcatVisualizer, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from uvms_drake.model.contact import UnilateralPlane
from uvms_drake.plant.uvms_plant import MESHCAT_NED, make_uvms_plant, set_state
from uvms_drake.record import Record
from uvms_drake.scenario import Scenario

FRAME_RATE = 25.0  # 1/s
WALL_SIZE = (0.02, 0.7, 1.0)  # m, thickness first
WALL_COLOR = Rgba(0.55, 0.6, 0.65, 0.5)
WATER_COLOR = {"top_color": [0.55, 0.75, 0.85], "bottom_color": [0.05, 0.22, 0.34]}
NOMINAL_COLOR = Rgba(0.9, 0.62, 0.0, 0.9)
NOMINAL_PATH = f"{MESHCAT_NED}/nominal_tip"


def draw_scene(meshcat: Meshcat, scenario: Scenario) -> None:
    """Draws what stands still, in Σ_I: the wall, if there is one; and places the camera."""
    for part, color in WATER_COLOR.items():
        meshcat.SetProperty("/Background", part, color)
    for path in ("/Grid", "/Axes"):
        meshcat.SetProperty(path, "visible", False)
    surface = scenario.surface
    if isinstance(surface, UnilateralPlane):
        normal = np.asarray(surface.normal, dtype=float)
        R_WS = RotationMatrix.MakeFromOneVector(normal, 0)
        meshcat.SetObject(f"{MESHCAT_NED}/wall", Box(*WALL_SIZE), WALL_COLOR)
        meshcat.SetTransform(f"{MESHCAT_NED}/wall", RigidTransform(
            R_WS, surface.point - 0.5 * WALL_SIZE[0] * normal))
    # Meshcat's axes are Σ_I turned by π about x.
    target = scenario.start.eta[:3] * [1.0, -1.0, -1.0] + [0.75, 0.0, -0.1]
    meshcat.SetCameraPose(target + np.array([-0.35, -1.9, 0.45]), target)


def write_replay(record: Record, path: Path) -> None:
    """Writes the robot, the wall and the nominal end-effector (a sphere) as a recording."""
    scenario = record.scenario
    meshcat = Meshcat()
    draw_scene(meshcat, scenario)
    meshcat.SetObject(NOMINAL_PATH, Sphere(0.015), NOMINAL_COLOR)
    uvms = make_uvms_plant(model=scenario.model, surface=scenario.surface,
                           disturbance=scenario.disturbance, meshcat=meshcat)
    visualizer = cast(MeshcatVisualizer, uvms.GetSubsystemByName("meshcat"))
    context = uvms.CreateDefaultContext()
    visualizer.StartRecording()
    for i in frame_indices(record.time):
        context.SetTime(record.time[i])
        set_state(uvms, context, record.state[i])
        uvms.ForcedPublish(context)
        meshcat.SetTransform(NOMINAL_PATH, RigidTransform(record.chi_nominal[i, :3]),
                             time_in_recording=record.time[i])
    visualizer.StopRecording()
    visualizer.PublishRecording()
    path.write_text(meshcat.StaticHtml(), encoding="utf-8")


def frame_indices(time: np.ndarray) -> np.ndarray:
    """Returns the samples of `time` (T,) [s] to show, at most `FRAME_RATE` in a second."""
    frames = np.floor(time * FRAME_RATE + 1e-9)
    return np.flatnonzero(np.diff(frames, prepend=-1.0) > 0.0)
