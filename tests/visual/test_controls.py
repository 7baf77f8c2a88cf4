"""Tests of `uvms_drake.visual.controls`, and of a run that is watched."""

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource
from support.meshcat import packed_transform, press

from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.simulation import simulate
from uvms_drake.visual import controls
from uvms_drake.visual.controls import (
    DISTURBANCE,
    FORCE,
    HOME,
    STOP,
    DisturbanceSlider,
    ForceSlider,
    HomeButton,
    stop_button,
)
from uvms_drake.visual.stage import UNSEEN

FORCE_DES = np.array([20.0, 0.0, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize(("name", "overrides"), [
    ("girona500_ideal", ["visual.rate=30", "visual.magnification=7"]),
    pytest.param("girona500_bilateral", [], marks=pytest.mark.long),
    ("girona500_real_loop", ["duration=0.25"])])
def test_to_watch_a_run_does_not_change_it(name, overrides, meshcat):
    scenario = load_scenario(name, ["duration=0.5", *overrides])
    seen, unseen = simulate(scenario, meshcat=meshcat), simulate(scenario)
    for field in fields(seen):
        if field.name not in ("scenario", "wall_time_s", "step_seconds", "signals"):
            np.testing.assert_array_equal(
                getattr(seen, field.name), getattr(unseen, field.name), err_msg=field.name)
    for signal, values in unseen.signals.items():
        np.testing.assert_array_equal(seen.signals[signal], values, err_msg=signal)


def test_a_watched_run_shows_the_robot_where_it_is(meshcat, model):
    record = simulate(load_scenario("girona500_ideal", ["duration=0.4"]), meshcat=meshcat)
    X_vehicle = packed_transform(meshcat, "ned/uvms/vehicle")
    np.testing.assert_allclose(X_vehicle[:3, 3], record.config[-1, :3], atol=UNSEEN)


def test_the_button_ends_a_run_as_one_of_a_shorter_duration(meshcat):
    pressed = stop_button(meshcat)
    scenario = load_scenario("girona500_ideal", ["duration=5"])

    def progress(_, done):
        if done * scenario.duration >= 0.3:
            press(meshcat, STOP)

    record = simulate(scenario, stop=pressed, progress=progress)
    assert 0.3 <= record.scenario.duration < 0.5
    assert record.time[-1] <= record.scenario.duration
    again = simulate(replace(scenario, duration=record.scenario.duration))
    np.testing.assert_array_equal(record.state, again.state)


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
        builder, source.get_output_port().size(), meshcat, disturbance=source.get_output_port())
    diagram = builder.Build()
    for percent, part in ((None, 1.0), (40.0, 0.4), (0.0, 0.0)):
        if percent is not None:
            meshcat.SetSliderValue(DISTURBANCE, percent)
        context = slider.GetMyContextFromRoot(diagram.CreateDefaultContext())
        np.testing.assert_array_equal(slider.get_output_port().Eval(context), [
            part * 0.3, part * -0.1])


@pytest.mark.long
def test_the_sliders_change_desired_force_and_disturbance_while_it_runs(meshcat):
    """From 2.5 s on 25 N are wanted and no disturbance; both are as in the scenario before."""
    scenario = load_scenario("girona500_ideal", ["duration=4"])

    def move(_: str, done: float) -> None:
        if done * scenario.duration >= 2.5:
            meshcat.SetSliderValue(FORCE, 25.0)
            meshcat.SetSliderValue(DISTURBANCE, 0.0)

    record = simulate(scenario, meshcat=meshcat, progress=move)
    before, end = record.time < 2.45, record.time > 2.9
    assert np.all(record.desired_force[before, 0] == 20.0)
    assert np.all(record.desired_force[end, 0] == 25.0)
    assert np.max(np.linalg.norm(record.disturbance[before], axis=1)) > 0.05
    assert not np.any(record.disturbance[end])
    assert not np.any(record.mpc_refused)
    assert record.force[-1, 0] == pytest.approx(25.0, abs=1.0)


def test_a_watched_run_waits_for_a_browser_and_stays_until_the_button(monkeypatch):
    connected, pressed = iter([0, 0, 1]), []
    seen = SimpleNamespace(
        GetNumActiveConnections=lambda: next(connected), GetButtonNames=lambda: [STOP],
        DeleteButton=pressed.append, AddButton=lambda *_: None,
        GetButtonClicks=lambda name: len(pressed) - 1)
    monkeypatch.setattr(controls.time, "sleep", pressed.append)
    controls.wait_for_browser(seen)
    assert pressed == [controls.POLL] * 2
    pressed.clear()
    controls.wait_for_end(seen)
    assert pressed == [STOP, controls.POLL]


def test_control_c_ends_the_waiting(meshcat, monkeypatch):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(controls.time, "sleep", interrupted)
    controls.wait_for_end(meshcat)
    assert controls.CLOSE in meshcat.GetButtonNames()


def test_a_second_station_replaces_the_controls_of_the_first(meshcat):
    for newton in (20.0, 30.0):
        ForceSlider(np.array([newton, 0.0, 0.0, 0.0, 0.0, 0.0]), meshcat)
        DisturbanceSlider(10, meshcat)
        HomeButton(meshcat)
    assert meshcat.GetSliderNames() == [FORCE, DISTURBANCE]
    assert meshcat.GetSliderValue(FORCE) == 30.0
    assert meshcat.GetButtonNames() == [HOME]
