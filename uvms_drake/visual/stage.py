"""Meshcat and its server, as a stage: objects are made once and moved, live as in a recording.

A recording keeps position, attitude and scale, but neither colour nor visibility
(RobotLocomotion/drake #20879). So an object that changes its length, or is hidden, is scaled.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams, Rgba, Shape
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from uvms_drake.common.constraints import AtLeast, Between
from uvms_drake.common.errors import InvalidParameter

LOCAL = "localhost"
"""Address that only programs of this machine reach."""
NED = "ned"
"""Path below which z points down, for everything that is drawn in Σ_I."""
UP = np.array([1.0, -1.0, -1.0])
"""Signs of the axes of Σ_I in Meshcat, whose z points up."""
VANISHED = 1e-5
"""Scale of an object that is hidden; zero has no inverse, which shading needs."""
INSTANT = 1e-3
"""Time in a recording from one value to the next one of an object that appears at once [s]."""
UNSEEN = 5e-4
"""Invisible change of a position [m], a direction or a scale: a quarter of a pixel."""


@dataclass
class VisualConfig:
    """Settings of the picture of a run; the run itself does not depend on them."""

    rate: Annotated[float, Between(1, 100, " pictures in a second")] = 25.0
    """Pictures in a second of simulated time, live and in the replay [1/s]."""
    magnification: Annotated[float, AtLeast(1)] | None = None
    """Factor by which the deviation from the plan is enlarged, in the ghost of the nominal robot
    and in the inset with the tube; without it, the tube's radius is drawn about 10 cm large."""


def open_meshcat(host: str = LOCAL) -> Meshcat:
    """Returns a new Meshcat that listens at an address of this machine.

    Drake's default is every interface, where the whole network can press the buttons of a run.

    Args:
        host: Name or number of the address; `*` for every interface.

    Raises:
        InvalidParameter: Nothing can listen there.
    """
    try:
        return Meshcat(MeshcatParams(host=host))
    except RuntimeError as error:
        raise InvalidParameter("host", host, "an address of this machine with a free port, or '*' "
                               f"({error})") from None


def turn_down(meshcat: Meshcat) -> None:
    """Lets z point down below `NED`; in Meshcat itself it points up.

    A MeshcatVisualizer wants a path of its own below `NED`: it deletes its path, with any transform
    on it, when a simulation starts.
    """
    meshcat.SetTransform(NED, RigidTransform(RollPitchYaw(np.pi, 0.0, 0.0), np.zeros(3)))


class Stage:
    """Moves and stretches objects by path, at the time of `begin`.

    A recording interpolates between its samples. Here a constant value is written once, and once
    more before it changes: that keeps a replay small and exact. Invisible changes are skipped.
    Transform and scale of the same path overwrite each other: use one of them for each path.
    """

    def __init__(self, meshcat: Meshcat):
        self.meshcat = meshcat
        self._before = self._now = -np.inf
        self._sampled: dict[str, tuple[float, np.ndarray]] = {}
        turn_down(meshcat)

    def make(self, path: str, shape: Shape, color: Rgba | None = None,
             pose: RigidTransform | None = None) -> None:
        """Puts an object at `path`, at a fixed pose in the frame above it."""
        if color is None:
            self.meshcat.SetObject(path, shape)
        else:
            self.meshcat.SetObject(path, shape, color)
        if pose is not None:
            self.meshcat.SetTransform(path, pose)

    def see_through(self, path: str, order: float = 1.0) -> None:
        """Draws an object over all others; a higher `order` is on top."""
        for name, value in (("material.depthTest", False), ("renderOrder", order)):
            self.meshcat.SetProperty(f"{path}/<object>", name, value)

    def begin(self, time: float) -> None:
        """Begins the picture at `time` [s]."""
        if time < self._now:  # The simulation starts again.
            self._sampled.clear()
            self._now = -np.inf
        self._before, self._now = self._now, time

    def move(self, path: str, pose: RigidTransform) -> None:
        """Sets the pose of `path` in the frame above it."""
        for time, value in self._changes(path, pose.GetAsMatrix34()):
            self.meshcat.SetTransform(path, RigidTransform(value), time_in_recording=time)

    def stretch(self, path: str, x: float, y: float, z: float, *, at_once: bool = False) -> None:
        """Scales `path` along its axes; `at_once` without the interpolation of a recording."""
        scale = np.maximum(np.array([x, y, z]), VANISHED)
        for time, value in self._changes(path, scale, at_once):
            self.meshcat.SetProperty(path, "scale", value.tolist(), time_in_recording=time)

    def show(self, path: str, shown: bool) -> None:
        """Shows or hides `path`, at once: no two digits are seen together."""
        size = 1.0 if shown else VANISHED
        self.stretch(path, size, size, size, at_once=True)

    def appear(self, path: str) -> None:
        """Shows an object that was made in the midst of a recording, and not before."""
        nothing = np.full(3, VANISHED)
        self.meshcat.SetProperty(path, "scale", nothing.tolist(), time_in_recording=0.0)
        self._sampled[path] = 0.0, nothing
        self.show(path, True)

    def _changes(self, path: str, value: np.ndarray, at_once: bool = False
                 ) -> list[tuple[float, np.ndarray]]:
        """Returns the samples (time, value) after which `value` holds now, and not before."""
        sampled = self._sampled.get(path)
        if sampled is None:
            self._sampled[path] = self._now, value
            return [(self._now, value)]
        time, old = sampled
        if np.max(np.abs(value - old)) < UNSEEN:
            return []
        self._sampled[path] = self._now, value
        last = max(self._now - INSTANT, self._before) if at_once else self._before
        return [*([(last, old)] if time < last else []), (self._now, value)]


def frame_at(origin: Sequence[float] | np.ndarray, axis: np.ndarray | None = None
             ) -> RigidTransform:
    """Returns a frame at `origin`, its z-axis along `axis` (3,) if there is one."""
    R = RotationMatrix() if axis is None else RotationMatrix.MakeFromOneVector(axis, 2)
    return RigidTransform(R, origin)
