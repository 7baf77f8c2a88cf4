"""Tests of `uvms_drake.report.figure.contact_estimate_figure`: what is known beside what is."""

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from support.synthetic import synthetic_sensed_record

from uvms_drake.control.limits.radii import HoldRadii
from uvms_drake.report.figure.contact_estimate_figure import depths_of, marks_of
from uvms_drake.report.figure_style import COLUMN_WIDTH, STYLE
from uvms_drake.report.figures import FIGURES, make_figures
from uvms_drake.report.html import format_report
from uvms_drake.station.contact.bounds import safe_depth_margin
from uvms_drake.tube.ultimate_bounds import hold_band, tip_errors

PANELS = ["force along $n$ [N]", "depth [mm]", "stiffness [N/m]", "", "depth [mm]"]


@pytest.fixture(scope="module")
def record():
    return synthetic_sensed_record()


def axes_of(record, **how):
    with matplotlib.rc_context(STYLE):
        return FIGURES["force.png"](record, **how).axes


def lines(axis):
    return {line.get_label(): np.asarray(line.get_ydata()) for line in axis.get_lines()}


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
    assert [axis.get_ylabel() for axis in axes_of(never)] == PANELS[:4]


def test_nothing_is_drawn_of_what_is_not_explored(record):
    signals = {**record.signals, "safe_depth": np.full((len(record.time), 1), -np.inf)}
    axes = axes_of(replace(record, signals=signals))
    assert np.all(np.isnan(lines(axes[1])["explored up to"]))


def test_its_panels_show_the_logs(record):
    axes = axes_of(record)
    assert [axis.get_ylabel() for axis in axes] == PANELS
    force = lines(axes[0])
    np.testing.assert_array_equal(force["measured"], record.signals["force_last_valid"][:, 0])
    np.testing.assert_array_equal(force["real"], record.force[:, 0])
    assert set(force["desired"]) == {20.0}
    assert set(force["limit of the static force"]) == {45.0}
    stiffness = lines(axes[2])
    for label, name in ((r"estimated, $\pm\,2\sigma$", "estimate"),
                        ("used by the controller", "used")):
        np.testing.assert_array_equal(
            stiffness[label], record.signals[f"stiffness_{name}"][:, 0])
    assert set(stiffness[r"declared, $\kappa_+$"]) == {1000.0}
    band, = axes[2].collections
    found = band.get_paths()[0].vertices[:, 1]
    assert (np.min(found), np.max(found)) == (pytest.approx(210.0), pytest.approx(1200.0))
    for axis in (axes[1], axes[4]):
        depth, expected = lines(axis), depths_of(record)
        for label, name in (("tip", "tip"), ("planned tip", "planned"), ("wall", "wall"),
                            ("explored up to", "explored"), ("estimated wall", "estimated")):
            np.testing.assert_array_equal(depth[label], expected[name])


def test_the_enlarged_panel_has_the_wall_and_the_front_in_view(record):
    low, high = axes_of(record)[4].get_ylim()
    assert low < 0.0 < np.max(depths_of(record)["explored"]) < high
    assert axes_of(record)[4].get_xlim() == pytest.approx((2.02 - 1.5, 4.0))


def test_the_force_along_n_is_the_part_of_it_along_n(record):
    n = np.array([0.8, 0.6, 0.0])
    contact = replace(record.scenario.contact, direction=n)
    turned = replace(record, scenario=replace(record.scenario, contact=contact))
    force = lines(axes_of(turned)[0])
    np.testing.assert_allclose(force["real"], 0.8 * record.force[:, 0])
    np.testing.assert_allclose(force["measured"], record.signals["force_last_valid"][:, :3] @ n)


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
    strip = axes_of(eventful)[3]
    assert [tick.get_text() for tick in strip.get_yticklabels()] == list(marks)
    for line, times, row in zip(strip.get_lines(), marks.values(), range(5), strict=True):
        np.testing.assert_array_equal(line.get_xdata(), times)
        assert set(line.get_ydata()) == {-row}


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
    bands = {band.get_label(): band for band in axes_of(held, certified=3.5)[0].collections}
    for name, bound, start in (
        ("in motion", held.scenario.contact.band(20.0, tip_errors(held.scenario.tube)), 1.0),
        ("in a hold, from 0.5 s on", hold_band(held.scenario.contact, 20.0, hold), 2.5)):
        (label,) = (label for label in bands if name in label)
        corners = np.vstack([path.vertices for path in bands[label].get_paths()])
        assert np.max(corners[:, 1]) == pytest.approx(20.0 + bound)
        assert np.min(corners[:, 1]) == pytest.approx(20.0 - bound)
        assert np.min(corners[:, 0]) == pytest.approx(start, abs=0.03)
        assert f"{bound:.3g} N" in label


def test_it_is_the_file_of_the_force_with_a_caption_of_its_own(record, tmp_path):
    paths = make_figures(record, tmp_path)
    (path,) = [path for path in paths if path.name == "force.png"]
    assert matplotlib.image.imread(path).shape[1] == COLUMN_WIDTH * STYLE["savefig.dpi"]
    page = format_report(record, [path], None)
    assert "safe region" in page[page.index("<figcaption>"):page.index("</figcaption>")]
