"""Tests of `uvms_drake.report.figures`."""

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.image import imread
from support.synthetic import desiring, synthetic_record

from uvms_drake.control.limits import TubeRadii
from uvms_drake.papers.nikou2018 import Transpose
from uvms_drake.plant.surface_error import SurfaceError
from uvms_drake.report.figure_style import COLUMN_WIDTH, ORANGE, STYLE, tube_label
from uvms_drake.report.figures import FIGURES, UNCERTIFIED, make_figures

TIMED = {"task_error.png", "force.png", "velocities.png", "joints.png", "inputs.png",
         "disturbance.png", "mpc.png", "deviation.png"}
NAMES = TIMED | {"robot.png"}
SETTLED = "counts as settled, $\\pm$"
WITH_TUBE = {"task_error.png", "velocities.png", "joints.png", "inputs.png", "deviation.png"}


@pytest.fixture(scope="module")
def record():
    return synthetic_record(4.0)


def axes_of(name, record):
    with matplotlib.rc_context(STYLE):
        return FIGURES[name](record).axes


def levels(axis, label):
    """Returns the heights of an axis's horizontal lines with a label, the lowest first."""
    return sorted(float(line.get_ydata()[0]) for line in axis.get_lines()
                  if line.get_label() == label)


def test_how_deep_it_may_go_is_drawn_in_a_plane_that_is_known(record):
    axis = axes_of("force.png", record)[1]
    assert levels(axis, "limit") == pytest.approx([46.0])
    assert levels(axis, "tightened") == pytest.approx([41.0])  # 5 mm of tube
    base = record.scenario
    for other in (replace(base, surface_error=SurfaceError(stiffness=1.1)),
                  replace(base, limits=replace(base.limits, static_force=None))):
        axis = axes_of("force.png", replace(record, scenario=other))[1]
        assert levels(axis, "limit") == levels(axis, "tightened") == []


def texts_of(figure):
    return " ".join(text.get_text() for text in figure.findobj(matplotlib.text.Text))


def test_every_figure_is_a_readable_png_at_column_width(record, tmp_path):
    paths = make_figures(record, str(tmp_path / "not" / "there"))
    rare = {"coverage.png", "mission.png", "thrusters.png"}
    assert {path.name for path in paths} == NAMES == set(FIGURES) - rare
    for path in paths:
        width = imread(path).shape[1]
        assert width in (COLUMN_WIDTH * STYLE["savefig.dpi"], 2 * COLUMN_WIDTH * 300)


@pytest.mark.long
def test_figures_leave_the_style_of_the_caller_alone(record, tmp_path):
    before = dict(matplotlib.rcParams)
    make_figures(record, tmp_path)
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("name", sorted(TIMED))
def test_every_visible_axis_has_a_label_with_its_unit(record, name):
    with matplotlib.rc_context(STYLE):
        figure = FIGURES[name](record)
    labels = [axis.get_ylabel() for axis in figure.axes if axis.get_visible()]
    if name == "task_error.png":  # The panels on the right share the labels on the left.
        labels = labels[::2]
    assert all("[" in label and "]" in label for label in labels)
    assert "time [s]" in [axis.get_xlabel() for axis in figure.axes]


@pytest.mark.parametrize("certified", [False, True])
@pytest.mark.parametrize("name", sorted(NAMES))
def test_figures_with_the_tube_say_whether_it_is_certified(record, name, certified):
    text = texts_of(FIGURES[name](replace(record, certified=np.array(certified))))
    assert (tube_label(certified) in text) == (name in WITH_TUBE)
    assert tube_label(not certified) not in text


def test_the_labels_of_the_tube():
    assert tube_label(True) == "certified tube"
    assert tube_label(False) == "tube declared, not certified"


def test_velocities_are_tightened_by_their_own_radii(record):
    axes = axes_of("velocities.png", record)
    assert [levels(axis, "limit") for axis in axes] == [[0.3], [0.25], [0.4]]
    np.testing.assert_allclose([levels(axis, "tightened") for axis in axes],
                               [[0.27], [0.23], [0.39]])


def test_a_radius_that_is_left_out_is_the_total(record):
    tube = replace(record.scenario.tube, nu1=None, joints=None, position=None)
    record = replace(record, scenario=replace(record.scenario, tube=tube))
    np.testing.assert_allclose(levels(axes_of("velocities.png", record)[0], "tightened"), [0.26])
    np.testing.assert_allclose(
        levels(axes_of("joints.png", record)[0], "tightened"), [-0.394, 1.454])
    assert "6 mm" in axes_of("task_error.png", record)[1].get_title(loc="left")


