"""Drawing of a robot: the geometry of its file at a configuration."""

import numpy as np
from pydrake.geometry import Rgba, Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import RigidBody
from pydrake.systems.framework import DiagramBuilder

from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.uvms import add_uvms
from uvms_drake.visual.stage import NED, Stage

GREY = Rgba(0.7, 0.7, 0.7, 1.0)
FAR_SIDE = 1.0
"""BackSide of three.js."""


class DrawnRobot:
    """A robot on a stage.

    Args:
        stage: Stage to draw on.
        name: Name of the robot on the stage.
        model: A shipped robot or a robot's folder.
        color: Colour of all of it; None: that of its file. A robot in a colour of its own shows
            its far faces only: where it coincides with another one they are behind that one's
            near faces, so that the two do not flicker; the rest of it is an outline.
    """

    def __init__(self, stage: Stage, name: str, model: str, color: Rgba | None = None):
        self._stage = stage
        plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), time_step=0.0)
        uvms = add_uvms(plant, model)
        plant.Finalize()
        self._plant, self._coordinates = plant, Coordinates(uvms)
        self._context = plant.CreateDefaultContext()
        self._bodies: dict[str, RigidBody] = {}
        inspector = scene_graph.model_inspector()
        for index in plant.GetBodyIndices(uvms.model_instance):
            body = plant.get_body(index)
            shapes = inspector.GetGeometries(
                plant.GetBodyFrameIdOrThrow(index), Role.kIllustration)
            path = f"{NED}/{name}/{body.name()}"
            if shapes:
                self._bodies[path] = body
            for shape in shapes:
                properties = inspector.GetIllustrationProperties(shape)
                own = properties.GetPropertyOrDefault("phong", "diffuse", GREY)
                stage.make(f"{path}/{shape.get_value()}", inspector.GetShape(shape), color or own,
                           inspector.GetPoseInFrame(shape))
                if color is not None:
                    for key, value in (("material.side", FAR_SIDE), ("material.depthWrite", False)):
                        stage.meshcat.SetProperty(
                            f"{path}/{shape.get_value()}/<object>", key, value)

    def show(self, config: np.ndarray) -> None:
        """Draws the robot at 𝔮 (6+n,)."""
        state = self._coordinates.to_drake(np.concatenate([config, np.zeros_like(config)]))
        self._plant.SetPositions(self._context, state[: self._plant.num_positions()])
        for path, body in self._bodies.items():
            self._stage.move(path, body.EvalPoseInWorld(self._context))
