"""The picture of a run, live and recorded by the same code."""

from dataclasses import dataclass

import numpy as np
from pydrake.geometry import Meshcat, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from uvms_drake.model.euler import pose_difference
from uvms_drake.model.surface.law import Surface
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.visual.config import VisualConfig
from uvms_drake.visual.drawn_robot import DrawnRobot
from uvms_drake.visual.limit_use import ACTIVE, LimitUse
from uvms_drake.visual.props import (
    GLASS,
    PLAN,
    REAL,
    Arrow,
    Bars,
    DrawnTube,
    DrawnWall,
    Number,
    Polyline,
    Trail,
    round_magnification,
)
from uvms_drake.visual.stage import NED, Stage, frame_at
from uvms_drake.visual.textured import label

WATER = {"top_color": [0.36, 0.60, 0.72], "bottom_color": [0.04, 0.16, 0.26]}
GHOST = Rgba(1.0, 1.0, 1.0, 0.3)
SPRING = Rgba(0.3, 0.3, 0.3)
INSET_RADIUS = 0.1  # m, of the tube in the inset
ARROW = 0.3
"""Length of the arrow of the largest force expected, as a fraction of the scene's size."""
ZOOM = 2.3
"""Zoom of a camera that is far away, so that parallels look like it."""
BESIDE = 0.12
"""Distance of the number from the end of the arrow, as a fraction of the scene's size."""
UP = np.array([1.0, -1.0, -1.0])
"""Signs of the axes of Σ_I in Meshcat, whose z points up."""


@dataclass(frozen=True)
class Moment:
    """The values that a picture shows at an instant, in the order of the paper."""

    state: np.ndarray
    """Real state (𝔮, ζ) (2(6+n),)."""
    nominal_state: np.ndarray
    """Nominal state (𝔮̄, ζ̄) (2(6+n),)."""
    u: np.ndarray
    """Input 𝔲 (6+n,)."""
    nominal_input: np.ndarray
    """Nominal input ū (6+n,)."""
    desired_force: np.ndarray
    """Desired force 𝔉_des (6,) [N, N m]."""
    path: np.ndarray
    """Points of the nominal end-effector's way from here on (N+1, 3) [m]."""
    force: np.ndarray | None = None
    """Force 𝔉 (6,) [N, N m]; None: the one that the surface's law gives for the pose at rest."""


@dataclass(frozen=True)
class Setting:
    """The values of a scene that stay the same in a run."""

    robot: str
    """A shipped robot or a robot's folder."""
    model: UvmsModel
    """The controller's model of the robot."""
    surface: Surface
    """The surface, as the controller knows it."""
    start: np.ndarray
    """Configuration 𝔮 at t = 0 (6+n,)."""
    force: np.ndarray
    """Desired force 𝔉_des of the task (6,) [N, N m]."""
    goal: np.ndarray
    """Desired pose χ_des of the task (6,)."""
    radius: float
    """Radius of the tube of the end-effector's position [m]."""
    limit_use: LimitUse
    """The quantities that the bars show."""
    horizon: int
    """Number N of intervals of a plan."""
    visual: VisualConfig
    """Settings of the drawing."""
    certified: bool
    """Whether the tube is that of a certificate that holds."""


