"""Flat pictures for Meshcat that keep their colours in any light: texts, rectangles, grids."""

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
ALIGNMENTS = {"left": 1.0, "center": 0.0, "right": -1.0}
TEXTURE = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
"""Corners of a picture, counterclockwise from the lower left one."""
SQUARE = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])
"""Corners of a square in the xy-plane."""
UPRIGHT = SQUARE[:, [0, 2, 1]]
"""Corners of a square in the xz-plane, seen from −y."""


def picture(corners: np.ndarray, image: np.ndarray) -> Mesh:
    """Returns a rectangle with an image on it, seen from both sides.

    Args:
        corners: Its corners, counterclockwise from the image's lower left one (4, 3) [m].
        image: RGBA (rows, columns, 4), 0 to 255.
    """
    png = io.BytesIO()
    imsave(png, image, format="png")
    # glTF has its y-axis up; Meshcat turns it to z.
    points = corners[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
    parts = [points.astype(np.float32), TEXTURE.astype(np.float32),
             np.array([0, 1, 2, 0, 2, 3], dtype=np.uint32)]
    kinds = [{"componentType": 5126, "count": 4, "type": "VEC3",
              "min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()},
             {"componentType": 5126, "count": 4, "type": "VEC2"},
             {"componentType": 5125, "count": 6, "type": "SCALAR"}]
    gltf = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{
            "attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "materials": [{
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0},
            "alphaMode": "BLEND", "doubleSided": True,
            "extensions": {"KHR_materials_unlit": {}}}],
        "extensionsUsed": ["KHR_materials_unlit"],
        "textures": [{"source": 0}], "images": [{"uri": _data_uri("image/png", png.getvalue())}],
        "buffers": [{"byteLength": part.nbytes, "uri": _data_uri(
            "application/octet-stream", part.tobytes())} for part in parts],
        "bufferViews": [{"buffer": i, "byteLength": part.nbytes} for i, part in enumerate(parts)],
        "accessors": [{"bufferView": i, **kind} for i, kind in enumerate(kinds)]}
    return Mesh(InMemoryMesh(mesh_file=MemoryFile(
        contents=json.dumps(gltf), extension=".gltf", filename_hint="picture")))


def _data_uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


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
    x, z = height / (1.2 * FONT_PIXELS) * size
    corners = (UPRIGHT + [0.5 * ALIGNMENTS[align], 0.0, 0.0]) * [x, 1.0, z]
    return picture(corners, np.asarray(canvas.buffer_rgba()))


def rectangle(x: float, z: float, color: tuple[float, float, float, float]) -> Mesh:
    """Returns a rectangle in the xz-plane, its middle at the origin.

    Args:
        x: Its width [m].
        z: Its height [m].
        color: Red, green, blue and opacity, 0 to 1.
    """
    pixel = np.tile(np.round(255.0 * np.array(color)), (2, 2, 1)).astype(np.uint8)
    return picture(UPRIGHT * [x, 1.0, z], pixel)
