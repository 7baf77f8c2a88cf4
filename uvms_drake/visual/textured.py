"""Meshes with a picture on them, for Meshcat: labels, and a wall whose grid shows its dent."""

import base64
import io
import json

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh

FONT_PIXELS = 40
CORNERS = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
"""Corners of a picture, counterclockwise from the lower left one."""


def textured_mesh(vertices: np.ndarray, uv: np.ndarray, faces: np.ndarray, image: np.ndarray, *,
                  normals: np.ndarray | None = None) -> Mesh:
    """Returns a triangle mesh with a picture on it, seen from both sides.

    Args:
        vertices: (V, 3) [m].
        uv: Texture coordinates of the vertices (V, 2), from the upper left, 0 to 1.
        faces: Indices of the vertices (F, 3).
        image: RGBA (rows, columns, 4), 0 to 255.
        normals: (V, 3), for shading; without them the picture keeps its colours in any light.
    """
    # Vertex attributes and indices, one behind the other in a single buffer.
    arrays = {"POSITION": _y_up(vertices), "TEXCOORD_0": uv.astype(np.float32)}
    if normals is not None:
        arrays["NORMAL"] = _y_up(normals)
    parts = [*arrays.values(), faces.astype(np.uint32).reshape(-1)]
    offsets = np.cumsum([0, *(part.nbytes for part in parts)]).tolist()
    accessors: list[dict] = [
        {"bufferView": i, "componentType": 5126, "count": len(part), "type": f"VEC{part.shape[1]}"}
        for i, part in enumerate(parts[:-1])]
    accessors[0] |= {"min": parts[0].min(axis=0).tolist(), "max": parts[0].max(axis=0).tolist()}
    accessors.append({"bufferView": len(arrays), "componentType": 5125, "count": parts[-1].size,
                      "type": "SCALAR"})
    # The picture; without normals it is unlit, so that it keeps its colours.
    png = io.BytesIO()
    imsave(png, image, format="png")
    material: dict = {
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0,
                                 "roughnessFactor": 0.9},
        "alphaMode": "BLEND", "doubleSided": True}
    if normals is None:
        material["extensions"] = {"KHR_materials_unlit": {}}
    # All of it in one glTF document, with the binary parts as data URIs.
    gltf = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{
            "attributes": {name: i for i, name in enumerate(arrays)},
            "indices": len(arrays), "material": 0}]}],
        "materials": [material], "extensionsUsed": ["KHR_materials_unlit"],
        "textures": [{"source": 0}], "images": [{"uri": _data_uri("image/png", png.getvalue())}],
        "buffers": [{"byteLength": offsets[-1], "uri": _data_uri(
            "application/octet-stream", b"".join(part.tobytes() for part in parts))}],
        "bufferViews": [{"buffer": 0, "byteOffset": start, "byteLength": part.nbytes}
                        for start, part in zip(offsets, parts, strict=False)],
        "accessors": accessors}
    return Mesh(InMemoryMesh(mesh_file=MemoryFile(
        contents=json.dumps(gltf), extension=".gltf", filename_hint="textured")))


ALIGNMENTS = {"left": 1.0, "center": 0.0, "right": -1.0}


def label(text: str, height: float, *, bold: bool = False,
          color: tuple[float, float, float] = (1.0, 1.0, 1.0), align: str = "center") -> Mesh:
    """Returns text as a mesh in the xz-plane, upright, read along x and from −y.

    Args:
        text: One or more lines, with their middle at the origin's height.
        height: Height of a line [m].
        bold: Whether the letters are bold.
        color: Red, green and blue, 0 to 1.
        align: Part of the text at the origin: `left` end, `center` or `right` end.
    """
    # Transparent pixels have the colour too, or the letters' edges would be dark.
    figure = Figure(dpi=72.0, facecolor=(*color, 0.0))  # A point is a pixel.
    canvas = FigureCanvasAgg(figure)
    drawn = figure.text(0.5, 0.5, text, size=FONT_PIXELS, family="DejaVu Sans", color=color,
                        weight="bold" if bold else "normal", ha="center", va="center",
                        multialignment=align)
    size = np.ceil(drawn.get_window_extent(canvas.get_renderer()).size) + 8.0
    figure.set_size_inches(*size / 72.0)
    canvas.draw()
    x, z = 0.5 * height / (1.2 * FONT_PIXELS) * size
    corners = np.array([[-x, 0.0, -z], [x, 0.0, -z], [x, 0.0, z], [-x, 0.0, z]])
    corners[:, 0] += ALIGNMENTS[align] * x
    return textured_mesh(corners, CORNERS, np.array([[0, 1, 2], [0, 2, 3]]),
                         np.asarray(canvas.buffer_rgba()))


def rectangle(x: float, z: float, color: tuple[float, float, float, float]) -> Mesh:
    """Returns an unlit rectangle in the xz-plane, its middle at the origin.

    Args:
        x: Its width [m].
        z: Its height [m].
        color: Red, green, blue and opacity, 0 to 1.
    """
    pixel = np.tile(np.round(255.0 * np.array(color)), (2, 2, 1)).astype(np.uint8)
    corners = 0.5 * np.array([[-x, 0.0, -z], [x, 0.0, -z], [x, 0.0, z], [-x, 0.0, z]])
    return textured_mesh(corners, CORNERS, np.array([[0, 1, 2], [0, 2, 3]]), pixel)


def _y_up(vectors: np.ndarray) -> np.ndarray:
    """Returns vectors (V, 3) as glTF has them; Meshcat turns its y-axis up to z."""
    return np.ascontiguousarray(vectors[:, [0, 2, 1]] * [1.0, 1.0, -1.0], dtype=np.float32)


def _data_uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