def test_joints_have_the_limits_in_force_full_and_tightened(record):
    for i, axis in enumerate(axes_of("joints.png", record)):
        limits = [record.joint_lower[i], record.joint_upper[i]]
        np.testing.assert_allclose(levels(axis, "limit"), limits)
        np.testing.assert_allclose(
            levels(axis, "tightened"), [limits[0] + 0.005, limits[1] - 0.005])


def test_a_joint_without_limits_has_no_lines_for_them(record):
    record = replace(record, joint_upper=np.array([1.46, 1.3114, 0.73, np.inf]))
    axis = axes_of("joints.png", record)[3]
    assert (len(levels(axis, "limit")), len(levels(axis, "tightened"))) == (1, 1)


def test_inputs_are_tightened_channel_by_channel(record):
    axes = axes_of("inputs.png", record)
    tightened = [levels(axis, "tightened")[1] for axis in axes]
    # The figure fills its left column first, and its axes are listed row by row.
    expected = (record.scenario.limits.u - record.scenario.tube.u).reshape(2, 5).T.ravel()
    np.testing.assert_allclose(tightened, expected)


def test_the_tube_about_the_task_error_is_that_of_position_and_of_orientation(record):
    for row, (part, bound, unit) in enumerate(
            ((slice(0, 3), 5, "mm"), (slice(3, 6), 4, "mrad"))):
        left, right = axes_of("task_error.png", record)[2 * row: 2 * row + 2]
        assert f"{bound} {unit}" in right.get_title(loc="left")
        nominal = 1e3 * (record.chi_nominal - record.chi_des)[:, part].T
        for axis in (left, right):
            bands = [c for c in axis.collections if isinstance(c, PolyCollection)]
            for band, e_bar in zip(bands, nominal, strict=True):
                heights = band.get_paths()[0].vertices[:, 1]
                assert np.max(heights) == pytest.approx(np.max(e_bar) + bound)
                assert np.min(heights) == pytest.approx(np.min(e_bar) - bound)


def test_the_deviation_is_drawn_with_both_bounds(record):
    for axis, column, bound in zip(axes_of("deviation.png", record), (0, 4), (6.0, 40.0),
                                   strict=True):
        lines = {line.get_label(): line.get_ydata() for line in axis.get_lines()}
        np.testing.assert_array_equal(lines["deviation"], 1e3 * record.tube_deviation[:, column])
        np.testing.assert_array_equal(lines["bound along the run"],
                                      1e3 * record.tube_bound[:, column])
        assert levels(axis, tube_label(False)) == pytest.approx([bound])
        assert axis.get_yscale() == "linear"


def test_a_deviation_that_is_far_below_its_bound_is_drawn_by_its_logarithm(record):
    faint = replace(record, tube_deviation=1e-3 * record.tube_deviation)
    for axis, bound in zip(axes_of("deviation.png", faint), (6.0, 40.0), strict=True):
        assert axis.get_yscale() == "log"
        assert axis.get_ylim()[0] < bound < axis.get_ylim()[1]


@pytest.mark.long
@pytest.mark.long
def test_a_bound_along_the_run_that_does_not_exist_is_not_drawn(record, tmp_path):
    nowhere = replace(record, tube_bound=np.full_like(record.tube_bound, np.inf),
                      scenario=replace(record.scenario, ancillary=Transpose()))
    make_figures(nowhere, tmp_path)
    axes = axes_of("deviation.png", nowhere)
    assert "bound along the run" not in texts_of(axes[0].figure)
    assert "chi" in axes[0].get_ylabel()


def test_torques_get_a_panel_if_there_are_any(record):
    force = record.force.copy()
    force[:, 4] = 0.5
    without = FIGURES["force.png"](record)
    assert len(FIGURES["force.png"](replace(record, force=force)).axes) == len(without.axes) + 1


def test_the_force_after_the_first_contact_is_drawn_if_there_was_an_approach(record):
    labels = [axis.get_ylabel() for axis in axes_of("force.png", record)]
    assert labels == ["force [N]", "penetration [mm]", "force [N]"]
    from_inside = replace(record, penetration=record.penetration + 0.01)
    axes = axes_of("force.png", from_inside)
    assert [axis.get_ylabel() for axis in axes] == labels[:2]
    assert axes[-1].get_xlabel() == "time [s]"
    assert "first contact" not in texts_of(axes[0].figure)


def bands(axis):
    """Returns label and range of the bands of an axis."""
    return [(band.get_label(), *np.percentile(band.get_paths()[0].vertices[:, 1], [0, 100]))
            for band in axis.collections if isinstance(band, PolyCollection)]


