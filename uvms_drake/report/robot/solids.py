"""The shapes in a robot's file as triangles."""

from collections.abc import Iterator

import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    GeometryId,
    Rgba,
    Role,
    SceneGraphInspector,
    Sphere,
)
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder

from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.uvms import add_uvms

SIDES = 36
"""Number of sides of round shapes."""
GREY = Rgba(0.7, 0.7, 0.7, 1.0)


def robot_triangles(model: str, config: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yields the triangles (K, 3, 3) [m] in Σ_I and the colour (3,) of each shape of a robot.

    Args:
        model: A shipped robot or a robot's folder.
        config: Configuration 𝔮 (6+n,).
    """
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    uvms = add_uvms(plant, model)
    plant.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    plant.SetPositionsAndVelocities(
        plant.GetMyMutableContextFromRoot(context),
        Coordinates(uvms).to_drake(np.concatenate([config, np.zeros_like(config)])))
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(context))
    inspector = query.inspector()
    for shape in inspector.GetAllGeometryIds(Role.kIllustration):
        corners = triangles_of(inspector, shape).reshape(-1, 3).T
        color = inspector.GetIllustrationProperties(shape).GetPropertyOrDefault(
            "phong", "diffuse", GREY)
        yield (query.GetPoseInWorld(shape) @ corners).T.reshape(-1, 3, 3), np.array(color.rgba)[:3]


def triangles_of(inspector: SceneGraphInspector, geometry: GeometryId) -> np.ndarray:
    """Returns the surface of a shape as triangles (K, 3, 3) [m]; of a mesh, its convex hull."""
    shape = inspector.GetShape(geometry)
    rod, ball = np.array([[0, 1], [1, 1], [1, -1], [0, -1]]), np.linspace(0.0, np.pi, SIDES // 2)
    half = np.column_stack([np.sin(ball), np.cos(ball)])
    match shape:
        case Box():
            return revolved(rod * [np.sqrt(2.0), 1.0], 0.5 * shape.size(), 4)
        case Cylinder():
            return revolved(rod, [shape.radius(), shape.radius(), 0.5 * shape.length()])
        case Sphere():
            return revolved(half, [shape.radius()] * 3)
        case Ellipsoid():
            return revolved(half, [shape.a(), shape.b(), shape.c()])
        case Capsule():
            ends = half * shape.radius()
            return revolved(ends + np.outer(np.copysign(0.5 * shape.length(), ends[:, 1]), [0, 1]),
                            [1.0, 1.0, 1.0])
    hull = inspector.GetConvexHull(geometry)
    faces = [] if hull is None else [
        np.array([hull.vertex(face.vertex(i)) for i in range(face.num_vertices())])
        for face in map(hull.element, range(hull.num_elements()))]
    return np.array([face[[0, i, i + 1]] for face in faces for i in range(1, len(face) - 1)])


def revolved(profile: np.ndarray, size: list[float] | np.ndarray, sides: int = SIDES) -> np.ndarray:
    """Returns a profile turned about z and stretched, as triangles (K, 3, 3).

    Args:
        profile: Radius and height of its points (P, 2), from the top down.
        size: Factors along x, y and z.
        sides: Number of sides; corners are half a side off the axes, as a box has them.
    """
    angle = 2.0 * np.pi * (np.arange(sides + 1) + 0.5) / sides
    rings = np.array([np.column_stack([r * np.cos(angle), r * np.sin(angle), 0.0 * angle + z])
                      for r, z in profile]) * size
    corners = rings[:-1, :-1], rings[1:, :-1], rings[1:, 1:], rings[:-1, 1:]
    return np.concatenate([np.stack([corners[i] for i in three], axis=2).reshape(-1, 3, 3)
                           for three in ((0, 1, 2), (0, 2, 3))])
