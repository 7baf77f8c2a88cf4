"""The picture of a run, live and recorded by the same code."""

from dataclasses import dataclass, field
from typing import cast

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Meshcat, Rgba
from pydrake.math import RotationMatrix
from pydrake.systems.framework import Context, EventStatus

from uvms_drake.common.wiring import WiredSystem
from uvms_drake.control.limits import Limit
from uvms_drake.control.plan.points import Points
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.signals.sensor_actuator import SAFETY
from uvms_drake.model.surface.law import Surface
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.visual import objects
from uvms_drake.visual.contact import KNOWN, Coverage, DrawnEstimate, Estimate, Pressing
from uvms_drake.visual.overlay import Overlay
from uvms_drake.visual.stage import NED, UP, Stage, VisualConfig

WATER = {"top_color": [0.36, 0.60, 0.72], "bottom_color": [0.04, 0.16, 0.26]}
GHOST = Rgba(1.0, 1.0, 1.0, 0.75)
RETREAT = Rgba(1.0, 0.55, 0.0, 1.0)
INSET_RADIUS = 0.1  # m, of the tube in the inset
ZOOM = 2.3
"""Zoom of a camera that is far away, so that parallels look like it."""
BELOW = 0.55
"""Smallest distance of the level grid below the middle, as a fraction of the scene's size."""
CLOSE = 1.7
"""Distance of the camera in a close-up [m]."""
SIDE_SWITCH = 0.3
"""Distance of the start in y beyond which the camera changes sides, likewise."""


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
    """Planned path of the nominal end-effector (N+1, 3) [m]."""
    force: np.ndarray
    """Force 𝔉 (6,) [N, N m]."""
    estimate: Estimate = field(default_factory=dict)
    """Estimate of an unknown surface; empty for a known one."""
    retreats: bool = False
    """Whether a supervisor retreats."""


class LimitUse:
    """Fractions of each limit that the real and the nominal motion use, from 0 to 1.

    That of the nominal motion is of the limits tightened by the tube: a plan may be at its limit
    while the real robot keeps a distance from its own.

    Args:
        model: The controller's model.
        limits: Limits of the real robot, by name.
        nominal: The same, tightened by the tube.
    """

    def __init__(self, model: UvmsModel, limits: dict[str, Limit], nominal: dict[str, Limit]):
        self._model, self._limits, self._nominal = model, limits, nominal
        self.names = [bar for limit in limits.values() for bar in limit.bars]

    def __call__(self, state: np.ndarray, u: np.ndarray, nominal_state: np.ndarray,
                 nominal_input: np.ndarray) -> np.ndarray:
        """Returns the real and the nominal fractions (2, L) in the order of `names`.

        Args:
            state: (𝔮, ζ) (2(6+n),).
            u: 𝔲 (6+n,).
            nominal_state: (𝔮̄, ζ̄) (2(6+n),).
            nominal_input: ū (6+n,).
        """
        return np.stack([self._lengths(self._limits, state, u),
                         self._lengths(self._nominal, nominal_state, nominal_input)])

    def _lengths(self, limits: dict[str, Limit], state: np.ndarray, u: np.ndarray) -> np.ndarray:
        config, zeta = np.split(state, 2)
        at = Points(self._model, config, self._model.task_pose(config), zeta, u)
        return np.concatenate([limit.bar_lengths(at) for limit in limits.values()])


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
    heading: float = 0.0
    """Heading [rad] of a robot that faces the surface; the camera turns with it."""
    direction: np.ndarray | None = None
    """Direction n into an unknown surface (3,); None: the surface is known."""
    margin: float = 0.0
    """Largest distance E of the real tip beyond the planned one [m], on an unknown surface."""
    painted: float | None = None
    """Force at the end of the colour scale of a mission's coverage [N]; None: no coverage."""


