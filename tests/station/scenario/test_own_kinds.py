"""Kinds of one's own, each one file that a scenario names, without an edit in the package."""

import importlib
import re
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from support.scenarios import error_of

import uvms_drake as uv
from uvms_drake.certificate.certificate import fingerprint
from uvms_drake.command.main import main
from uvms_drake.common import kinds
from uvms_drake.common.kinds import kinds_of
from uvms_drake.common.schema import load_typed, parse_yaml
from uvms_drake.mission.law import DONE, RUNNING, Measured, advance, begin, due_at
from uvms_drake.model.description.robot_files import model_dir
from uvms_drake.station.scenario.scenario import dump_scenario

CLOSE = "start: {eta: [-1.13, -0.05, -0.05, 0.02, 0.02, 0.05]}"
"""The tip starts 4 cm off the wall and touches it within a second."""
HEAD = """\
from dataclasses import dataclass
import numpy as np
from pydrake.systems.primitives import Gain
import uvms_drake as uv

"""
KINDS = {
    "law": ("""
@uv.register
@dataclass
class Stiffer(uv.AncillaryLaw):
    gain: float = 90.0  # 1/s²

    def command(self, model, now, nominal_acceleration, nominal_input):
        error = now.inverse @ uv.pose_difference(*now.y)
        return nominal_input() - self.gain * error - 20.0 * (now.zeta[0] - now.zeta[1])
""", "ancillary: !Stiffer {gain: 80.0}", lambda scenario: scenario.ancillary.gain == 80.0),
    "limit": ("""
@uv.register
@dataclass
class Deepest(uv.Limit):
    name = "deepest"
    depth: float = 0.5  # m

    def values(self, at):
        return at.config[..., 2:3]

    def bounds(self):
        return np.array([-10.0]), np.array([self.depth])
""", "limits: {more: [!Deepest {depth: 0.1}]}", lambda scenario: (
        scenario.limits.more[0].depth == 0.1)),
    "cost": ("""
@uv.register
@dataclass
class LevelTool(uv.CostTerm):
    weight: float = 1.0

    def residual(self, at):
        return np.sqrt(self.weight) * at.y[..., 4:5]
""", "mpc: {terms: [!LevelTool {weight: 5.0}]}", lambda scenario: (
        scenario.mpc.terms[0].weight == 5.0)),
    "surface": ("""
@uv.register
@dataclass
class Rail(uv.UnilateralPlane):
    stiffness: float = 700.0  # N/m
""", "surface: !Rail {transition: 0.001}", lambda scenario: (
        (scenario.surface.stiffness, scenario.surface.transition) == (700.0, 0.001))),
    "sensor": ("""
@uv.register
@dataclass
class Scaled(uv.Sensor):
    factor: float = 1.0

    def add_to(self, builder, model, port, signals, seed):
        gain = builder.AddNamedSystem("gain", Gain(self.factor, port.size()))
        builder.Connect(port, gain.get_input_port())
        signals["scaled"] = gain.get_output_port()
        return gain.get_output_port()
""", "sensing: [!Scaled {factor: 1.001}]", lambda scenario: scenario.sensing[0].factor == 1.001),
    "actuator": ("""
@uv.register
@dataclass
class Weak(uv.Actuator):
    share: float = 1.0

    def add_to(self, builder, model, port, signals, seed):
        gain = builder.AddNamedSystem("weak", Gain(self.share, port.size()))
        builder.Connect(port, gain.get_input_port())
        return gain.get_output_port()
""", "actuation: [!Weak {share: 0.99}]", lambda scenario: scenario.actuation[0].share == 0.99),
    "contact": ("""
@uv.register
@dataclass
class GuessedSurface(uv.Contact):
    stiffness: float = 1.0  # over the true one

    def controller_surface(self, surface):
        return surface.stiffened(self.stiffness)
""", "contact: !GuessedSurface {stiffness: 0.9}", lambda scenario: (
        uv.load_model(scenario).surface.stiffness == 0.9 * scenario.surface.stiffness)),
    "disturbance": ("""
@uv.register
@dataclass
class Push(uv.SinusoidalDisturbance):
    frequency: float = 3.0
""", "disturbance: !Push {bound: 0.05}", lambda scenario: scenario.disturbance.frequency == 3.0),
}