class Scene:
    """Draws moments of a run in Meshcat, and remembers the last one.

    The robot; the nominal one as a ghost, its deviation enlarged; the force, real in colour and
    desired in white; the end-effector's trail and planned path; the tube at the tip, to scale and
    in an inset; the wall with its dent, or the paper's spring; and a bar for each limit.

    Args:
        meshcat: Where to draw.
        setting: The values that stay the same.
    """

    camera: np.ndarray
    """Position of the camera (3,) [m], in Meshcat's axes."""
    target: np.ndarray
    """Point that the camera looks at (3,) [m], in Meshcat's axes."""

    def __init__(self, meshcat: Meshcat, setting: Setting):
        self._law, self._model = setting.surface, setting.model
        self._stage = stage = Stage(meshcat)
        self._goal, start = setting.goal[:3], setting.start
        chi = self._model.task_pose(start)[:6]
        self._middle = 0.5 * (start[:3] + self._goal) * UP
        self._unit = max(float(np.linalg.norm(self._goal - start[:3])) / 1.4,
                         float(np.linalg.norm(chi[:3] - start[:3])))
        largest = max(float(np.linalg.norm(force[:3]))
                      for force in (setting.force, self._law.force(chi, np.zeros(6))))
        self._newton = ARROW * self._unit / (largest or 1.0)
        radius = setting.radius
        self._enlarged = (setting.visual.magnification
                          or round_magnification(radius, INSET_RADIUS))

        self._robot = DrawnRobot(stage, "uvms", setting.robot)
        self._ghost = DrawnRobot(stage, "nominal", setting.robot, GHOST)
        self._trail = Trail(stage, f"{NED}/trail", REAL, 0.004 * self._unit)
        self._path = Polyline(stage, f"{NED}/path", setting.horizon + 1, PLAN,
                              0.003 * self._unit, radius)
        self._force = Arrow(stage, f"{NED}/force", 0.016 * self._unit, REAL)
        self._desired = Arrow(stage, f"{NED}/desired_force", 0.024 * self._unit, GLASS)
        self._surface, self._rest = self._draw_surface()
        self._use = setting.limit_use
        self._draw_hud(setting.certified, radius, largest)
        self._time = np.inf

    def _draw_surface(self) -> tuple[DrawnWall | Polyline, np.ndarray]:
        """Returns the drawing of the surface, and where it is touched at rest (3,)."""
        rest, normal = self._law.anchor, self._law.normal
        if normal is None:
            self._stage.make(f"{NED}/rest", Sphere(0.02), PLAN, frame_at(rest))
            return Polyline(self._stage, f"{NED}/spring", 2, SPRING, 0.01), rest
        rest = self._goal - ((self._goal - rest) @ normal) * normal
        return DrawnWall(self._stage, f"{NED}/wall", rest, normal), rest

    def _draw_hud(self, certified: bool, radius: float, newton: float) -> None:
        """Places the camera and draws the things that face it: bars, numbers, inset, legend."""
        stage, meshcat = self._stage, self._stage.meshcat
        for part, color in WATER.items():
            meshcat.SetProperty("/Background/<object>", part, color)
        for path in ("/Grid", "/Axes"):
            meshcat.SetProperty(path, "visible", False)
        middle, unit = self._middle, self._unit

        def place(x: float, y: float, z: float) -> np.ndarray:
            return middle + unit * np.array([x, y, z])

        self.camera, self.target = place(-0.98, -2.7, 0.74), place(-0.14, 0.0, 0.04)
        meshcat.SetCameraPose(self.camera, self.target)
        meshcat.SetProperty("/Cameras/default/rotated/<object>", "zoom", ZOOM)
        facing = _facing(self.target - self.camera)
        self._bars = Bars(stage, "hud/limits", self._use.names)
        X_limits = RigidTransform(facing, place(-0.2, 0.0, 0.68)).GetAsMatrix4()
        meshcat.SetTransform("hud/limits", X_limits @ np.diag([unit, unit, unit, 1.0]))
        self._number = Number(stage, "hud/force", max(round(2.0 * newton), 40), "{} N",
                              0.1 * unit, facing)
        name = "certified tube" if certified else "declared tube"
        self._tube = DrawnTube(stage, f"{NED}/tube", "hud/inset", radius, self._enlarged,
                          f"{name}\nenlarged {self._enlarged:g}×", 0.055 * unit, facing)
        meshcat.SetTransform("hud/inset", RigidTransform(place(0.88, 0.0, 0.56)))
        stage.make("hud/legend", label(
            "red: real force and path     white: desired force, planned path, nominal robot "
            f"(deviation {self._enlarged:g}×)\nbars: part of each limit in use, red where active",
            0.055 * unit), None, RigidTransform(facing, place(-0.14, 0.0, -0.81)))

    def show(self, moment: Moment, time: float) -> None:
        """Draws a moment at `time` [s]; in a recording, too."""
        config, nominal = (state[: self._model.size] for state in
                           (moment.state, moment.nominal_state))
        chi = self._model.task_pose(config)[:6]
        tip, nominal_tip = chi[:3], self._model.task_pose(nominal)[:3]
        self._stage.begin(time)
        if time < self._time:
            self._trail.clear()
        self._time = time
        self._robot.show(config)
        self._ghost.show(config + self._enlarged * pose_difference(nominal, config))
        self._trail.show(tip)
        self._path.show(moment.path)
        self._tube.show(tip, nominal_tip)
        self._show_surface(chi)
        force = self._law.force(chi, np.zeros(6)) if moment.force is None else moment.force
        self._show_force(tip, force[:3], moment.desired_force[:3])
        used = self._use(moment.state, moment.u, moment.nominal_state, moment.nominal_input)
        self._bars.show(used, used >= ACTIVE)

    def _show_surface(self, chi: np.ndarray) -> None:
        if isinstance(self._surface, DrawnWall):
            self._surface.show(float(self._law.penetration(chi)))
        else:
            self._surface.show(np.array([self._rest, chi[:3]]))

    def _show_force(self, tip: np.ndarray, force: np.ndarray, desired: np.ndarray) -> None:
        self._force.show(tip, self._newton * force)
        self._desired.show(tip, self._newton * desired)
        longest = max(force, desired, key=np.linalg.norm)
        length = float(np.linalg.norm(longest)) or 1.0
        beyond = tip + (self._newton + BESIDE * self._unit / length) * longest
        self._number.show(beyond * UP, float(np.linalg.norm(force)))


def _facing(direction: np.ndarray) -> RotationMatrix:
    """Returns the attitude whose xz-plane is upright and seen along `direction` (3,)."""
    y = direction / np.linalg.norm(direction)
    x = np.cross(y, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    return RotationMatrix(np.column_stack([x, y, np.cross(x, y)]))
