"""Tests of the figures of a run: how a drawing is drawn, and what each figure shows."""

import re
from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread
from support.drawings import bands, levels, panels_of, shown
from support.synthetic import aimed_at, desiring, synthetic_record, synthetic_sensed_record

from uvms_drake.actuation import Thrusters
from uvms_drake.control.limits import TubeRadii
from uvms_drake.control.limits.radii import HoldRadii
from uvms_drake.plant.surface import SurfaceError
from uvms_drake.report.contact_figures import contact_drawing, depths_of, marks_of
from uvms_drake.report.drawing import Drawing, Instant, Panel, band, draw, line
from uvms_drake.report.figure_style import COLUMN_WIDTH, ORANGE, STYLE, tube_label
from uvms_drake.report.figures import FIGURES, figures_of, make_figures
from uvms_drake.report.html import format_report
from uvms_drake.report.signals import real_limits
from uvms_drake.report.summary import summarise
from uvms_drake.station.contact.bounds import safe_depth_margin
from uvms_drake.tube.ultimate_bounds import hold_band, tip_errors

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


def test_every_figure_is_a_readable_png_at_column_width_and_has_the_verdict_of_the_run(
        record, tmp_path, monkeypatch):
    seen, before, write = [], dict(matplotlib.rcParams), Figure.text
    monkeypatch.setattr(Figure, "text", lambda self, x, y, text, **how: (
        seen.append(text), write(self, x, y, text, **how))[1])
    paths = make_figures(record, str(tmp_path / "not" / "there"))
    rare = {"coverage.png", "mission.png", "thrusters.png"}
    assert {path.name for path in paths} == NAMES == set(FIGURES) - rare
    for path in paths:
        assert imread(path).shape[1] in (COLUMN_WIDTH * 300, 2 * COLUMN_WIDTH * 300)
    verdict = summarise(record)["verdict"]["text"]
    assert verdict.endswith("without a certificate")
    assert [" ".join(text.split()) for text in seen] == [verdict] * len(NAMES)
    assert dict(matplotlib.rcParams) == before
    for path in make_figures(replace(record, certified=np.array(True)), tmp_path):
        assert imread(path).shape[1] in (COLUMN_WIDTH * 300, 2 * COLUMN_WIDTH * 300)
    assert all(text.startswith("all guarantees kept\ncertified for ")
               for text in seen[len(NAMES):])


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


def test_the_title_of_the_joints_has_what_their_limits_are_tightened_by():
    """With `joints_between`: the number in the title is the distance of the lines."""
    record = synthetic_sensed_record(2.0)
    tube = replace(record.scenario.tube, joints=0.004, joints_between=0.006)
    first = panels("joints.png", replace(
        record, scenario=replace(record.scenario, tube=tube)))[0]
    said = [float(each) for each in re.findall(r"([\d.]+) mrad", first.title)]
    assert said == pytest.approx([4.0, 6.0, 10.0])
    apart = levels(first, "tightened")[0] - real_limits(record)["q"].lower[0]
    assert 1e3 * apart == pytest.approx(10.0)


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


PANELS = ["force along $n$ [N]", "depth [mm]", "stiffness [N/m]", "", "depth [mm]"]


@pytest.fixture(scope="module")
def sensed():
    return synthetic_sensed_record()


def contact_panels(sensed, **how):
    return panels_of(contact_drawing(sensed, **how))


def value(panel, label):
    (found,) = shown(panel, label)
    return found


def test_depths_are_counted_from_where_the_wall_is_first_touched(sensed):
    depths = depths_of(sensed)
    safe = 1e3 * (sensed.chi_nominal[:, 0] + 0.025 + safe_depth_margin(sensed.scenario))
    np.testing.assert_allclose(depths["wall"], 0.0, atol=1e-5)
    np.testing.assert_allclose(depths["tip"], 1e3 * sensed.chi[:, 0], atol=1e-5)
    np.testing.assert_allclose(depths["planned"], 1e3 * sensed.chi_nominal[:, 0], atol=1e-5)
    np.testing.assert_allclose(depths["explored"], safe, atol=1e-5)
    estimated = depths["estimated"][sensed.time > 2.11]
    np.testing.assert_allclose(estimated, 3.0, atol=1e-5)
    assert np.all(np.isnan(depths["estimated"][sensed.time < 2.09]))


