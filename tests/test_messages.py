"""Texts that a user reads: keys that exist, and values as a file has them."""

import ast
import re
from collections import namedtuple
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from support.pages import PACKAGE
from support.refusals import OBJECT

import uvms_drake as uv
import uvms_drake.papers.nikou2018  # It has a law of its own.
from uvms_drake.certificate.text import violation
from uvms_drake.command.keys import keys_of
from uvms_drake.command.main import main
from uvms_drake.common.errors import InvalidParameter, ScenarioError
from uvms_drake.model.description.hydrodynamics_file import HydrodynamicParameters
from uvms_drake.model.description.thruster_file import ThrusterParameters
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.scenario.scenario_file import GONE_KEYS
from uvms_drake.tube.conditions import Condition

KEYS = {re.sub(r"!\w+", "", key) for key, _ in keys_of(Scenario())}
ROOTS = "|".join(sorted({key.partition(".")[0] for key in KEYS}))
NAMED = re.compile(rf"(?<![\w./{{}}\[\]:])((?:{ROOTS})(?:\[\d\])?(?:\.[a-z_][a-z_\d]*)+)(?![\w(])")
SUFFIXES = ("json", "png", "sdf", "yaml", "csv")
TOPICS = {"limits.contact_speed"}
"""Limits that no key of `limits` sets: names of a condition's topic, not printed."""


def texts(file: Path) -> list[str]:
    """Returns the texts in a file but for docstrings; a value in one is `{}`."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    left_out = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    left_out |= {id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr)
                 for part in node.values}
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            found += [] if id(node) in left_out else [node.value]
        elif isinstance(node, ast.JoinedStr):
            found.append("".join(str(part.value) if isinstance(part, ast.Constant) else "{}"
                                 for part in node.values))
    return found


def missing(text: str, keys: set[str]) -> list[str]:
    """Returns the keys in a text that are not there."""
    named = [re.sub(r"\[\d\]", "", key) for key in NAMED.findall(text)]
    return [key for key in named if key.rpartition(".")[2] not in SUFFIXES and not any(
        each == key or each.startswith(f"{key}.") for each in keys)]


def test_every_key_that_a_message_names_exists():
    """Those that went are named to say so."""
    known = KEYS | set(GONE_KEYS) | TOPICS | {"ancillary.joints"}
    said = [(file, text) for file in PACKAGE.rglob("*.py") for text in texts(file)]
    found = {f"{file.relative_to(PACKAGE)}: {key}"
             for file, text in said for key in missing(text, known)}
    assert found == set()
    assert missing("a larger contact.forc or mpc.horizon", known) == ["contact.forc"]
    assert sum(len(NAMED.findall(text)) for _, text in said) > 150


def test_every_key_of_a_robot_that_an_import_asks_for_exists():
    """As `bodies.*.drag` in hydrodynamics.yaml."""
    fields = {"bodies": {"displaced_volume", "center_of_buoyancy", "added_mass", "drag"},
              "kinds": {"curves", "lag", "smallest"}, "thrusters": {"kind", "position", "axis"}}
    assert {"bodies", "fluid_density"} <= set(vars(HydrodynamicParameters()))
    assert {"kinds", "thrusters", "undriven"} <= set(vars(ThrusterParameters()))
    named = [match for file in (PACKAGE / "model" / "robot_import").glob("*.py")
             for text in texts(file)
             for match in re.findall(r"(bodies|kinds|thrusters)\.(?:\*|vehicle|\{\})\.(\w+)", text)]
    assert len(named) > 5
    assert [(key, name) for key, name in named if name not in fields[key]] == []


@dataclass
class Part:
    size: np.ndarray = field(default_factory=lambda: np.ones(3))


Pair = namedtuple("Pair", "a b")


@pytest.mark.parametrize(("value", "text"), [
    (Part(), "!Part"), ([Part(), Part()], "[!Part, !Part]"), ({"a": Part()}, "{a: !Part}"),
    (np.float64(1.5), "1.5"), (np.array(2.5), "2.5"), ([np.float64(1.0), np.int64(2)], "[1.0, 2]"),
    (Path("there/x"), "'there/x'"), (Part, "!Part"), (None, "None"), ("text", "'text'"),
    (Pair(np.ones(2), 1), "[[1., 1.], 1]"), (True, "True"), (np.bool_(True), "True"),
    (lambda: 0, "!function")])
def test_no_value_of_a_message_is_an_object_of_python(value, text):
    message = str(InvalidParameter("key", value, "another"))
    assert message == f"key = {text}: must be another"
    assert not OBJECT.search(message)


@pytest.mark.parametrize(("scenario", "settings", "text"), [
    ("girona500_contact", ["sensing.0.range=[15,15,15,1,1,1]"],
     "sensing[0].range = [15., 15., 15., 1., 1., 1.]: must be more than 33.8 N "
     "at the tip"),
    ("girona500_contact", ["sensing=[!Navigation {}]"],
     "sensing = [!Navigation]: must be with a part that measures the force"),
    ("paper_kinematic", ["model_error.mass=1.1"], "model_error.mass = 1.1: must be left out"),
    ("paper_kinematic", ["waves=[{amplitude: 0.3}]"], "waves = [!Wave]: must be left out"),
    ("paper_kinematic", ["current=[1, 0, 0]"], "current = [1.0, 0.0, 0.0]: must be left out"),
    ("paper_kinematic", ["contact=!SensedContact {}"], "contact = !SensedContact: must be left"),
    ("paper_kinematic", ["faults=[!LostState {}]"], "faults = [!LostState]: must be left"),
    ("girona500_contact", ["sensing=[!ForceSensor {}, !ForceSensor {}]"],
     "sensing[1] = 'ForceSensor': must be left out"),
    ("girona500_contact", ["task.pose=null"], "task.pose = None: must be given: a wall leaves")])
def test_a_refused_part_is_named_by_its_key_and_value(scenario, settings, text, capsys):
    options = [word for each in settings for word in ("--set", each)]
    assert main(["run", scenario, "--uncertified", "--set", "duration=1", *options]) == 2
    err = capsys.readouterr().err
    assert text in err
    assert len(err) < 240
    assert not OBJECT.search(err)


@pytest.mark.parametrize("direction", [[0.99985, 0.0175, 0.0], [0.9995, 0.0, 0.0],
                                       [0.577, -0.577, 0.577]])
def test_a_direction_of_three_digits_gets_length_one(direction):
    loaded = uv.load_scenario("girona500_contact", [f"contact.direction={direction}"])
    assert np.linalg.norm(loaded.contact.direction) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(loaded.contact.direction, direction, atol=1e-3)
    with pytest.raises(ScenarioError, match=r"contact.direction = .* must be a unit vector"):
        uv.load_scenario("girona500_contact", ["contact.direction=[0.99, 0, 0]"])


def test_a_condition_that_fails_by_nothing_has_no_size():
    failed = Condition("terminal set, ε", 0.0, ">", 0.0, theorem="")
    assert violation(failed) == "terminal set, ε: 0 > 0 does not hold"
    assert violation(Condition("x", 1.0, "<", 0.5, theorem="")).endswith("does not hold by 0.5")
