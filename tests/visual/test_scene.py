"""Tests of `uvms_drake.visual`."""

from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from support.meshcat import packed_transform
from support.synthetic import synthetic_record

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.limits import make_limits, tighten
from uvms_drake.report.replay import moment_of
from uvms_drake.station.problem import make_ocp
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.scene_setting import setting_of
from uvms_drake.visual.config import VisualConfig, check_visual
from uvms_drake.visual.controls import DISTURBANCE, FORCE, DisturbanceSlider, ForceSlider
from uvms_drake.visual.limit_use import ACTIVE, LimitUse
from uvms_drake.visual.objects.bars import Bars
from uvms_drake.visual.objects.hud import NEAR, Hud
from uvms_drake.visual.objects.props import PLAN, Mark
from uvms_drake.visual.objects.readout import Readout
from uvms_drake.visual.objects.tube import round_magnification
from uvms_drake.visual.scene import CLOSE, Scene
from uvms_drake.visual.stage import UNSEEN, VANISHED, Stage, frame_at

FORCE_DES = np.array([20.0, 0.0, 0.0, 0.0, 0.0, 0.0])


class Given:
    """A Meshcat that records its calls."""

    def __init__(self):
        self.transforms, self.scales = [], []

    def SetTransform(self, path, pose, time_in_recording=None):
        self.transforms.append((path, time_in_recording, tuple(pose.translation())))

    def SetProperty(self, path, name, value, time_in_recording=None):
        self.scales.append((path, time_in_recording, value))


def quiet_stage(given):
    """Returns a stage that forgets its objects and their properties."""
    given.SetObject = lambda *_: None
    stage = Stage(given)
    stage.see_through = lambda *_: None
    return stage


@pytest.fixture
def meshcat():
    return Meshcat(MeshcatParams(host="localhost"))


@pytest.mark.parametrize("many", [12, 15, 20])
def test_no_text_is_on_the_bars(meshcat, many):
    """Time and the tube's caption, two lines of 0.055, are below the last row."""
    hud = Hud(Stage(meshcat), np.array([0.0, -4.0, 0.0]), np.zeros(3), 1.0, ["limit"] * many, "")
    lowest = min(packed_transform(meshcat, f"hud/limits/{i}")[2, 3] for i in range(many))
    end = packed_transform(meshcat, "hud/limits")[2, 3] + lowest - 0.5 * Bars.LINE
    assert end == pytest.approx(hud.below)
    assert packed_transform(meshcat, "hud/time")[2, 3] + 0.5 * 0.085 < end
    assert packed_transform(meshcat, hud.inset)[2, 3] / NEAR + 0.055 < end


@pytest.fixture(scope="module")
def record():
    return synthetic_record(4.0)


def test_a_stage_gives_a_value_once_and_again_before_it_changes():
    given = Given()
    stage = Stage(given)
    given.transforms.clear()
    for time, x in ((0.0, 1.0), (1.0, 1.0), (2.0, 1.0), (3.0, 2.0), (4.0, 3.0)):
        stage.begin(time)
        stage.move("it", RigidTransform([x, 0.0, 0.0]))
    assert [(time, position[0]) for _, time, position in given.transforms] == [
        (0.0, 1.0), (2.0, 1.0), (3.0, 2.0), (4.0, 3.0)]


def test_a_change_that_nobody_sees_is_not_given_until_many_of_them_can_be_seen():
    given = Given()
    stage = Stage(given)
    given.transforms.clear()
    places = 0.3 * UNSEEN * np.arange(8)
    for time, x in enumerate(places):
        stage.begin(float(time))
        stage.move("it", RigidTransform([x, 0.0, 0.0]))
    assert [(time, position[0]) for _, time, position in given.transforms] == [
        (0.0, 0.0), (3.0, 0.0), (4.0, places[4])]


