"""Meshes with a picture on them, for Meshcat: labels, and a wall whose grid shows its dent."""

import base64
import io
import json
from pathlib import Path

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh

Color = tuple[int, int, int, int]
WHITE: Color = (255, 255, 255, 255)
FONT_PIXELS = 40


def textured_mesh(vertices: np.ndarray, uv: np.ndarray, faces: np.ndarray, image: Image.Image, *,
                  normals: np.ndarray | None = None) -> Mesh:
    """Returns a triangle mesh with a picture on it, seen from both sides.

    Args:
        vertices: (V, 3) [m].
        uv: Where in the picture each vertex is (V, 2), from the upper left, 0 to 1.
        faces: Indices of the vertices (F, 3).
        image: May be transparent.
        normals: (V, 3), for shading; without them the picture keeps its colours in any light.
    """
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
    png = io.BytesIO()
    image.save(png, format="png", optimize=True)
    material: dict = {
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0,
                                 "roughnessFactor": 0.9},
        "alphaMode": "BLEND", "doubleSided": True}
    if normals is None:
        material["extensions"] = {"KHR_materials_unlit": {}}
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


def label(text: str, height: float, *, color: Color = WHITE, bold: bool = False) -> Mesh:
    """Returns lines of text as a mesh in the xz-plane, upright, read along x and from −y.

    Args:
        text: Its middle is the origin.
        height: Of a line [m].
        color: Of the letters.
        bold: As it says.
    """
    face = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    font = ImageFont.truetype(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / face,
                              FONT_PIXELS)
    measure = ImageDraw.Draw(Image.new("RGBA", (1, 1)))
    left, top, right, bottom = measure.multiline_textbbox((0, 0), text, font=font, align="center")
    size = (int(right - left) + 8, int(bottom - top) + 8)
    # Transparent pixels have the letters' colour, or their edges would be dark.
    image = Image.new("RGBA", size, (*color[:3], 0))
    ImageDraw.Draw(image).multiline_text((4 - left, 4 - top), text, font=font, fill=color,
                                         align="center")
    x, z = 0.5 * height / (1.2 * FONT_PIXELS) * np.array(size)
    corners = np.array([[-x, 0.0, -z], [x, 0.0, -z], [x, 0.0, z], [-x, 0.0, z]])
    uv = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
    return textured_mesh(corners, uv, np.array([[0, 1, 2], [0, 2, 3]]), image)


def _y_up(vectors: np.ndarray) -> np.ndarray:
    """Returns vectors (V, 3) as glTF has them; Meshcat turns its y-axis up to z."""
    return np.ascontiguousarray(vectors[:, [0, 2, 1]] * [1.0, 1.0, -1.0], dtype=np.float32)


def _data_uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
