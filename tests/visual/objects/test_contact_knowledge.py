"""Tests of `visual.objects.contact_knowledge`."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.geometry import Meshcat, MeshcatParams
from support.meshcat import packed_transform
from support.synthetic import synthetic_record

from uvms_drake.report.replay import moment_of
from uvms_drake.station.scene_setting import setting_of
from uvms_drake.visual.illustration import Illustration
from uvms_drake.visual.objects.contact_knowledge import (
    EXPLORED,
    KNOWN,
    ContactKnowledge,
    ContactSpecification,
    DrawnKnowledge,
    at_depth,
    contact_knowledge_from,
    pane,
)
from uvms_drake.visual.scene import Scene
from uvms_drake.visual.stage import VANISHED, Stage

NORTH = np.array([1.0, 0.0, 0.0])
ASLANT = np.array([0.48, -0.6, 0.64])
FORCE = np.array([12.0, 5.0, -3.0, 0.0, 0.0, 0.0])
SAFE_END, WALL = DrawnKnowledge.SAFE_END, DrawnKnowledge.WALL


@pytest.fixture
def meshcat():
    return Meshcat(MeshcatParams(host="localhost"))


TIP = np.array([0.3, 0.2, -0.4])


def drawn(meshcat, known, direction=ASLANT):
    knowledge = DrawnKnowledge(
        Stage(meshcat), "hud/board", ContactSpecification(direction, 0.004), np.zeros(3))
    knowledge.show(known, TIP)
    return knowledge


def scale(path, shown):
    """Returns the last scale that a path was given."""
    return [value for name, _, value in shown if name == path][-1]


@pytest.mark.parametrize("direction", [NORTH, ASLANT])
def test_a_place_at_a_depth_is_beside_the_point(direction):
    point = np.array([0.3, -0.2, 0.7])
    place = at_depth(point, 0.25, direction)
    assert direction @ place == pytest.approx(0.25)
    np.testing.assert_allclose(np.cross(place - point, direction), 0.0, atol=1e-15)


@pytest.mark.parametrize("direction", [NORTH, ASLANT])
def test_the_pane_is_across_n_at_the_safe_depth_and_the_margin(direction, meshcat):
    drawn(meshcat, ContactKnowledge(FORCE, 0.081, 0.057, 900.0), direction)
    for path, depth in ((SAFE_END, 0.085), (WALL, 0.057)):
        X = packed_transform(meshcat, path)
        corners = X[:3, :2] @ [[1.0, -1.0, 0.3], [1.0, 0.2, -1.0]] + X[:3, 3:]
        np.testing.assert_allclose(direction @ corners, depth, atol=1e-12)
        np.testing.assert_allclose(np.cross(X[:3, 3] - TIP, direction), 0.0, atol=1e-12)


def test_the_pane_goes_ahead_as_the_front_does(meshcat):
    knowledge = drawn(meshcat, ContactKnowledge(FORCE, -0.2, np.nan, 1000.0), NORTH)
    for safe in (-0.1, 0.0, 0.0871):
        knowledge.show(ContactKnowledge(FORCE, safe, np.nan, 1000.0), TIP)
        place = packed_transform(meshcat, SAFE_END)[:3, 3]
        np.testing.assert_allclose(place, [safe + 0.004, 0.2, -0.4], atol=1e-12)


class Sizes(Meshcat):
    """A Meshcat that remembers the scales it was given."""

    def __init__(self):
        super().__init__(MeshcatParams(host="localhost"))
        self.given = []

    def SetProperty(self, path, name, value, time_in_recording=None):
        if name == "scale":
            self.given.append((path, time_in_recording, value))


def test_nothing_is_explored_or_believed_before_it_is():
    sizes = Sizes()
    knowledge = drawn(sizes, ContactKnowledge(FORCE, -np.inf, np.nan, 1000.0))
    hidden, seen = [VANISHED] * 3, [1.0] * 3
    for known, front, wall in (
            (ContactKnowledge(FORCE, -np.inf, np.nan, 1000.0), hidden, hidden),
            (ContactKnowledge(FORCE, 0.1, np.nan, 1000.0), seen, hidden),
            (ContactKnowledge(FORCE, 0.1, 0.05, 1000.0), seen, seen),
            (ContactKnowledge(FORCE, 0.1, np.nan, 1000.0), seen, hidden)):
        knowledge.show(known, TIP)
        assert scale(f"{SAFE_END}/size", sizes.given) == front
        assert scale(f"{WALL}/size", sizes.given) == wall


def test_the_numbers_are_the_force_along_n_the_way_explored_and_the_stiffness():
    sizes = Sizes()
    start = np.array([-0.3, 0.1, 0.0])
    knowledge = DrawnKnowledge(Stage(sizes), "board", ContactSpecification(ASLANT, 0.004), start)
    knowledge.show(ContactKnowledge(FORCE * 10.0, 0.1, 0.05, 734.0), TIP)
    for name, value in (
            ("measured", FORCE[:3] @ ASLANT * 10.0), ("stiffness", 734.0),
            ("explored", 1e3 * (0.1 + 0.004 - start @ ASLANT))):
        digits = {}
        for path, _, size in sizes.given:
            if path.startswith(f"board/{name}/number/"):
                power, digit = path.split("/")[3:5]
                digits[int(power), digit] = size == [1.0] * 3
        shown = "".join(digit for (_, digit), on in sorted(digits.items(), reverse=True) if on)
        assert int(shown) == round(value)


def test_the_pane_is_glass_with_a_rim():
    picture = pane()
    assert np.all(picture[[0, -1], :, 3] > 200)
    assert np.all(picture[:, [0, -1], 3] > 200)
    assert 0 < picture[120, 120, 3] < 100
    np.testing.assert_array_equal(picture[120, 120, :3], (255.0 * np.array(EXPLORED)).astype(int))


def test_what_is_not_all_there_is_not_known():
    signals = {name: np.arange(float(size)) for name, size in KNOWN.items()}
    known = contact_knowledge_from({**signals, "more": np.zeros(2)})
    np.testing.assert_array_equal(known.force_last_valid, np.arange(6.0))
    assert (known.safe_depth, known.contact_depth, known.stiffness_estimate) == (0.0, 0.0, 0.0)
    for name in KNOWN:
        nothing = contact_knowledge_from(
            {key: value for key, value in signals.items() if key != name})
        assert nothing.safe_depth == -np.inf
        assert np.isnan(nothing.contact_depth)


def test_a_robot_that_does_not_feel_its_way_has_neither(meshcat):
    record = synthetic_record(0.2)
    Scene(meshcat, setting_of(record.scenario, record.model)).show(moment_of(record, 0), 0.0)
    assert not any(meshcat.HasPath(path) for path in (SAFE_END, WALL, "hud/board/measured"))


def illustrated(meshcat, **signals):
    """Shows an instant of a synthetic record, with these signals at an Illustration's ports."""
    record = synthetic_record(0.2)
    setting = replace(setting_of(record.scenario, record.model),
                      specification=ContactSpecification(NORTH, 0.004))
    system = Illustration(meshcat, setting)
    context, moment = system.CreateDefaultContext(), moment_of(record, 0)
    config = np.tile(record.nominal_config[0], (setting.horizon + 1, 1))
    values = {"state": moment.state, "nominal_state": moment.nominal_state, "u": moment.u,
              "nominal_input": moment.nominal_input, "plan": Value(SimpleNamespace(config=config))}
    for name, value in {**values, **signals}.items():
        system.GetInputPort(name).FixValue(context, value)
    system.ForcedPublish(context)


def test_an_illustration_shows_what_its_ports_say(meshcat):
    illustrated(meshcat, force_last_valid=FORCE, safe_depth=[0.08], contact_depth=[0.05],
                stiffness_estimate=[800.0])
    for path, depth in ((SAFE_END, 0.084), (WALL, 0.05)):
        assert packed_transform(meshcat, path)[0, 3] == pytest.approx(depth)


def test_an_illustration_whose_ports_say_nothing_shows_nothing_known():
    sizes = Sizes()
    illustrated(sizes)
    for path in (SAFE_END, WALL):
        assert scale(f"{path}/size", sizes.given) == [VANISHED] * 3