def test_without_a_touch_depths_are_counted_from_the_start(sensed):
    never = replace(sensed, penetration=np.zeros_like(sensed.penetration))
    depths = depths_of(never)
    assert depths["tip"][0] == 0.0
    np.testing.assert_allclose(depths["wall"], -1e3 * sensed.chi[0, 0], atol=1e-5)
    assert [panel.label for panel in contact_panels(never)] == PANELS[:4]


def test_its_panels_show_the_logs(sensed):
    found = contact_panels(sensed)
    assert [panel.label for panel in found] == PANELS
    np.testing.assert_array_equal(
        value(found[0], "measured"), sensed.signals["force_last_valid"][:, 0])
    np.testing.assert_array_equal(value(found[0], "real"), sensed.force[:, 0])
    assert set(value(found[0], "desired")) == {20.0}
    assert levels(found[0], "limit of the static force") == [45.0]
    for label, name in ((r"estimated, $\pm\,2\sigma$", "estimate"),
                        ("used by the controller", "used")):
        np.testing.assert_array_equal(
            value(found[2], label), sensed.signals[f"stiffness_{name}"][:, 0])
    assert levels(found[2], r"declared, $\kappa_+$") == [1000.0]
    assert bands(found[2], "") == [(pytest.approx(210.0), pytest.approx(1200.0))]
    for panel in (found[1], found[4]):
        for label, name in (("tip", "tip"), ("planned tip", "planned"), ("wall", "wall"),
                            ("end of the safe region", "explored"),
                            ("estimated wall", "estimated")):
            np.testing.assert_array_equal(value(panel, label), depths_of(sensed)[name])


def test_the_enlarged_panel_has_the_wall_and_the_front_in_view(sensed):
    close = contact_panels(sensed)[4]
    assert close.limits[0] < 0.0 < np.max(depths_of(sensed)["explored"]) < close.limits[1]
    assert close.window == pytest.approx((2.02 - 1.5, 4.0))


def test_what_happened_is_marked_and_named(sensed):
    assert marks_of(sensed) == {"first touch": [pytest.approx(2.02)], "contact lost": [],
                                "retargeted": [], "last plan kept": [], "sensor lost": []}
    status, depth, desired = (getattr(sensed, name).copy() for name in (
        "mpc_status", "penetration", "desired_force"))
    status[[3, 8]], depth[150:], desired[120:, 0] = 4.0, 0.0, 25.0
    missing = np.where(abs(sensed.time - 3.5) < 0.19, 1.0, 0.0)[:, None]
    eventful = replace(sensed, mpc_status=status, penetration=depth, desired_force=desired,
                       signals={**sensed.signals, "force_lost": missing,
                                "force_status": 3.0 * missing})
    marks = marks_of(eventful)
    assert {name: np.round(times, 6).tolist() for name, times in marks.items()} == {
        "first touch": [2.02], "contact lost": [3.0], "retargeted": [2.4],
        "last plan kept": [0.6, 1.6], "sensor lost": [3.32]}
    strip = contact_panels(eventful)[3]
    assert list(strip.rows) == list(marks)
    for points, times, row in zip(strip.series, marks.values(), range(5), strict=True):
        np.testing.assert_array_equal(points.x, times)
        assert set(points.y) == {-row}