class Scene:
    """Draws moments of a run in Meshcat, and remembers the last one.

    It shows the robot; an outline of the nominal one, its deviation enlarged; the end-effector's
    trail and planned path; the tube at the tip, to scale and in an inset; surface, forces and
    contact estimate; a mission's coverage; a level grid; the time; and a bar for each limit.

    Args:
        meshcat: Meshcat to draw in.
        setting: Constants of the scene.
    """

    camera: np.ndarray
    """Position of the camera (3,) [m], in Meshcat's axes."""
    target: np.ndarray
    """Point that the camera looks at (3,) [m], in Meshcat's axes."""

    def __init__(self, meshcat: Meshcat, setting: Setting):
        self._law, self._model = setting.surface, setting.model
        self._stage = stage = Stage(meshcat)
        turn = RotationMatrix.MakeZRotation(-setting.heading)
        middle, unit = self._framed(setting, turn)
        radius = setting.radius
        self._enlarged = (setting.visual.magnification
                          or objects.round_magnification(radius, INSET_RADIUS))

        # The objects in Σ_I.
        self._robot = objects.DrawnRobot(stage, "uvms", setting.robot)
        self._ghost = objects.DrawnRobot(stage, "nominal", setting.robot, GHOST)
        self._trail = objects.Trail(stage, f"{NED}/trail", objects.REAL, 0.004 * unit)
        self._retreat = objects.Trail(stage, f"{NED}/retreat", RETREAT, 0.006 * unit)
        self._path = objects.Polyline(
            stage, f"{NED}/path", setting.horizon + 1, objects.PLAN, 0.003 * unit)
        level = float(objects.CELL * np.ceil((BELOW * unit - middle[2]) / objects.CELL))
        objects.draw_floor(stage, f"{NED}/floor", np.array([*(middle * UP)[:2], level]),
                           int(np.ceil(2.5 * unit / objects.CELL)))

        # The camera, on the side from which the robot comes, and the texts that face it.
        begin = turn.inverse() @ (UP * (setting.start[:3] - self._goal))
        side = 1.0 if -begin[1] > SIDE_SWITCH * unit else -1.0
        self.camera = middle + unit * (turn @ np.array([-0.72, 2.75 * side, 0.8]))
        self.target = middle + unit * np.array([0.0, 0.0, 0.1])
        self._look(meshcat)
        self._use = setting.limit_use
        self._overlay = Overlay(stage, self.camera, self.target, unit, self._use.names,
                                self._legend(setting, level))
        name = "certified tube" if setting.certified else "declared tube"
        size = f"enlarged {self._enlarged:g}×" if self._enlarged != 1.0 else "to scale"
        self._tube = objects.DrawnTube(
            stage, f"{NED}/tube", self._overlay.inset, radius, self._enlarged, f"{name}\n{size}",
            0.055 * unit, self._overlay.facing)
        self._pressing = Pressing(stage, self._law, self._goal, setting.force, unit,
                                  self._overlay.facing)
        n, board = setting.direction, self._overlay.board
        self._estimate = None if n is None else DrawnEstimate(
            stage, board, n, setting.margin, self._tip)
        self._coverage = None if n is None or setting.painted is None else Coverage(
            stage, f"{NED}/coverage", f"{board}/painted", setting.painted, -n)
        self._time = np.inf

    def _framed(self, setting: Setting, turn: RotationMatrix) -> tuple[np.ndarray, float]:
        """Returns the middle (3,) [m] of the motion in Meshcat's axes, and its size [m].

        `turn` turns the axes so that the surface is ahead, along x.
        """
        vehicle = setting.start[:3]
        tip, self._goal = self._model.task_pose(setting.start)[:3], setting.goal[:3]
        self._tip = tip
        points = UP * np.array([vehicle, vehicle + self._goal - tip, tip, self._goal])
        points = points @ turn.matrix()
        border = float(np.linalg.norm(tip - vehicle)) * 0.6
        low, high = points.min(axis=0) - border, points.max(axis=0) + border
        return turn @ (0.5 * (low + high)), float(max((high - low)[[0, 2]] / [2.5, 1.3]))

    def _look(self, meshcat: Meshcat) -> None:
        """Places the camera in the water."""
        for part, color in WATER.items():
            meshcat.SetProperty("/Background/<object>", part, color)
        for path in ("/Grid", "/Axes"):
            meshcat.SetProperty(path, "visible", False)
        meshcat.SetCameraPose(self.camera, self.target)
        meshcat.SetProperty("/Cameras/default/rotated/<object>", "zoom", ZOOM)

    def look_closely(self, point: np.ndarray) -> None:
        """Brings the camera near a point (3,) [m] in Σ_I; the texts stay behind."""
        away = self.camera - self.target
        near = UP * point
        self._stage.meshcat.SetCameraPose(near + CLOSE * away / np.linalg.norm(away), near)

    def _legend(self, setting: Setting, level: float) -> str:
        """Returns the meaning of colours, bars and lines."""
        is_wall = self._law.patch(self._goal, 1.0, 2) is not None
        walls = ", 0.1 m on the wall" if is_wall else ""
        size = f" (deviation {self._enlarged:g}×)" if self._enlarged != 1.0 else ""
        estimate = ("     green: end of the safe region     yellow frame: estimated surface"
                    "     orange: retreat"
                    if setting.direction is not None else "")
        return (f"yellow: contact{estimate}\nred: real force and path     "
                f"white: desired force, planned path, outline of the nominal robot{size}\n"
                "bars: part of a limit that the real motion uses, red at the limit     "
                "white mark: the plan, of its tightened limit\n"
                f"level grid at z = {level:g} m, lines every {objects.CELL:g} m{walls}")

    def show(self, moment: Moment, time: float) -> None:
        """Draws a moment at `time` [s]; in a recording, too."""
        config, nominal = (state[: self._model.size] for state in
                           (moment.state, moment.nominal_state))
        chi = self._model.task_pose(config)[:6]
        tip, nominal_tip = chi[:3], self._model.task_pose(nominal)[:3]
        self._stage.begin(time)
        if time < self._time:
            self._trail.clear()
            self._retreat.clear()
            if self._coverage is not None:
                self._coverage.clear()
        self._time = time
        self._robot.show(config)
        self._ghost.show(config + self._enlarged * pose_difference(nominal, config))
        (self._retreat if moment.retreats else self._trail).show(tip)
        self._path.show(moment.path)
        self._tube.show(tip, nominal_tip)
        self._pressing.show(chi, moment.force, moment.desired_force)
        if self._estimate is not None:
            self._estimate.show(moment.estimate, tip)
        if self._coverage is not None and moment.estimate:
            self._coverage.show(chi, moment.estimate["force_last_valid"], self._law)
        self._overlay.show(time, *self._use(
            moment.state, moment.u, moment.nominal_state, moment.nominal_input))