def test_what_is_not_shown_is_scaled_away():
    given = Given()
    stage = Stage(given)
    stage.begin(0.0)
    stage.show("it", False)
    stage.stretch("that", 1.0, 1.0, 0.0)
    assert given.scales == [("it", 0.0, [VANISHED] * 3), ("that", 0.0, [1.0, 1.0, VANISHED])]


def test_a_stage_starts_anew_when_time_does():
    given = Given()
    stage = Stage(given)
    for time in (0.0, 1.0, 0.0):
        stage.begin(time)
        stage.show("it", True)
    assert [time for _, time, _ in given.scales] == [0.0, 0.0]


@pytest.mark.parametrize("axis", [[1.0, 0.0, 0.0], [0.3, -2.0, 0.1], [0.0, 0.0, -3.0]])
def test_a_frame_along_an_axis(axis):
    X = frame_at([1.0, 2.0, 3.0], np.array(axis))
    np.testing.assert_allclose(X.rotation().matrix()[:, 2], axis / np.linalg.norm(axis))
    np.testing.assert_array_equal(X.translation(), [1.0, 2.0, 3.0])


@pytest.mark.parametrize(("radius", "expected"), [
    (0.002, 50.0), (0.0017, 50.0), (0.02, 5.0), (0.3, 1.0), (0.0, 1.0), (0.09, 1.0)])
def test_the_magnification_is_a_round_number(radius, expected):
    assert round_magnification(radius, 0.1) == expected


@pytest.mark.parametrize(("value", "shown"), [
    (0.04, "0.0"), (7.26, "7.3"), (12.3, "12.3"), (99.96, "99.9"), (-1.0, "0.0"), (9.96, "10.0"),
    (0.4, "0"), (7.6, "8"), (12.3, "12"), (123.0, "99"), (-1.0, "0")])
def test_a_readout_shows_the_digits_of_a_number(value, shown):
    given, tenths = Given(), "." in shown
    readout = Readout(quiet_stage(given), "number", "t = ", " s", 99.0, 1.0, tenths=tenths)
    readout.show(value)
    digits = {path.split("/")[1]: path.split("/")[2] for path, _, scale in given.scales
              if scale == [1.0, 1.0, 1.0]}
    whole = "".join(digits.get(power, "") for power in ("2", "1"))
    assert (f"{whole}.{digits['0']}" if tenths else whole) == shown


def test_the_contact_is_marked_while_there_is_one(record):
    given = Given()
    mark = Mark(quiet_stage(given), "mark", PLAN, 0.1)
    for place in (None, np.ones(3), None):
        mark.show(place)
    assert [scale[0] for _, _, scale in given.scales[-3:]] == [VANISHED, 1.0, VANISHED]
    assert ("mark", -np.inf, (1.0, 1.0, 1.0)) in given.transforms


def test_the_tube_is_where_the_nominal_tip_is(meshcat, record, model):
    Scene(meshcat, setting_of(record.scenario, record.model)).show(moment_of(record, 100), 0.0)
    nominal = model.task_pose(record.nominal_config[100])[:3]
    np.testing.assert_allclose(packed_transform(meshcat, "ned/tube")[:3, 3], nominal, atol=1e-9)


def test_a_close_look_is_from_the_same_side(record, monkeypatch):
    seen = []
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    scene = Scene(meshcat, setting_of(record.scenario, record.model))
    monkeypatch.setattr(
        scene, "_stage", SimpleNamespace(meshcat=SimpleNamespace(SetCameraPose=lambda *pose:
                                                                 seen.append(pose))))
    scene.look_closely(np.array([0.1, 0.2, 0.3]))
    ((camera, target),) = seen
    np.testing.assert_allclose(target, [0.1, -0.2, -0.3])
    assert np.linalg.norm(camera - target) == pytest.approx(CLOSE)
    np.testing.assert_allclose(
        np.cross(camera - target, scene.camera - scene.target), 0.0, atol=1e-9)
    assert (camera - target) @ (scene.camera - scene.target) > 0.0


