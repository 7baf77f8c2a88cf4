"""Tests of `uvms_drake.visual.contact`: the surface, its estimate, and the paint."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.common.value import Value
from support.shapes import SHAPES, turned
from support.synthetic import synthetic_record

from uvms_drake.model.surface.geometry import Cylinder, Plane
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.surface.shaped_surface import ShapedSurface
from uvms_drake.report.replay import moment_of
from uvms_drake.station.diagram import setting_of
from uvms_drake.visual.contact import (
    COLORS,
    DOT,
    SIZE,
    Coverage,
    DrawnEstimate,
    at_depth,
    color_of,
    draw_surface,
    palette,
)
from uvms_drake.visual.scene import Illustration, Scene
from uvms_drake.visual.stage import VANISHED, Stage

NORTH = np.array([1.0, 0.0, 0.0])
ASLANT = np.array([0.48, -0.6, 0.64])
FORCE = np.array([12.0, 5.0, -3.0, 0.0, 0.0, 0.0])
SAFE_END, FRAME = DrawnEstimate.SAFE_END, DrawnEstimate.WALL
TIP = np.array([0.3, 0.2, -0.4])
HIDDEN, SEEN = [VANISHED] * 3, [1.0] * 3
WALL = UnilateralPlane(normal=-NORTH, stiffness=1000.0).checked()
SCALE = 15.0  # N


def estimate(safe, contact, stiffness, force=FORCE):
    return {"force_last_valid": force, "safe_depth": np.array([safe]),
            "contact_depth": np.array([contact]), "stiffness_estimate": np.array([stiffness])}


def shown(canvas, values, direction=ASLANT, start=(0.0, 0.0, 0.0)):
    drawn = DrawnEstimate(Stage(canvas), "board", direction, 0.004, np.array(start))
    drawn.show(values, TIP)
    return drawn


# The surface.


@pytest.mark.parametrize("shape", [*map(turned, SHAPES.values()), Cylinder(radius=0.05)],
                         ids=[*SHAPES, "thin pole"])
def test_the_sheet_is_on_the_surface_with_lines_every_tenth_of_a_metre(shape, canvas):
    surface = ShapedSurface(shape).checked()
    deform = draw_surface(Stage(canvas), surface, shape.point)
    deform(np.zeros(6))
    if surface.normal is not None:
        return
    np.testing.assert_allclose(shape.depth(canvas.sheets["ned/wall/skin"]), 0.0, atol=1e-14)
    begin, end = canvas.sheets["ned/wall/lines"]
    np.testing.assert_allclose(shape.depth(begin), 0.0, atol=1e-14)
    assert np.max(np.linalg.norm(end - begin, axis=1)) < 0.02
    assert len(begin) == 2 * 11 * 60


@pytest.mark.parametrize("normal", [-NORTH, -ASLANT])
def test_a_wall_has_a_dent_as_deep_as_the_tip(normal, canvas):
    wall = UnilateralPlane(normal=normal, stiffness=1000.0).checked()
    goal = np.array([0.1, 0.2, 0.3])
    deform = draw_surface(Stage(canvas), wall, goal)
    sheet = canvas.sheets["ned/wall/depth/skin"]
    assert np.ptp(sheet[..., 0]) == np.ptp(sheet[..., 1]) == SIZE
    assert (np.min(sheet[..., 2]), np.max(sheet[..., 2])) == pytest.approx((-1.0, 0.0), abs=1e-9)
    ((_, frame),) = canvas.places["ned/wall"]
    np.testing.assert_allclose(frame.rotation().matrix()[:, 2], normal)
    assert (frame.translation() - wall.anchor) @ normal == pytest.approx(0.0)
    chi = np.concatenate([wall.anchor - 0.02 * normal, np.zeros(3)])
    deform(chi)
    assert canvas.scale("ned/wall/depth")[2] == pytest.approx(wall.penetration(chi))


@pytest.mark.parametrize(("geometry", "dented"), [
    (Plane(), True), (Cylinder(radius=0.3), False)], ids=["plane", "hull"])
def test_a_scene_has_the_surface_and_no_spring(geometry, dented, canvas):
    record = synthetic_record(0.2)
    limits = replace(record.scenario.limits, static_force=None)
    scenario = replace(record.scenario, surface=ShapedSurface(geometry), limits=limits)
    record = replace(record, scenario=scenario)
    Scene(canvas, setting_of(scenario, record.model)).show(moment_of(record, 0), 0.0)
    assert f"ned/wall/{'depth/' if dented else ''}skin" in canvas.sheets
    assert not any(path.startswith("ned/spring") for path in canvas.colors)
    assert not {SAFE_END, FRAME, "board/measured"} & set(canvas.places)  # It is known.


# The estimate.


@pytest.mark.parametrize("direction", [NORTH, ASLANT])
def test_pane_and_frame_are_across_n_at_their_depths_beside_the_tip(direction, canvas):
    drawn = shown(canvas, estimate(0.081, 0.057, 900.0), direction)
    for path, depth in ((SAFE_END, 0.085), (FRAME, 0.057)):
        X = canvas.places[path][-1][1].GetAsMatrix34()
        corners = X[:, :2] @ [[1.0, -1.0, 0.3], [1.0, 0.2, -1.0]] + X[:, 3:]
        np.testing.assert_allclose(direction @ corners, depth, atol=1e-12)
        np.testing.assert_allclose(np.cross(X[:, 3] - TIP, direction), 0.0, atol=1e-12)
    drawn.show(estimate(0.2, 0.057, 900.0), TIP)  # The front goes ahead.
    np.testing.assert_allclose(
        canvas.places[SAFE_END][-1][1].translation(), at_depth(TIP, 0.204, direction), atol=1e-12)


def test_nothing_is_explored_or_believed_before_it_is(canvas):
    drawn = shown(canvas, {})
    for values, front, wall in (
            (estimate(-np.inf, np.nan, 1000.0), HIDDEN, HIDDEN),
            (estimate(0.1, np.nan, 1000.0), SEEN, HIDDEN), (estimate(0.1, 0.05, 1e3), SEEN, SEEN),
            (estimate(0.1, np.nan, 1000.0), SEEN, HIDDEN), ({}, HIDDEN, HIDDEN)):
        drawn.show(values, TIP)
        assert canvas.scale(f"{SAFE_END}/size") == front
        assert canvas.scale(f"{FRAME}/size") == wall


def test_the_numbers_are_the_force_along_n_the_way_explored_and_the_stiffness(canvas):
    start = np.array([-0.3, 0.1, 0.0])
    shown(canvas, estimate(0.1, 0.05, 734.0, 10.0 * FORCE), start=start)
    assert {name: int(canvas.number(f"board/{name}/number")) for name in (
        "measured", "stiffness", "explored")} == {
            "measured": round(10.0 * FORCE[:3] @ ASLANT), "stiffness": 734,
            "explored": round(1e3 * (0.1 + 0.004 - start @ ASLANT))}


@pytest.mark.parametrize("known", [True, False])
def test_an_illustration_shows_what_its_ports_say(known, canvas):
    record = synthetic_record(0.2)
    setting = replace(setting_of(record.scenario, record.model), direction=NORTH, margin=0.004)
    system = Illustration(canvas, setting)
    context, moment = system.CreateDefaultContext(), moment_of(record, 0)
    config = np.tile(record.nominal_config[0], (setting.horizon + 1, 1))
    values = {"state": moment.state, "nominal_state": moment.nominal_state, "u": moment.u,
              "nominal_input": moment.nominal_input, "force": moment.force,
              "desired_force": moment.desired_force, "plan": Value(SimpleNamespace(config=config)),
              **(estimate(0.08, 0.05, 800.0) if known else {})}
    for name, value in values.items():
        system.GetInputPort(name).FixValue(context, value)
    system.ForcedPublish(context)
    for path, depth in ((SAFE_END, 0.084), (FRAME, 0.05)):
        assert canvas.scale(f"{path}/size") == (SEEN if known else HIDDEN)
        if known:
            assert canvas.places[path][-1][1].translation()[0] == pytest.approx(depth)


# The paint.


def painted_by(canvas, *touches):
    """Paints, 40 ms after each other, (y [m], force [N]); returns colour and place of each dot."""
    stage = Stage(canvas)
    coverage = Coverage(stage, "paint", "legend", SCALE, WALL.normal)
    for i, (y, force) in enumerate(touches):
        stage.begin(0.04 * i)
        chi = np.array([0.001 * max(force, 0.0), y, 0.2, 0.0, 0.0, 0.0])
        coverage.show(chi, np.array([force, 5.0, 0.0, 0.0, 0.0, 0.0]), WALL)
    dots = [path.removesuffix("/size/dot") for path in canvas.colors if path.endswith("/size/dot")]
    return [(palette().index(pytest.approx(canvas.colors[f"{dot}/size/dot"])),
             canvas.places[dot][-1][1].translation())
            for dot in dots if canvas.scale(f"{dot}/size") == SEEN]


def test_colours_are_ranges_of_one_width_of_the_force_and_differ():
    width = SCALE / COLORS
    assert [color_of(width * (c + 0.5), SCALE) for c in range(COLORS)] == list(range(COLORS))
    assert [color_of(force, SCALE) for force in (-3.0, 99.0)] == [0, COLORS - 1]
    assert len(set(palette())) == COLORS


def test_a_slide_is_a_row_of_dots_on_the_surface(canvas):
    painted = painted_by(canvas, *((y, 10.0) for y in np.arange(0.0, 0.1, 0.001)))
    assert {color for color, _ in painted} == {color_of(10.0, SCALE)}
    places = np.array([place for _, place in painted])
    assert places[:, 0] == pytest.approx(0.0, abs=1e-9), "not as deep as the tip is"
    assert np.ptp(places[:, 1]) == pytest.approx(0.1, abs=DOT + 0.001)
    assert np.diff(np.sort(places[:, 1])) == pytest.approx(DOT, abs=0.0011)


def test_a_place_that_is_held_has_the_last_colour_alone_and_off_the_wall_there_is_none(canvas):
    assert painted_by(canvas, (0.0, 0.0), (0.1, 1.0), (0.2, -4.0)) == []
    painted = painted_by(canvas, (0.0, 4.0), (0.0, 8.0), (0.0005, 12.0))
    assert [color for color, _ in painted] == [color_of(12.0, SCALE)]


def test_in_a_recording_a_dot_is_there_from_its_touch_to_the_next_one(canvas):
    painted_by(canvas, (0.0, 0.0), (0.0, 4.0), (0.0, 4.0), (0.0, 12.0))
    times, sizes = zip(*canvas.scales["paint/1/size"], strict=True)
    assert times == pytest.approx((0.0, 0.039, 0.04, 0.119, 0.12))
    assert sizes == (HIDDEN, HIDDEN, SEEN, SEEN, HIDDEN)
