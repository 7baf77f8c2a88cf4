"""A Meshcat that listens on this machine alone, and one that remembers what it was given."""

import pytest
from pydrake.geometry import Meshcat, MeshcatParams
from support.meshcat import Canvas


@pytest.fixture
def meshcat() -> Meshcat:
    return Meshcat(MeshcatParams(host="localhost"))


@pytest.fixture
def canvas() -> Canvas:
    return Canvas()