@pytest.fixture(autouse=True)
def _forgotten(monkeypatch):
    """Kinds and modules of a test are gone after it."""
    monkeypatch.setattr(kinds, "_KINDS", {
        base: dict(known) for base, known in kinds._KINDS.items()})
    before = set(sys.modules)
    yield
    for name in set(sys.modules) - before:
        if not name.startswith(("uvms_drake", "pydrake")):
            del sys.modules[name]


def written(folder: Path, kind: str) -> Path:
    """Returns the file of a scenario beside the module of its kind."""
    source, entry, _ = KINDS[kind]
    (folder / f"my_{kind}.py").write_text(HEAD + source, encoding="utf-8")
    path = folder / "mine.yaml"
    path.write_text(f"base: girona500_ideal\nmodules: [my_{kind}.py]\nduration: 0.1\n{CLOSE}\n"
                    f"{entry}\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_names_a_kind_of_ones_own_runs_with_it_and_is_dumped_and_loaded_again(
        kind, tmp_path):
    scenario = uv.load_scenario(str(written(tmp_path, kind)))
    assert KINDS[kind][2](scenario)
    record = uv.simulate(scenario)
    assert np.all(np.isfinite(record.force))
    again = tmp_path / "elsewhere" / "again.yaml"
    again.parent.mkdir()
    again.write_text(dump_scenario(record.scenario), encoding="utf-8")
    assert dump_scenario(uv.load_scenario(str(again))) == dump_scenario(record.scenario)


def test_a_mission_takes_a_step_of_ones_own(tmp_path):
    (tmp_path / "my_step.py").write_text(HEAD + """
@uv.register
@dataclass
class Tap(uv.mission.Pressing):
    touches = True
    times: int = 3

    def desired_force(self, spent, searching):
        return self.force if int(2.0 * spent) % 2 == 0 else 0.5 * self.force

    def is_done(self, spent, steady, there, searching):
        return spent >= self.times
""", encoding="utf-8")
    path = tmp_path / "mine.yaml"
    path.write_text("base: girona500_inspection\nmodules: [my_step.py]\nmission: {steps: ["
                    "!Approach {force: 8}, !Tap {force: 8, times: 2}, !Retreat {}]}\n",
                    encoding="utf-8")
    mission = uv.load_scenario(str(path)).mission.checked()
    state, forces = begin(mission, np.array([-0.1, 0.0, 0.0]), 0.0), []
    due = due_at(mission, state, 0.0)
    for t in np.arange(0.0, 20.0, 0.05):
        # A robot that follows its references at once, and a wall at the depth 0.
        depth = min(0.0 if due.force > 0.0 else due.deepest, due.deepest)
        state, due = advance(mission, state, Measured(
            np.array([depth, *due.place]), due.force, touched=depth >= 0.0), float(t))
        if state.outcome == RUNNING and type(mission.steps[state.step]).__name__ == "Tap":
            forces.append(due.force)
    assert state.outcomes == (DONE, DONE, DONE)
    assert set(forces) == {8.0, 4.0}
    assert 0.05 * len(forces) == pytest.approx(2.0, abs=0.1)


def test_the_command_line_takes_a_kind_of_ones_own(tmp_path, capsys):
    assert main(["scenario", "--check", str(written(tmp_path, "surface"))]) == 0
    assert "surface.stiffness: 700.0 (base: 1000.0)" in capsys.readouterr().out


def test_a_changed_module_makes_a_certificate_stale(tmp_path):
    scenario = uv.load_scenario(str(written(tmp_path, "surface")))
    before = fingerprint(scenario)
    path = tmp_path / "my_surface.py"
    path.write_text(path.read_text(encoding="utf-8") + "# Changed.\n", encoding="utf-8")
    after = fingerprint(scenario)
    assert before["inputs"] == after["inputs"]
    assert before["files"] != after["files"]


def test_files_that_a_module_imports_count_and_each_module_of_a_name(tmp_path, monkeypatch):
    """Two files of the same name, one that imports its neighbour, and packages; not what is there.

    Whether an import in a function has been done makes no difference.
    """
    monkeypatch.syspath_prepend(tmp_path / "a")
    monkeypatch.syspath_prepend(tmp_path)
    files = {"a/parts.py": "def late():\n    import helper_of_parts\nimport numpy\n",
             "a/helper_of_parts.py": "", "b/parts.py": "", "laws_of_mine/__init__.py": "",
             "laws_of_mine/law.py": "", "loose/law.py": "from .gains import K\n",
             "loose/gains.py": "K = 3\n"}
    others = {"a/unused.py": "", "a/not_a_file.py/x": ""}
    for name, text in (files | others).items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    path = tmp_path / "mine.yaml"
    path.write_text("base: girona500_ideal\n"
                    "modules: [a/parts.py, b/parts.py, laws_of_mine, loose.law]\n",
                    encoding="utf-8")
    scenario = uv.load_scenario(str(path))
    before = fingerprint(scenario)["files"]
    importlib.import_module("helper_of_parts")
    assert fingerprint(scenario)["files"] == before
    for i, (name, text) in enumerate(files.items()):
        (tmp_path / name).write_text(f"{text}# Changed.\n", encoding="utf-8")
        after = fingerprint(scenario)["files"]
        assert sum(after[key] != before[key] for key in before) == i + 1, name
    assert sum(key.startswith("modules") for key in before) == len(files)


