"""Triangles of STL files, as OBJ files and as volumes."""

import numpy as np


def format_obj(triangles: np.ndarray) -> str:
    """Returns the text of an OBJ file of triangles (k, 3, 3), equal corners once."""
    corners, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    index = index.reshape(-1, 3) + 1
    flat = (index == np.roll(index, 1, axis=1)).any(axis=1)
    lines = [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in corners]
    lines += [f"f {a} {b} {c}" for a, b, c in index[~flat]]
    return "\n".join(lines) + "\n"


def mesh_volume(triangles: np.ndarray) -> float:
    """Returns the volume inside of a closed surface of triangles (k, 3, 3), in their unit cubed."""
    return float(abs(np.linalg.det(triangles).sum()) / 6.0)
