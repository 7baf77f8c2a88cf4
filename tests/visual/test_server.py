"""The address at which a Meshcat listens: this machine's own, unless another is asked for."""

import ast
import gc
from pathlib import Path

import pytest
from support.pages import PACKAGE
from support.sockets import LOCAL, listening_addresses

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.visual.stage import open_meshcat

LINUX = pytest.mark.skipif(not Path("/proc/self/net/tcp").exists(), reason="needs Linux's /proc")


@LINUX
def test_only_this_machine_reaches_it():
    gc.collect()
    before = listening_addresses()
    meshcat = open_meshcat()
    now = listening_addresses()
    assert len(now) == len(before) + 1
    assert set(now) - set(before) <= LOCAL
    assert meshcat.web_url().startswith("http://localhost:")


@LINUX
def test_another_address_has_to_be_asked_for():
    meshcat = open_meshcat("*")
    assert not set(listening_addresses()) <= LOCAL
    del meshcat


def test_an_address_that_is_not_this_machines_is_refused_in_a_line():
    with pytest.raises(InvalidParameter, match=r"^host = '192\.0\.2\.1': must be an address of"):
        open_meshcat("192.0.2.1")  # Reserved for documentation: no machine has it.


@pytest.mark.parametrize("folder", [PACKAGE, PACKAGE.parent / "examples"],
                         ids=lambda folder: folder.name)
def test_every_other_file_opens_its_meshcat_through_it(folder):
    opened = [f"{path}:{node.lineno}" for path in folder.rglob("*.py")
              if path != PACKAGE / "visual" / "stage.py"
              for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
              if isinstance(node, ast.Call) and getattr(
                  node.func, "id", getattr(node.func, "attr", "")) in ("Meshcat", "StartMeshcat")]
    assert opened == []