def test_a_limit_is_active_if_the_real_or_the_nominal_motion_uses_it_up(model):
    scenario = load_scenario("girona500_ideal")
    limits = make_limits(scenario.limits, model.q_lower, model.q_upper, model.surface)
    use = LimitUse(model, limits, tighten(limits, scenario.tube))
    rest, u = np.concatenate([scenario.start.eta, scenario.start.q, np.zeros(10)]), np.zeros(10)
    used = dict(zip(use.names, use(rest, u, rest, u), strict=True))
    assert used["vehicle speed  ≤ 0.25 m/s"] == 0.0
    assert used["vehicle roll  ≤ 0.15 rad"] == pytest.approx(0.03 / (0.15 - scenario.tube.roll))
    fast = rest.copy()
    fast[10] = 0.24
    for real, nominal, speed in ((fast, rest, 0.24 / 0.25), (rest, fast, 0.24 / 0.24)):
        assert use(real, u, nominal, u)[0] == pytest.approx(speed)
    assert use(rest, u, fast, u)[0] >= ACTIVE > use(fast, u, rest, u)[0]
    assert use(rest, scenario.limits.u, rest, u)[use.names.index("input u, worst of 10")] == 1.0
    pressing = np.concatenate([model.configuration(make_ocp(scenario).y_des), np.zeros(10)])
    for real, nominal, room in ((rest, rest, np.inf), (pressing, rest, 45.0), (rest, pressing, 43)):
        used = use(real, u, nominal, u)[use.names.index("force, at rest  ≤ 45 N")]
        assert used == pytest.approx(20.0 / room)


def test_the_slider_says_what_the_task_does_until_it_is_moved(meshcat):
    slider = ForceSlider.AddToBuilder(DiagramBuilder(), FORCE_DES, meshcat)
    port = slider.GetOutputPort("force")
    context = slider.CreateDefaultContext()
    np.testing.assert_array_equal(port.Eval(context), FORCE_DES)
    meshcat.SetSliderValue(FORCE, 30.0)
    context.SetTime(0.1)
    np.testing.assert_allclose(port.Eval(context), 1.5 * FORCE_DES)


def test_a_force_between_the_sliders_steps_is_not_rounded(meshcat):
    force = np.array([3.0, 4.0, 12.1, 0.0, 0.0, 0.5])
    slider = ForceSlider(force, meshcat)
    np.testing.assert_array_equal(
        slider.GetOutputPort("force").Eval(slider.CreateDefaultContext()), force)


@pytest.mark.parametrize("force", [FORCE_DES, np.zeros(6)])
def test_without_meshcat_or_force_there_is_no_slider(force, meshcat):
    slider = ForceSlider(force, None if np.any(force) else meshcat)
    np.testing.assert_array_equal(
        slider.GetOutputPort("force").Eval(slider.CreateDefaultContext()), force)
    assert FORCE not in meshcat.GetSliderNames()


def test_a_part_of_the_disturbance_is_let_through(meshcat):
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource(np.array([0.3, -0.1])))
    slider = DisturbanceSlider.AddToBuilder(
        builder, meshcat, disturbance=source.get_output_port())
    diagram = builder.Build()
    for percent, part in ((None, 1.0), (40.0, 0.4), (0.0, 0.0)):
        if percent is not None:
            meshcat.SetSliderValue(DISTURBANCE, percent)
        context = slider.GetMyContextFromRoot(diagram.CreateDefaultContext())
        np.testing.assert_array_equal(slider.get_output_port().Eval(context), [
            part * 0.3, part * -0.1])


@pytest.mark.parametrize(("config", "message"), [
    (VisualConfig(rate=0.5), "visual.rate = 0.5: must be 1 to 100"),
    (VisualConfig(magnification=0.5), "visual.magnification = 0.5: must be at least 1")])
def test_what_has_no_meaning_is_refused(config, message):
    with pytest.raises(InvalidParameter, match=message):
        check_visual(config)
