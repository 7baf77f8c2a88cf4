"""Pictures of a robot by Drake's renderer of VTK, which needs neither a browser nor a display.

It is seen by rays that are almost parallel, so that its scale is the same everywhere.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydrake import geometry
from pydrake.common import MemoryFile
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo

from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.uvms import add_uvms

AWAY = 400.0
"""Distance of the eye over the width of the picture."""
LIGHTS = (("world", [0.3, -0.3, 0.9], 0.6), ("world", [0.9, -0.3, 0.1], 0.5),
          ("camera", [0.0, 0.0, 1.0], 0.5))
"""Lights from above and from behind a robot that heads north, z down, and from the eye."""


class RobotScene:
    """A robot at a configuration, with other triangles beside it.

    Args:
        model: A shipped robot or a robot's folder.
        config: Configuration 𝔮 (6+n,).
        beside: Triangles (K, 3, 3) [m] in Σ_I and colours (3,).
        heading: Heading with which the lights turn [rad].
    """

    def __init__(self, model: str, config: np.ndarray,
                 beside: Sequence[tuple[np.ndarray, np.ndarray]] = (), heading: float = 0.0):
        # The robot's shapes at the configuration.
        builder = DiagramBuilder()
        plant, robot = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
        uvms = add_uvms(plant, model)
        plant.Finalize()
        diagram = builder.Build()
        context = diagram.CreateDefaultContext()
        plant.SetPositionsAndVelocities(
            plant.GetMyMutableContextFromRoot(context),
            Coordinates(uvms).to_drake(np.concatenate([config, np.zeros_like(config)])))
        query = robot.get_query_output_port().Eval(robot.GetMyContextFromRoot(context))
        inspector = query.inspector()
        # The same in a scene of their own.
        self._scene = geometry.SceneGraph()
        self._source = self._scene.RegisterSource("picture")
        turn = RotationMatrix.MakeZRotation(heading)
        self._scene.AddRenderer("vtk", geometry.MakeRenderEngineVtk(geometry.RenderEngineVtkParams(
            default_clear_color=[1.0, 1.0, 1.0], lights=[geometry.LightParameter(
                type="directional", frame=frame, intensity=intensity,
                direction=turn @ direction if frame == "world" else direction)
                for frame, direction, intensity in LIGHTS])))
        corners = [np.zeros((0, 3))]
        signs = np.stack(np.meshgrid(*3 * [[-1.0, 1.0]]), axis=-1).reshape(-1, 3)
        for shape in inspector.GetAllGeometryIds(geometry.Role.kPerception):
            X, box = query.GetPoseInWorld(shape), inspector.GetObbInGeometryFrame(shape)
            corners.append((X @ box.pose() @ (signs * box.half_width()).T).T)
            solid = inspector.GetShape(shape)
            if isinstance(solid, geometry.Mesh) and solid.extension() == ".obj" and (
                    "vn " not in Path(solid.source().path()).read_text("utf-8", "replace")):
                solid = _mesh(_triangles(inspector.GetConvexHull(shape)))
            self._add(solid, X, inspector.GetPerceptionProperties(shape))
        self.corners = np.concatenate(corners)
        """Corners (K, 3) of the boxes around the robot's shapes [m]."""
        for triangles, color in beside:
            look = geometry.PerceptionProperties()
            look.AddProperty("phong", "diffuse", geometry.Rgba(*color))
            look.AddProperty("label", "id", geometry.RenderLabel.kDontCare)
            self._add(_mesh(triangles), RigidTransform(), look)
        self._context = self._scene.CreateDefaultContext()

    def _add(self, shape: geometry.Shape, X: RigidTransform, look: geometry.PerceptionProperties
             ) -> None:
        number = self._scene.model_inspector().num_geometries()
        solid = geometry.GeometryInstance(X, shape, f"solid {number}")
        solid.set_perception_properties(look)
        self._scene.RegisterAnchoredGeometry(self._source, solid)

    def picture(self, R: np.ndarray, low: np.ndarray, high: np.ndarray, width: int) -> np.ndarray:
        """Returns a picture (h, w, 3), lowest row first, colours from 0 to 1.

        Args:
            R: Axes of the picture in Σ_I (3, 3): to the right, up, and to the eye.
            low: Its lower left corner (2,) along the first two [m].
            high: Its upper right corner.
            width: Width [pixels]; it is made of twice as many each way.
        """
        size = high - low
        w, h = 2 * width, 2 * max(round(width * size[1] / size[0]), 1)
        away = AWAY * size[0]
        camera = geometry.ColorRenderCamera(geometry.RenderCameraCore(
            "vtk", CameraInfo(w, h, w * AWAY, w * AWAY, 0.5 * w - 0.5, 0.5 * h - 0.5),
            geometry.ClippingRange(0.9 * away, 1.1 * away), RigidTransform()))
        X = RigidTransform(RotationMatrix(np.array([R[0], -R[1], -R[2]]).T),
                           0.5 * (low + high) @ R[:2] + away * R[2])
        query = self._scene.get_query_output_port().Eval(self._context)
        data = query.RenderColorImage(camera, self._scene.world_frame_id(), X).data[::-1, :, :3]
        return data.reshape(h // 2, 2, w // 2, 2, 3).mean(axis=(1, 3)) / 255.0


def _mesh(triangles: np.ndarray) -> geometry.Mesh:
    """Returns triangles (K, 3, 3) [m] as a mesh with a normal for each, without which VTK fails."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in triangles.reshape(-1, 3)]
    lines += [f"vn {x:.7g} {y:.7g} {z:.7g}" for x, y, z in normals]
    lines += ["f " + " ".join(f"{3 * k + i}//{k + 1}" for i in (1, 2, 3))
              for k in range(len(triangles))]
    file = MemoryFile("\n".join(lines), ".obj", "triangles")
    return geometry.Mesh(geometry.InMemoryMesh(mesh_file=file), 1.0)


def _triangles(hull: geometry.PolygonSurfaceMesh) -> np.ndarray:
    """Returns the faces of a convex hull as triangles (K, 3, 3)."""
    faces = [np.array([hull.vertex(face.vertex(i)) for i in range(face.num_vertices())])
             for face in map(hull.element, range(hull.num_elements()))]
    return np.array([face[[0, i, i + 1]] for face in faces for i in range(1, len(face) - 1)])


def picture_axes(eye: np.ndarray) -> np.ndarray:
    """Returns the axes (3, 3) of a picture: to the right, up, and to the eye, z points down."""
    eye = eye / np.linalg.norm(eye)
    right = np.cross(eye, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(eye, right), eye])
