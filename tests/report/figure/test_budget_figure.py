"""Tests of `uvms_drake.report.figure.budget_figure`."""

import pytest
from matplotlib.patches import Rectangle

from uvms_drake.report.figure.budget_figure import draw_budget


def test_parts_are_on_top_of_each_other_up_to_the_radius():
    budget = {"vehicle": {"d": 0.01, "lag": 0.02, "dust": 1e-6},
              "joints": {"d": 0.04, "lag": 0.0, "dust": 1e-6}}
    figure = draw_budget(budget, {"joints": 0.05})
    for axis, parts in zip(figure.axes, budget.values(), strict=True):
        bars = [patch for patch in axis.patches if isinstance(patch, Rectangle)]
        tops = [bar.get_y() + bar.get_height() for bar in bars]
        assert max(tops) == pytest.approx(1e3 * sum(parts.values()))
        assert [bar.get_y() for bar in bars[1:]] == pytest.approx(tops[:-1])
    (vehicle, joints) = figure.axes
    assert vehicle.get_title() == "vehicle [mm]"
    assert joints.get_title() == "joints [mrad]"
    assert not vehicle.lines
    assert joints.lines[0].get_ydata()[0] == pytest.approx(50.0)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        "d", "lag", "all others", "available margin"]
