"""Tests of `uvms_drake.visual`."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams
from pydrake.math import RigidTransform
from support.meshcat import packed_transform
from support.synthetic import synthetic_record

import uvms_drake as uv
from uvms_drake.control.limits import make_limits, tighten
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.report.replay import moment_of
from uvms_drake.station.diagram import setting_of
from uvms_drake.visual.objects import PLAN, Mark, round_magnification
from uvms_drake.visual.overlay import ACTIVE, NEAR, TIME, Overlay, Readout
from uvms_drake.visual.scene import CLOSE, LimitUse, Scene
from uvms_drake.visual.stage import INSTANT, UNSEEN, UP, VANISHED, Stage, VisualConfig, frame_at


@pytest.mark.parametrize("many", [12, 15, 20])
def test_no_text_is_on_the_bars(meshcat, many):
    """Time and the tube's caption, two lines of 0.055, are below the last row."""
    overlay = Overlay(
        Stage(meshcat), np.array([0.0, -4.0, 0.0]), np.zeros(3), 1.0, ["limit"] * many, "")
    lowest = min(packed_transform(meshcat, f"hud/limits/{i}")[2, 3] for i in range(many))
    end = lowest - 0.5 * Overlay.LINE
    assert end == pytest.approx(overlay.below)
    assert packed_transform(meshcat, "hud/time")[2, 3] + 0.5 * TIME < end
    assert packed_transform(meshcat, overlay.inset)[2, 3] / NEAR + 0.055 < end


@pytest.fixture(scope="module")
def record():
    return synthetic_record(4.0)


@pytest.mark.parametrize(("places", "given"), [
    ([1.0, 1.0, 1.0, 2.0, 3.0], [(0.0, 1.0), (2.0, 1.0), (3.0, 2.0), (4.0, 3.0)]),
    (0.3 * UNSEEN * np.arange(8), [(0.0, 0.0), (3.0, 0.0), (4.0, 1.2 * UNSEEN)])])
def test_a_stage_gives_a_value_once_again_before_it_changes_and_no_change_that_nobody_sees(
        places, given, canvas):
    stage = Stage(canvas)
    for time, x in enumerate(places):
        stage.begin(float(time))
        stage.move("it", RigidTransform([x, 0.0, 0.0]))
    assert [(time, pose.translation()[0]) for time, pose in canvas.places["it"]] == [
        (time, pytest.approx(x)) for time, x in given]


def test_what_is_not_shown_is_scaled_away_and_a_stage_starts_anew_when_time_does(canvas):
    stage = Stage(canvas)
    for time in (0.0, 1.0, 0.0):
        stage.begin(time)
        stage.show("it", False)
        stage.stretch("that", 1.0, 1.0, 0.0)
    assert canvas.scales == {"it": [(0.0, [VANISHED] * 3)] * 2,
                             "that": [(0.0, [1.0, 1.0, VANISHED])] * 2}


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
def test_a_readout_shows_the_digits_of_a_number(value, shown, canvas):
    readout = Readout(Stage(canvas), "number", " s", 99.0, 1.0, tenths="." in shown)
    readout.show(value)
    assert canvas.number("number") == shown.replace(".", "")


@pytest.mark.parametrize("rate", [5.0, 25.0, 100.0])
def test_digits_of_a_playing_replay_do_not_overlap(canvas, rate):
    """A recording interpolates: at nearly every instant exactly one digit has a size."""
    stage = Stage(canvas)
    readout = Readout(stage, "time", " s", 999.0, 1.0, tenths=True)
    times = np.arange(0.0, 2.0, 1.0 / rate)
    for time in times:
        stage.begin(time)
        readout.show(time)
    at = np.linspace(0.0, times[-1], 3001)
    last = [np.interp(at, *zip(*((time, scale[0]) for time, scale in canvas.scales[
        f"time/4/{digit}"]), strict=True)) for digit in range(10)]
    seen = np.sum(np.array(last) > 2.0 * VANISHED, axis=0)
    assert np.mean(seen != 1) <= 10.0 * 1.1 * INSTANT