@pytest.mark.parametrize(("wrench", "force", "torque"), [
    ([20, 0, 0, 0, 0, 0], [(SETTLED + "2 N", 18, 22)], []),
    ([-20, 0, 0, 0, 0, 0], [(SETTLED + "2 N", -22, -18)], []),
    ([0, 0, 0, 0, 5, 0], [], [(SETTLED + "2 N m", 3, 7)]),
    ([0, 20, 0, 5, 7, 0], [(SETTLED + "2 N, N m", 18, 22)],
     [(SETTLED + "2 N, N m", 3, 7), ("_", 5, 9)]),
])
def test_the_tolerance_is_about_what_is_desired_in_its_unit(record, wrench, force, torque):
    axes = axes_of("force.png", desiring(wrench, record))
    assert bands(axes[0]) == force
    assert bands(axes[1]) == torque


@pytest.mark.long
@pytest.mark.long
def test_a_run_without_contact_tube_and_disturbance_can_be_drawn(record, tmp_path):
    scenario = replace(record.scenario, tube=TubeRadii(u=np.zeros(10)))
    quiet = replace(
        record, scenario=scenario, force=np.zeros_like(record.force),
        penetration=np.zeros_like(record.penetration), state=record.nominal_state,
        chi=np.tile(record.chi_des, (len(record.time), 1)),
        disturbance=np.zeros_like(record.disturbance), mpc_status=np.ones_like(record.mpc_status))
    assert {path.name for path in make_figures(quiet, tmp_path)} == NAMES
    assert all(np.all(np.isfinite(imread(tmp_path / name))) for name in NAMES)


@pytest.mark.long
@pytest.mark.parametrize("certified", [False, True])
def test_every_figure_of_a_run_without_a_certificate_says_so(certified, tmp_path, monkeypatch):
    seen = []
    monkeypatch.setattr(Figure, "text", lambda self, x, y, text, **_: seen.append(text))
    record = replace(synthetic_record(4.0), certified=np.array(certified))
    make_figures(record, tmp_path)
    assert seen == ([] if certified else [UNCERTIFIED] * len(NAMES))


def test_the_effective_disturbance_is_drawn_where_it_is_another_one(record):
    same = FIGURES["disturbance.png"](record)
    other = FIGURES["disturbance.png"](
        replace(record, effective_disturbance=1.5 * record.disturbance))
    lines = [figure.axes[1].get_lines() for figure in (same, other)]
    assert len(lines[1]) == len(lines[0]) + 1
    drawn = [line for line in lines[1] if line.get_color() == ORANGE]
    np.testing.assert_allclose(
        drawn[0].get_ydata(), 1.5 * np.linalg.norm(record.disturbance, axis=1))


def test_the_certified_band_begins_when_the_plan_is_at_the_task(record):
    at_task = np.all(np.abs(record.chi_nominal - record.chi_des) < 2e-4, axis=1)
    plan = np.where(at_task[:, None], record.chi_des, record.chi_nominal)
    axis = FIGURES["force.png"](replace(record, chi_nominal=plan), certified=1.5).axes[0]
    (band,) = [band for band in axis.collections if "certified" in str(band.get_label())]
    corners = band.get_paths()[0].vertices
    assert np.percentile(corners[:, 1], [0, 100]).tolist() == [18.5, 21.5]
    error = np.linalg.norm(plan - record.chi_des, axis=1)
    assert np.min(corners[:, 0]) == record.time[np.flatnonzero(error > 1e-3)[-1] + 1]
    assert "certified" not in texts_of(FIGURES["force.png"](record))


def test_contact_and_settling_are_marked(record):
    axis = axes_of("force.png", record)[0]
    texts = {text.get_text(): text.xy[0] for text in axis.texts}
    touched = record.time[np.flatnonzero(record.penetration > 0.0)[0]]
    assert texts["contact"] == touched < texts["settled"] < record.time[-1]


def test_components_of_a_disturbance_that_are_alike_are_one_line(record):
    axis = axes_of("disturbance.png", record)[0]
    assert len(axis.get_lines()) == 1
    assert "each of the 10 components" in texts_of(axis.figure)
    other = record.disturbance * np.linspace(0.5, 1.0, 10)
    axis = axes_of("disturbance.png", replace(record, disturbance=other))[0]
    assert len(axis.get_lines()) == 10
    assert "joints" in texts_of(axis.figure)


def test_a_slack_of_zero_is_said_and_not_scaled(record):
    none = replace(record, mpc_terminal_slack=np.zeros_like(record.mpc_terminal_slack))
    axis = axes_of("mpc.png", none)[2]
    assert "zero at every step" in texts_of(axis.figure)
    assert axis.get_yticks().tolist() == [0.0]
    assert "zero at every step" not in texts_of(axes_of("mpc.png", record)[1].figure)
