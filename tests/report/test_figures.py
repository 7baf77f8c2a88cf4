"""Tests of `uvms_drake.report.figures` and `drawing`: what the figures of a run show."""

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from support.drawings import bands, levels, panels_of, shown
from support.synthetic import synthetic_record

from uvms_drake.actuation import Thrusters
from uvms_drake.control.limits import TubeRadii
from uvms_drake.report.drawing import Drawing, Instant, Panel, band, draw, line
from uvms_drake.report.figure_style import COLUMN_WIDTH, ORANGE, STYLE, tube_label
from uvms_drake.report.figures import FIGURES, UNCERTIFIED, figures_of, make_figures

TIMED = {"task_error.png", "force.png", "velocities.png", "joints.png", "inputs.png",
         "disturbance.png", "mpc.png", "deviation.png"}
NAMES = TIMED | {"robot.png"}
WITH_TUBE = {"task_error.png", "velocities.png", "joints.png", "inputs.png", "deviation.png"}


@pytest.fixture(scope="module")
def record():
    return synthetic_record(4.0)


def panels(name, record):
    return panels_of(FIGURES[name](record))


def drawn(drawing):
    with matplotlib.rc_context(STYLE):
        return draw(drawing)


def texts_of(figure):
    return " ".join(text.get_text() for text in figure.findobj(matplotlib.text.Text))


def test_every_figure_is_a_readable_png_at_column_width_and_says_if_it_is_uncertified(
        record, tmp_path, monkeypatch):
    seen, before, write = [], dict(matplotlib.rcParams), Figure.text
    monkeypatch.setattr(Figure, "text", lambda self, x, y, text, **how: (
        seen.append(text), write(self, x, y, text, **how))[1])
    paths = make_figures(record, str(tmp_path / "not" / "there"))
    rare = {"coverage.png", "mission.png", "thrusters.png"}
    assert {path.name for path in paths} == NAMES == set(FIGURES) - rare
    for path in paths:
        assert imread(path).shape[1] in (COLUMN_WIDTH * 300, 2 * COLUMN_WIDTH * 300)
    assert seen == [UNCERTIFIED] * len(NAMES)
    assert dict(matplotlib.rcParams) == before
    make_figures(replace(record, certified=np.array(True)), tmp_path)
    assert all(text.startswith("certified for ") for text in seen[len(NAMES):])


@pytest.mark.parametrize("certified", [False, True])
@pytest.mark.parametrize("name", sorted(TIMED))
def test_axes_have_units_and_figures_with_the_tube_say_whether_it_is_certified(
        record, name, certified):
    drawing = FIGURES[name](replace(record, certified=np.array(certified)))
    assert all("[" in panel.label and "]" in panel.label and panel.x_label == "time [s]"
               for panel in panels_of(drawing) if panel.label)
    text = texts_of(drawn(drawing))
    assert (tube_label(certified) in text) == (name in WITH_TUBE)
    assert tube_label(not certified) not in text


def test_a_drawing_shows_its_panels_series_bands_levels_and_instants():
    x = np.linspace(0.0, 2.0, 5)
    curve, top = line(x**2, label="curve"), line(9.0, color="k", label="top")
    window = (0.5, 1.5)
    figure = drawn(Drawing([[
        Panel("a [m]", x, [curve, band(-x, x, color="r", label="band"),
                           band(-50.0, 50.0, extends=False)], instants=[Instant(1.0, "now")]),
        Panel("b [m]", x, [curve, top], scale="zero", legend=2),
        Panel("c [m]", x, [curve], window=window, x_label="way [m]", rows=["one", "two"])],
        [Panel("d [m]", x, [line(x + 1.0, x=2.0 * x)], scale="log", limits=(0.1, 10.0))]], 4.0))
    a, d, b, _, c, hidden = figure.axes
    assert [axis.get_ylabel() for axis in (a, b, c, d)] == ["a [m]", "b [m]", "c [m]", "d [m]"]
    assert not hidden.get_visible()
    np.testing.assert_array_equal(a.get_lines()[0].get_ydata(), x**2)
    assert max(a.get_ylim()) < 10.0  # The wide band does not count.
    assert a.texts[0].get_text() == "now"
    assert b.get_ylim() == pytest.approx((0.0, 1.12 * 9.0))
    assert [axis.get_xlabel() for axis in (a, b, c)] == ["", "time [s]", "way [m]"]
    assert c.get_xlim() == window
    assert [tick.get_text() for tick in c.get_yticklabels()] == ["one", "two"]
    assert (d.get_yscale(), d.get_ylim()) == ("log", (0.1, 10.0))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["curve", "band"]
    assert [text.get_text() for text in b.get_legend().get_texts()] == ["curve", "top"]


def test_limits_are_tightened_by_their_own_radii_channel_by_channel(record):
    velocities = panels("velocities.png", record)
    assert [levels(panel, "limit") for panel in velocities] == [[0.3], [0.25], [0.4]]
    np.testing.assert_allclose([levels(panel, "tightened") for panel in velocities],
                               [[0.27], [0.23], [0.39]])
    for i, panel in enumerate(panels("joints.png", record)):
        limits = np.array([record.joint_lower[i], record.joint_upper[i]])
        np.testing.assert_allclose(levels(panel, "limit"), limits)
        np.testing.assert_allclose(levels(panel, "tightened"), limits + [0.005, -0.005])
    np.testing.assert_allclose(
        [levels(panel, "tightened")[1] for panel in panels("inputs.png", record)],
        record.scenario.limits.u - record.scenario.tube.u)