def test_both_certified_bands_are_about_the_force_along_n(sensed):
    """The plan is at its target, stands from 2 s on, and touches from 1 s on."""
    hold = HoldRadii(time=0.5, depth=3e-4, position=4e-4, advance=0.01, standing=0.0025,
                     reading=1.5, age=0.03)
    nominal = sensed.nominal_state.copy()
    nominal[:, 10:] = np.where(sensed.time[:, None] < 2.0, 0.05, 0.0)
    held = replace(
        sensed, nominal_state=nominal,
        scenario=replace(sensed.scenario, tube=replace(sensed.scenario.tube, hold=hold)),
        signals=sensed.signals | aimed_at(sensed.chi_nominal[:, :3]) | {
            "touched": (sensed.time >= 1.0)[:, None].astype(float)})
    force = contact_panels(held, certified=3.5)[0]
    for name, bound, start in (
        ("in motion", held.scenario.contact.band(20.0, tip_errors(held.scenario.tube)), 1.0),
        ("plan at its target for 0.5 s", hold_band(held.scenario.contact, 20.0, hold), 2.5)):
        assert bands(force, name) == [(pytest.approx(20.0 - bound), pytest.approx(20.0 + bound))]
        (found,) = (each for each in force.series if name in each.style.get("label", ""))
        assert sensed.time[np.isfinite(found.y)][0] == pytest.approx(start, abs=0.03)
        assert f"{bound:.3g} N" in found.style["label"]


def test_it_is_the_file_of_the_force_with_a_caption_of_its_own(sensed, tmp_path, monkeypatch):
    monkeypatch.setattr("uvms_drake.report.figures.figures_of", lambda _: ["force.png"])
    (path,) = make_figures(sensed, tmp_path)
    assert imread(path).shape[1] == COLUMN_WIDTH * STYLE["savefig.dpi"]
    page = format_report(sensed, [path], None)
    assert "safe region" in page[page.index("<figcaption>"):page.index("</figcaption>")]


# A surface that is known.


def test_how_deep_it_may_go_is_shown_in_a_plane_that_is_known(record):
    panel = contact_panels(record)[1]
    assert levels(panel, "limit") == pytest.approx([46.0])
    assert levels(panel, "tightened") == pytest.approx([41.0])  # 5 mm of tube
    base = record.scenario
    for other in (replace(base, surface_error=SurfaceError(stiffness=1.1)),
                  replace(base, limits=replace(base.limits, static_force=None))):
        panel = contact_panels(replace(record, scenario=other))[1]
        assert levels(panel, "limit") == levels(panel, "tightened") == []


def test_a_torque_and_an_approach_have_panels_if_there_are_any(record):
    force = record.force.copy()
    force[:, 4] = 0.5
    labels = ["force [N]", "penetration [mm]", "force [N]"]
    for sensed, expected in (
            (record, labels),
            (replace(record, force=force), [labels[0], "torque [N m]", *labels[1:]]),
            (replace(record, penetration=record.penetration + 0.01), labels[:2])):
        assert [panel.label for panel in contact_panels(sensed)] == expected


@pytest.mark.parametrize(("wrench", "force", "torque"), [
    ([20, 0, 0, 0, 0, 0], [(18, 22)], []), ([-20, 0, 0, 0, 0, 0], [(-22, -18)], []),
    ([0, 0, 0, 0, 5, 0], [], [(3, 7)]), ([0, 20, 0, 5, 7, 0], [(18, 22)], [(3, 7), (5, 9)])])
def test_the_tolerance_is_about_what_is_desired(record, wrench, force, torque):
    found = contact_panels(desiring(wrench, record))
    assert bands(found[0], "counts as settled") == force
    assert bands(found[1], "counts as settled") == torque


def test_the_certified_band_begins_when_the_plan_is_at_the_task(record):
    at_task = np.all(np.abs(record.chi_nominal - record.chi_des) < 2e-4, axis=1)
    plan = np.where(at_task[:, None], record.chi_des, record.chi_nominal)
    panel = contact_panels(replace(record, chi_nominal=plan), certified=1.5)[0]
    assert bands(panel, "certified") == [(18.5, 21.5)]
    (found,) = (each for each in panel.series if "certified" in each.style.get("label", ""))
    error = np.linalg.norm(plan - record.chi_des, axis=1)
    assert found.x[0] == record.time[np.flatnonzero(error > 1e-3)[-1] + 1]
    assert bands(contact_panels(record)[0], "certified") == []


def test_contact_and_settling_are_marked(record):
    contact, settled = contact_panels(record)[0].instants
    assert (contact.text, settled.text) == ("contact", "settled")
    touched = record.time[np.flatnonzero(record.penetration > 0.0)[0]]
    assert contact.time == touched < settled.time < record.time[-1]
