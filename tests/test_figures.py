"""Tests of `uvms_drake.figures`."""

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib.image import imread
from synthetic import synthetic_record

from uvms_drake.figure_style import COLUMN_WIDTH, DECLARED, STYLE
from uvms_drake.figures import FIGURES, make_figures

NAMES = {"task_error.png", "force.png", "velocities.png", "joints.png", "inputs.png",
         "disturbance.png", "mpc.png", "deviation.png"}


@pytest.fixture(scope="module")
def record():
    return synthetic_record(4.0)


def texts_of(figure):
    return " ".join(text.get_text() for text in figure.findobj(matplotlib.text.Text))


def test_every_figure_is_a_readable_png_at_column_width(record, tmp_path):
    paths = make_figures(record, tmp_path)
    assert {path.name for path in paths} == NAMES == set(FIGURES)
    for path in paths:
        width = imread(path).shape[1]
        assert width in (COLUMN_WIDTH * STYLE["savefig.dpi"], 2 * COLUMN_WIDTH * 300)


def test_figures_leave_the_style_of_the_caller_alone(record, tmp_path):
    before = dict(matplotlib.rcParams)
    make_figures(record, tmp_path)
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("name", sorted(NAMES))
def test_every_visible_axis_has_a_label_with_its_unit(record, name):
    with matplotlib.rc_context(STYLE):
        figure = FIGURES[name](record)
    labels = [axis.get_ylabel() for axis in figure.axes if axis.get_visible()]
    if name == "task_error.png":  # The panels on the right share the labels on the left.
        labels = labels[::2]
    assert all("[" in label and "]" in label for label in labels)
    assert "time [s]" in [axis.get_xlabel() for axis in figure.axes]


@pytest.mark.parametrize("name", ["task_error.png", "deviation.png"])
def test_figures_with_the_tube_say_that_it_is_declared(record, name):
    with matplotlib.rc_context(STYLE):
        assert DECLARED in texts_of(FIGURES[name](record))


def test_torques_get_a_panel_if_there_are_any(record):
    force = record.force.copy()
    force[:, 4] = 0.5
    without = FIGURES["force.png"](record)
    assert len(FIGURES["force.png"](replace(record, force=force)).axes) == len(without.axes) + 1


def test_a_run_without_contact_tube_and_disturbance_can_be_drawn(record, tmp_path):
    scenario = replace(record.scenario, tube=replace(record.scenario.tube, e=0.0, z=0.0,
                                                     u=np.zeros(10)))
    quiet = replace(
        record, scenario=scenario, force=np.zeros_like(record.force),
        penetration=np.zeros_like(record.penetration), state=record.nominal_state,
        chi=np.tile(record.chi_des, (len(record.time), 1)),
        disturbance=np.zeros_like(record.disturbance), mpc_status=np.ones_like(record.mpc_status))
    make_figures(quiet, tmp_path)