def test_a_file_that_the_robots_includes_counts(tmp_path):
    robot = shutil.copytree(model_dir("girona500_arm5e"), tmp_path / "girona500_arm5e")
    file, parts = next(robot.glob("*.sdf")), robot / "parts"
    parts.mkdir()
    (parts / "whole.sdf").write_text(file.read_text("utf-8"), "utf-8")
    name = re.search(r'<model name="([^"]+)"', file.read_text("utf-8"))[1]
    file.write_text(f'<sdf version="1.7"><model name="{name}"><include merge="true">'
                    "<uri>parts/whole.sdf</uri></include></model></sdf>", "utf-8")
    scenario = uv.load_scenario("girona500_ideal", [f"model={robot}"])
    before = fingerprint(scenario)["files"]
    text = (parts / "whole.sdf").read_text("utf-8")
    (parts / "whole.sdf").write_text(re.sub(
        r"<mass>([\d.]+)</mass>", lambda found: f"<mass>{float(found[1]) + 1.0}</mass>", text,
        count=1), "utf-8")
    assert fingerprint(scenario)["files"] != before


def test_the_modules_of_a_base_are_imported_too(tmp_path):
    base = written(tmp_path, "surface")
    (tmp_path / "my_law.py").write_text(HEAD + KINDS["law"][0], encoding="utf-8")
    over = tmp_path / "over.yaml"
    over.write_text(f"base: {base.name}\nmodules: [my_law.py]\nancillary: !Stiffer {{}}\n",
                    encoding="utf-8")
    scenario = uv.load_scenario(str(over))
    assert [Path(name).name for name in scenario.modules] == ["my_surface.py", "my_law.py"]
    assert type(scenario.ancillary).__name__ == "Stiffer"


@pytest.mark.parametrize(("source", "expected"), [
    (None, "modules[0] = '{path}': must be a Python file that exists (mine.yaml)"),
    ("1 / 0", "modules[0] = '{path}': must be a module that can be imported, which ends with "
              "ZeroDivisionError: division by zero (mine.yaml)")])
def test_a_module_that_cannot_be_imported_is_one_line(source, expected, tmp_path):
    module = tmp_path / "broken.py"
    if source is not None:
        module.write_text(source, encoding="utf-8")
    path = tmp_path / "mine.yaml"
    path.write_text("base: girona500_ideal\nmodules: [broken.py]\n", encoding="utf-8")
    assert error_of(str(path)) == expected.format(path=module)


def test_what_cannot_be_a_kind_is_refused_by_name():
    class Bare(uv.Surface):
        pass

    with pytest.raises(uv.InvalidParameter, match="register = 'Bare': must be a dataclass: "):
        uv.register(Bare)

    @dataclass
    class Needy(uv.AncillaryLaw):
        gain: float

    with pytest.raises(uv.InvalidParameter, match=r"Needy\.gain = 'required': must be given a def"):
        uv.register(Needy)

    @dataclass
    class Alone:
        gain: float = 1.0

    with pytest.raises(uv.InvalidParameter, match="register = 'Alone': must be derived from"):
        uv.register(Alone)

    @dataclass
    class Resolved(uv.AncillaryLaw):
        pass

    with pytest.raises(uv.InvalidParameter, match="register = 'Resolved': must be another name"):
        uv.register(Resolved)


def test_the_kinds_of_the_package_come_first_in_their_order():
    names = [kind.__name__ for kind in kinds_of(uv.Surface)]
    assert names == ["UnilateralPlane", "BilateralSpring", "ShapedSurface"]
    assert kinds_of(float) == ()
    assert load_typed(uv.Scenario, parse_yaml("surface: {stiffness: 5}")).surface.stiffness == 5.0