def test_a_radius_that_is_left_out_is_the_total_and_an_infinite_limit_no_line(record):
    tube = replace(record.scenario.tube, nu1=None, joints=None, position=None)
    record = replace(record, scenario=replace(record.scenario, tube=tube),
                     joint_upper=np.array([1.46, 1.3114, 0.73, np.inf]))
    np.testing.assert_allclose(levels(panels("velocities.png", record)[0], "tightened"), [0.26])
    joints = panels("joints.png", record)
    np.testing.assert_allclose(levels(joints[0], "tightened"), [-0.394, 1.454])
    assert len(levels(joints[3], "limit")) == len(levels(joints[3], "tightened")) == 1
    assert "6 mm" in panels("task_error.png", record)[2].title


def test_the_tube_about_the_task_error_is_that_of_position_and_of_orientation(record):
    whole, close = FIGURES["task_error.png"](record).columns
    for row, (part, bound, unit) in enumerate(
            ((slice(0, 3), 5, "mm"), (slice(3, 6), 4, "mrad"))):
        assert f"{bound} {unit}" in close[row].title
        nominal = 1e3 * (record.chi_nominal - record.chi_des)[:, part].T
        for panel in (whole[row], close[row]):
            tubes = [each for each in panel.series if each.upper is not None]
            for tube, e_bar in zip(tubes, nominal, strict=True):
                np.testing.assert_allclose((tube.y, tube.upper), (e_bar - bound, e_bar + bound))


def test_the_deviation_is_shown_with_both_bounds_and_a_faint_one_by_its_logarithm(record):
    faint = replace(record, tube_deviation=1e-3 * record.tube_deviation)
    unbounded = replace(record, tube_bound=np.full_like(record.tube_bound, np.inf))
    for i, (column, bound) in enumerate(((0, 6.0), (4, 40.0))):
        panel = panels("deviation.png", record)[i]
        np.testing.assert_array_equal(
            shown(panel, "deviation"), [1e3 * record.tube_deviation[:, column]])
        np.testing.assert_array_equal(
            shown(panel, "bound along the run"), [1e3 * record.tube_bound[:, column]])
        assert levels(panel, tube_label(False)) == pytest.approx([bound])
        assert panel.scale == "zero"
        low = panels("deviation.png", faint)[i]
        assert low.scale == "log"
        assert low.limits[0] < bound < low.limits[1]
        assert shown(panels("deviation.png", unbounded)[i], "bound along the run") == []


def test_a_run_without_contact_tube_and_disturbance_can_be_drawn(record, tmp_path):
    scenario = replace(record.scenario, tube=TubeRadii(u=np.zeros(10)))
    quiet = replace(
        record, scenario=scenario, force=np.zeros_like(record.force),
        penetration=np.zeros_like(record.penetration), state=record.nominal_state,
        chi=np.tile(record.chi_des, (len(record.time), 1)),
        disturbance=np.zeros_like(record.disturbance), mpc_status=np.ones_like(record.mpc_status))
    assert {path.name for path in make_figures(quiet, tmp_path)} == NAMES
    assert all(np.all(np.isfinite(imread(tmp_path / name))) for name in NAMES)


def test_the_effective_disturbance_is_shown_if_it_is_another_and_components_alike_are_one_line(
        record):
    def lines(record, panel):
        return panels("disturbance.png", record)[panel].series

    def effective(record):
        return [each.y for each in lines(record, 1) if each.style.get("color") == ORANGE]

    assert effective(record) == []
    np.testing.assert_allclose(
        effective(replace(record, effective_disturbance=1.5 * record.disturbance)),
        [1.5 * np.linalg.norm(record.disturbance, axis=1)])
    assert len(lines(record, 0)) == 1
    other = record.disturbance * np.linspace(0.5, 1.0, 10)
    assert len(lines(replace(record, disturbance=other), 0)) == 10


def test_a_slack_of_zero_is_said_and_not_scaled(record):
    none = replace(record, mpc_terminal_slack=np.zeros_like(record.mpc_terminal_slack))
    assert panels("mpc.png", none)[2].title == "zero at every step"
    assert drawn(FIGURES["mpc.png"](none)).axes[2].get_yticks().tolist() == [0.0]
    assert panels("mpc.png", record)[1].title == ""


def test_thrusters_have_force_command_and_limits(record):
    force = 80.0 * np.sin(np.pi * record.time)[:, None] * np.ones(5)
    driven = replace(record, scenario=replace(record.scenario, actuation=[Thrusters()]), signals={
        "thruster_command": 0.5 * np.ones_like(force), "thruster_force": force})
    assert "thrusters.png" in figures_of(driven.scenario)
    assert "thrusters.png" not in figures_of(record.scenario)
    found = panels("thrusters.png", driven)
    assert [panel.label for panel in found] == [
        "surge port\n[N]", "surge starboard\n[N]", "heave bow\n[N]", "heave stern\n[N]",
        "sway\n[N]"]
    for panel in found:
        np.testing.assert_array_equal(shown(panel, "real")[0], force[:, 0])
        assert levels(panel, "limit") == [-95.122, 104.659]
        assert len(shown(panel, "commanded")) == len(bands(panel, "dead band")) == 1
