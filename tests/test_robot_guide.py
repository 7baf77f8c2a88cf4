"""The guide of models/README.md, followed literally."""

import re
import shlex
import shutil
from pathlib import Path

import pytest
from support.quick import SETTINGS, search_less
from support.robot_files import FILES

from uvms_drake.command.main import main
from uvms_drake.common.schema import parse_yaml
from uvms_drake.report.robot import robot_page, robot_views
from uvms_drake.station.scenario import scenario

GUIDE = (Path(__file__).parents[1] / "models" / "README.md").read_text(encoding="utf-8")
LONG = ("run press.yaml", "campaign press.yaml --runs 100")
"""Commands that only repeat, for longer, what the tests of `run` and `campaign` do."""


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", GUIDE, flags=re.M | re.S)


def commands() -> list[str]:
    return [line.removeprefix("uvms-drake ") for block in blocks("sh")
            for line in block.splitlines()]


def test_the_guide_has_ten_steps():
    assert re.findall(r"^\*\*(\d+)\. ", GUIDE, flags=re.M) == [str(i) for i in range(1, 11)]
    assert not blocks("yaml")  # Nothing has to be written by hand.
    assert set(LONG) < set(commands())
    assert commands()[0] == "robot --from rov.urdf rov"


@pytest.mark.slow
def test_whoever_follows_the_guide_has_a_certificate(tmp_path, monkeypatch, capsys):
    """With fewer searches than usual, a larger factor on what they find, and small pictures."""
    search_less(monkeypatch)
    settings = {"certificate": SETTINGS | {"safety_factor": 2.0}}
    monkeypatch.setattr(scenario, "parse_yaml", lambda text: parse_yaml(text) | settings)
    monkeypatch.setattr(robot_views, "PIXELS", 100)
    monkeypatch.setattr(robot_page, "RATE", 1.0)
    monkeypatch.chdir(tmp_path)
    shutil.copy(FILES / "dummy_root.urdf", "rov.urdf")
    for command in commands():
        if command not in LONG:
            assert main(shlex.split(command)) == 0, (command, capsys.readouterr().err)
    out = capsys.readouterr().out
    assert "tip         (0.968, 0, 0.289) m" in out
    assert re.search(r"^press: certified: all \d+ conditions hold", out, flags=re.M)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"my_robot", "press"}
    assert (tmp_path / "out/my_robot/robot.png").read_bytes().startswith(b"\x89PNG")
    page = (tmp_path / "out/my_robot/robot.html").read_text(encoding="utf-8")
    assert len(page) > 1e6  # It needs no server.