class Illustration(WiredSystem):
    """Sink that draws its input signals in Meshcat; see `Scene`.

    .. pydrake_system::

        name: Illustration
        input_ports:
        - state
        - nominal_state
        - u
        - nominal_input
        - plan
        - force
        - desired_force
        - force_last_valid, safe_depth, contact_depth, stiffness_estimate (optional)
        - safety (optional)

    - `state`, `nominal_state` (2(6+n)), `u`, `nominal_input` (6+n): as from a station.
    - `plan`: the current `Plan` (abstract).
    - `force`, `desired_force` (6) [N, N m]: 𝔉 and 𝔉_des.
    - `force_last_valid` (6), `safe_depth`, `contact_depth`, `stiffness_estimate` (1): the estimate
      of an unknown surface, see `KNOWN`; empty unless all of them are connected.
    - `safety` (5): of a `Supervisor`.

    A picture is drawn after the first step of the simulation in each period of the rate: an event
    with a period would end an integration step, and so change the run. The Context has no state;
    the system and its `Scene` remember the last picture, as Meshcat does: all Contexts draw on the
    one picture, and nothing that is simulated depends on it.

    Args:
        meshcat: Meshcat to draw in.
        setting: Constants of the scene.
    """

    def __init__(self, meshcat: Meshcat, setting: Setting):
        super().__init__()
        self._scene, self._model = Scene(meshcat, setting), setting.model
        self._rate = setting.visual.rate
        self._knots = setting.horizon + 1
        self._last_time = np.inf
        size = self._model.size
        self._signals = {"state": 2 * size, "nominal_state": 2 * size, "u": size,
                         "nominal_input": size, "force": 6, "desired_force": 6}
        for name, width in (self._signals | KNOWN | {"safety": len(SAFETY)}).items():
            self.DeclareVectorInputPort(name, width)
        self.DeclareAbstractInputPort("plan", Value(object()))
        self.DeclarePerStepPublishEvent(self._draw_if_due)
        self.DeclareForcedPublishEvent(self._draw)

    def _draw_if_due(self, context: Context) -> EventStatus:
        now, last = context.get_time(), self._last_time
        if now < last or _frame(now, self._rate) > _frame(last, self._rate):
            return self._draw(context)
        return EventStatus.DidNothing()

    def _draw(self, context: Context) -> EventStatus:
        def value(name: str) -> np.ndarray:
            return cast(np.ndarray, self.GetInputPort(name).Eval(context))

        self._last_time = context.get_time()
        known = all(self.GetInputPort(name).HasValue(context) for name in KNOWN)
        plan, safety = (self.GetInputPort(name) for name in ("plan", "safety"))
        plan = plan.Eval(context)
        self._scene.show(Moment(
            **{name: value(name) for name in self._signals},
            path=self._model.task_pose(plan.config[: self._knots])[:, :3],
            estimate={name: value(name) for name in KNOWN} if known else {},
            retreats=safety.HasValue(context) and bool(safety.Eval(context)[0])), self._last_time)
        return EventStatus.Succeeded()


def _frame(time: float, rate: float) -> float:
    """Returns the number of the picture that `time` [s] belongs to."""
    return np.floor(time * rate + 1e-9)
