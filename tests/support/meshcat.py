"""The contents of a Meshcat, read back, and messages as from a browser."""

import numpy as np
from pydrake.geometry import Meshcat, MeshcatParams


def packed_transform(meshcat, path):
    """Returns the 4×4 matrix of a path: by columns, a tag byte before each number."""
    _, packed = meshcat._GetPackedTransform(path).split(b"matrix")
    header = 3  # Of an array of 16 in MessagePack.
    numbers = np.frombuffer(packed[header:], dtype=[("tag", "u1"), ("value", ">f8")], count=16)
    return numbers["value"].reshape(4, 4).T


def press(meshcat, name):
    """Sends the message of a browser whose button is pressed."""
    text = name.encode()
    meshcat._InjectWebsocketMessage(
        b"\x82\xa4type\xa6button\xa4name" + bytes([0xA0 + len(text)]) + text)


class Canvas(Meshcat):
    """A Meshcat that remembers what it was given at each path."""

    def __init__(self):
        super().__init__(MeshcatParams(host="localhost"))
        self.colors, self.places, self.scales, self.sheets = {}, {}, {}, {}

    def SetObject(self, path, shape, color=None):
        self.colors[path] = None if color is None else (color.r(), color.g(), color.b())

    def SetTransform(self, path, pose, time_in_recording=None):
        self.places.setdefault(path, []).append((time_in_recording, pose))

    def SetProperty(self, path, name, value, time_in_recording=None):
        if name == "scale":
            self.scales.setdefault(path, []).append((time_in_recording, value))

    def PlotSurface(self, path, x, y, z, color):
        self.sheets[path] = np.stack([x, y, z], axis=-1)

    def SetLineSegments(self, path, begin, end, width, color):
        self.sheets[path] = np.stack([begin.T, end.T])

    def scale(self, path):
        """Returns the last scale of a path."""
        return self.scales[path][-1][1]

    def number(self, path):
        """Returns the text of the digits that a `Readout` at a path shows, without blanks."""
        return "".join(name.split("/")[-1] for name, given in sorted(self.scales.items())
                       if name.startswith(f"{path}/") and given[-1][1] == [1.0] * 3)
