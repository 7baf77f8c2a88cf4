"""Tests of `uvms_drake.report.contact_figures`: the force, and what is known beside what is."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread
from support.drawings import bands, levels, panels_of, shown
from support.synthetic import desiring, synthetic_record, synthetic_sensed_record

from uvms_drake.control.limits.radii import HoldRadii
from uvms_drake.plant.surface import SurfaceError
from uvms_drake.report.contact_figures import contact_drawing, depths_of, marks_of
from uvms_drake.report.figure_style import COLUMN_WIDTH, STYLE
from uvms_drake.report.figures import make_figures
from uvms_drake.report.html import format_report
from uvms_drake.station.contact.bounds import safe_depth_margin
from uvms_drake.tube.ultimate_bounds import hold_band, tip_errors

PANELS = ["force along $n$ [N]", "depth [mm]", "stiffness [N/m]", "", "depth [mm]"]


@pytest.fixture(scope="module")
def record():
    return synthetic_sensed_record()


def panels(record, **how):
    return panels_of(contact_drawing(record, **how))


def value(panel, label):
    (found,) = shown(panel, label)
    return found


def test_depths_are_counted_from_where_the_wall_is_first_touched(record):
    depths = depths_of(record)
    safe = 1e3 * (record.chi_nominal[:, 0] + 0.025 + safe_depth_margin(record.scenario))
    np.testing.assert_allclose(depths["wall"], 0.0, atol=1e-5)
    np.testing.assert_allclose(depths["tip"], 1e3 * record.chi[:, 0], atol=1e-5)
    np.testing.assert_allclose(depths["planned"], 1e3 * record.chi_nominal[:, 0], atol=1e-5)
    np.testing.assert_allclose(depths["explored"], safe, atol=1e-5)
    estimated = depths["estimated"][record.time > 2.11]
    np.testing.assert_allclose(estimated, 3.0, atol=1e-5)
    assert np.all(np.isnan(depths["estimated"][record.time < 2.09]))


def test_without_a_touch_depths_are_counted_from_the_start(record):
    never = replace(record, penetration=np.zeros_like(record.penetration))
    depths = depths_of(never)
    assert depths["tip"][0] == 0.0
    np.testing.assert_allclose(depths["wall"], -1e3 * record.chi[0, 0], atol=1e-5)
    assert [panel.label for panel in panels(never)] == PANELS[:4]


def test_its_panels_show_the_logs(record):
    found = panels(record)
    assert [panel.label for panel in found] == PANELS
    np.testing.assert_array_equal(
        value(found[0], "measured"), record.signals["force_last_valid"][:, 0])
    np.testing.assert_array_equal(value(found[0], "real"), record.force[:, 0])
    assert set(value(found[0], "desired")) == {20.0}
    assert levels(found[0], "limit of the static force") == [45.0]
    for label, name in ((r"estimated, $\pm\,2\sigma$", "estimate"),
                        ("used by the controller", "used")):
        np.testing.assert_array_equal(
            value(found[2], label), record.signals[f"stiffness_{name}"][:, 0])
    assert levels(found[2], r"declared, $\kappa_+$") == [1000.0]
    assert bands(found[2], "") == [(pytest.approx(210.0), pytest.approx(1200.0))]
    for panel in (found[1], found[4]):
        for label, name in (("tip", "tip"), ("planned tip", "planned"), ("wall", "wall"),
                            ("explored up to", "explored"), ("estimated wall", "estimated")):
            np.testing.assert_array_equal(value(panel, label), depths_of(record)[name])


def test_the_enlarged_panel_has_the_wall_and_the_front_in_view(record):
    close = panels(record)[4]
    assert close.limits[0] < 0.0 < np.max(depths_of(record)["explored"]) < close.limits[1]
    assert close.window == pytest.approx((2.02 - 1.5, 4.0))


def test_what_happened_is_marked_and_named(record):
    assert marks_of(record) == {"first touch": [pytest.approx(2.02)], "contact lost": [],
                                "retargeted": [], "last plan kept": [], "sensor lost": []}
    status, depth, desired = (getattr(record, name).copy() for name in (
        "mpc_status", "penetration", "desired_force"))
    status[[3, 8]], depth[150:], desired[120:, 0] = 4.0, 0.0, 25.0
    missing = np.where(abs(record.time - 3.5) < 0.19, 1.0, 0.0)[:, None]
    eventful = replace(record, mpc_status=status, penetration=depth, desired_force=desired,
                       signals={**record.signals, "force_lost": missing,
                                "force_status": 3.0 * missing})
    marks = marks_of(eventful)
    assert {name: np.round(times, 6).tolist() for name, times in marks.items()} == {
        "first touch": [2.02], "contact lost": [3.0], "retargeted": [2.4],
        "last plan kept": [0.6, 1.6], "sensor lost": [3.32]}
    strip = panels(eventful)[3]
    assert list(strip.rows) == list(marks)
    for line, times, row in zip(strip.series, marks.values(), range(5), strict=True):
        np.testing.assert_array_equal(line.x, times)
        assert set(line.y) == {-row}


def test_both_certified_bands_are_about_the_force_along_n(record):
    """The plan is at its target, stands from 2 s on, and touches from 1 s on."""
    hold = HoldRadii(time=0.5, depth=3e-4, position=4e-4, advance=0.01, standing=0.0025,
                     reading=1.5, age=0.03)
    nominal = record.nominal_state.copy()
    nominal[:, 10:] = np.where(record.time[:, None] < 2.0, 0.05, 0.0)
    held = replace(
        record, nominal_state=nominal,
        scenario=replace(record.scenario, tube=replace(record.scenario.tube, hold=hold)),
        signals=record.signals | {"target": record.chi_nominal[:, :3],
                                  "touched": (record.time >= 1.0)[:, None].astype(float)})
    force = panels(held, certified=3.5)[0]
    for name, bound, start in (
        ("in motion", held.scenario.contact.band(20.0, tip_errors(held.scenario.tube)), 1.0),
        ("in a hold, from 0.5 s on", hold_band(held.scenario.contact, 20.0, hold), 2.5)):
        assert bands(force, name) == [(pytest.approx(20.0 - bound), pytest.approx(20.0 + bound))]
        (found,) = (each for each in force.series if name in each.style.get("label", ""))
        assert record.time[np.isfinite(found.y)][0] == pytest.approx(start, abs=0.03)
        assert f"{bound:.3g} N" in found.style["label"]


def test_it_is_the_file_of_the_force_with_a_caption_of_its_own(record, tmp_path):
    paths = make_figures(record, tmp_path)
    (path,) = [path for path in paths if path.name == "force.png"]
    assert imread(path).shape[1] == COLUMN_WIDTH * STYLE["savefig.dpi"]
    page = format_report(record, [path], None)
    assert "safe region" in page[page.index("<figcaption>"):page.index("</figcaption>")]


# A surface that is known.


@pytest.fixture(scope="module")
def pressed():
    return synthetic_record(4.0)


def test_how_deep_it_may_go_is_shown_in_a_plane_that_is_known(pressed):
    panel = panels(pressed)[1]
    assert levels(panel, "limit") == pytest.approx([46.0])
    assert levels(panel, "tightened") == pytest.approx([41.0])  # 5 mm of tube
    base = pressed.scenario
    for other in (replace(base, surface_error=SurfaceError(stiffness=1.1)),
                  replace(base, limits=replace(base.limits, static_force=None))):
        panel = panels(replace(pressed, scenario=other))[1]
        assert levels(panel, "limit") == levels(panel, "tightened") == []


def test_a_torque_and_an_approach_have_panels_if_there_are_any(pressed):
    force = pressed.force.copy()
    force[:, 4] = 0.5
    labels = ["force [N]", "penetration [mm]", "force [N]"]
    for record, expected in (
            (pressed, labels),
            (replace(pressed, force=force), [labels[0], "torque [N m]", *labels[1:]]),
            (replace(pressed, penetration=pressed.penetration + 0.01), labels[:2])):
        assert [panel.label for panel in panels(record)] == expected


@pytest.mark.parametrize(("wrench", "force", "torque"), [
    ([20, 0, 0, 0, 0, 0], [(18, 22)], []), ([-20, 0, 0, 0, 0, 0], [(-22, -18)], []),
    ([0, 0, 0, 0, 5, 0], [], [(3, 7)]), ([0, 20, 0, 5, 7, 0], [(18, 22)], [(3, 7), (5, 9)])])
def test_the_tolerance_is_about_what_is_desired(pressed, wrench, force, torque):
    found = panels(desiring(wrench, pressed))
    assert bands(found[0], "counts as settled") == force
    assert bands(found[1], "counts as settled") == torque


def test_the_certified_band_begins_when_the_plan_is_at_the_task(pressed):
    at_task = np.all(np.abs(pressed.chi_nominal - pressed.chi_des) < 2e-4, axis=1)
    plan = np.where(at_task[:, None], pressed.chi_des, pressed.chi_nominal)
    panel = panels(replace(pressed, chi_nominal=plan), certified=1.5)[0]
    assert bands(panel, "certified") == [(18.5, 21.5)]
    (found,) = (each for each in panel.series if "certified" in each.style.get("label", ""))
    error = np.linalg.norm(plan - pressed.chi_des, axis=1)
    assert found.x[0] == pressed.time[np.flatnonzero(error > 1e-3)[-1] + 1]
    assert bands(panels(pressed)[0], "certified") == []


def test_contact_and_settling_are_marked(pressed):
    contact, settled = panels(pressed)[0].instants
    assert (contact.text, settled.text) == ("contact", "settled")
    touched = pressed.time[np.flatnonzero(pressed.penetration > 0.0)[0]]
    assert contact.time == touched < settled.time < pressed.time[-1]
