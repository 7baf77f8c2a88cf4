"""The contents of a Meshcat, read back, and messages as from a browser."""

import numpy as np


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