def test_the_contact_is_marked_while_there_is_one(canvas):
    mark = Mark(Stage(canvas), "mark", PLAN, 0.1)
    for place in (None, np.ones(3), None):
        mark.show(place)
    assert [scale[0] for _, scale in canvas.scales["mark/size"]] == [VANISHED, 1.0, VANISHED]
    assert [tuple(pose.translation()) for _, pose in canvas.places["mark"]] == [(1.0, 1.0, 1.0)]


def test_the_ghost_is_off_by_the_magnified_deviation(meshcat, record):
    scenario = replace(record.scenario, visual=VisualConfig(magnification=20.0))
    Scene(meshcat, setting_of(scenario, record.model)).show(moment_of(record, 100), 0.0)
    real, ghost = (packed_transform(meshcat, f"ned/{name}/vehicle")[:3, 3]
                   for name in ("uvms", "nominal"))
    expected = 20.0 * (record.nominal_config[100, :3] - record.config[100, :3])
    np.testing.assert_allclose(ghost - real, expected, atol=1e-9)


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


def test_the_use_of_a_limit_is_told_of_the_real_and_of_the_nominal_motion(model, canvas):
    scenario = uv.load_scenario("girona500_ideal")
    limits = make_limits(scenario.limits, model.q_lower, model.q_upper, model.surface)
    use = LimitUse(model, limits, tighten(limits, scenario.tube))
    rest, u = np.concatenate([scenario.start.eta, scenario.start.q, np.zeros(10)]), np.zeros(10)
    real, planned = (dict(zip(use.names, each, strict=True)) for each in use(rest, u, rest, u))
    assert real["vehicle speed  ≤ 0.25 m/s"] == planned["vehicle speed  ≤ 0.25 m/s"] == 0.0
    assert real["vehicle roll  ≤ 0.15 rad"] == pytest.approx(0.03 / 0.15)
    assert planned["vehicle roll  ≤ 0.15 rad"] == pytest.approx(0.03 / (0.15 - scenario.tube.roll))
    fast = rest.copy()
    fast[10] = 0.24
    assert use(fast, u, rest, u)[:, 0] == pytest.approx([0.24 / 0.25, 0.0])
    assert use(rest, u, fast, u)[:, 0] == pytest.approx([0.0, 0.24 / 0.24])
    assert use(rest, scenario.limits.u, rest, u)[0, use.names.index("input u, worst of 10")] == 1.0
    pressing = np.concatenate([model.configuration(uv.make_ocp(scenario).y_des), np.zeros(10)])
    force = use(pressing, u, pressing, u)[:, use.names.index("force, at rest  ≤ 45 N")]
    assert force == pytest.approx([20.0 / 45.0, 20.0 / 43.0])
    # A plan at its tightened limit is a mark at the end of the bar, and no alarm.
    overlay = Overlay(
        Stage(canvas), np.array([0.0, -4.0, 0.0]), np.zeros(3), 1.0, use.names, "")
    overlay.show(0.0, *use(rest, u, fast, u))
    assert canvas.scales["hud/limits/0/active"][-1][1] == [VANISHED] * 3
    assert canvas.places["hud/limits/0/plan"][-1][1].translation()[0] >= ACTIVE * Overlay.LENGTH
    overlay.show(1.0, *use(1.05 * fast, u, rest, u))
    assert canvas.scales["hud/limits/0/active"][-1][1] == [1.0] * 3


@pytest.mark.parametrize("heading", [0.5 * np.pi, np.pi, -1.2])
def test_the_camera_turns_with_the_wall(meshcat, record, heading):
    setting = setting_of(record.scenario, record.model)
    turn = rotation_matrix(np.array([0.0, 0.0, heading]))
    start = np.concatenate([turn @ setting.start[:3], setting.start[3:]])
    start[5] += heading
    turned = replace(setting, start=start, heading=heading,
                     goal=np.append(turn @ setting.goal[:3], setting.goal[3:]))
    north, other = Scene(meshcat, setting), Scene(meshcat, turned)
    for name in ("camera", "target"):
        np.testing.assert_allclose(UP * getattr(other, name), turn @ (UP * getattr(north, name)),
                                   atol=1e-9)
