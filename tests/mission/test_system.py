"""Tests of `uvms_drake.mission.system`: ports, and state in the Context."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from support.scripts import Script
from support.tiny_robots import drill

from uvms_drake.common.wiring import added
from uvms_drake.mission.law import DONE, Measured, advance, begin
from uvms_drake.mission.steps import Approach, Hold, Mission, Retreat, Slide
from uvms_drake.mission.system import PROGRESS, MissionControl
from uvms_drake.model.surface.surface_class import SurfaceClass

SURFACE = SurfaceClass(np.array([0.0, 1.0, 0.0]), 2000.0)
ORIGIN = np.array([0.3, -5.0, 0.4])
MISSION = Mission(steps=[
    Approach(settle=0.2), Hold(seconds=1.0), Slide(along=np.array([0.0, -0.02])),
    Retreat(distance=0.05)]).checked()
PERIOD = 0.05
BACK = 4.0  # s, when the tip goes back


def tip(time):
    """(x, y, z): at the place, pressed in until it goes back; after 2 s 0.02 along −t₂."""
    place = np.array([0.0, -0.02 if time > 2.0 else 0.0])
    return ORIGIN + place @ SURFACE.axes[1:] + (0.1 if time < BACK else 0.0) * SURFACE.direction


def state(time):
    """Of the drill, whose tip is at the vehicle's origin."""
    return np.append(tip(time), np.zeros(9 + 2))[:14]


def simulator(mission=MISSION, **signals):
    builder = DiagramBuilder()
    script = builder.AddSystem(Script(**{
        "state": state, "force": lambda time: [0.0, 10.0 * (time < BACK), 0.0, 0.0, 0.0, 0.0],
        "touched": lambda time: [float(time < BACK)], "lost": lambda time: [0.0],
        "stop": lambda time: [0.0], **signals}))
    system = added(
        builder, "mission", MissionControl(mission, drill(), SURFACE, ORIGIN, period=PERIOD),
        state=script.GetOutputPort("state"), force_last_valid=script.GetOutputPort("force"),
        touched=script.GetOutputPort("touched"), force_lost=script.GetOutputPort("lost"))
    builder.Connect(script.GetOutputPort("stop"), system.GetInputPort("stop"))
    return Simulator(builder.Build()), system


def values(system, context):
    own = system.GetMyContextFromRoot(context)
    return np.concatenate([system.GetOutputPort(name).Eval(own)
                           for name in ("desired_force", "place", "deepest", "progress")])


def progress(system, context):
    return dict(zip(PROGRESS, values(system, context)[-len(PROGRESS):], strict=True))


def test_it_does_what_the_law_does():
    sim, system = simulator()
    now = begin(MISSION, np.array([tip(0.0)[1], 0.0, 0.0]), 0.0)
    n, axes = SURFACE.direction, SURFACE.axes
    for t in np.arange(0.0, 6.0, PERIOD):
        seen = np.append(n @ tip(t), axes[1:] @ (tip(t) - ORIGIN))
        now, asked = advance(MISSION, now, Measured(seen, 10.0 * (t < BACK), t < BACK), t)
        sim.AdvanceTo(t + 1e-6)
        found = values(system, sim.get_context())
        assert found[:6] == pytest.approx(np.append(asked.force * n, np.zeros(3)))
        assert axes[1:] @ (found[6:9] - ORIGIN) == pytest.approx(asked.place, abs=1e-6)
        assert found[9] == asked.deepest
    assert progress(system, sim.get_context())["outcome"] == DONE == now.outcome


def test_it_asks_for_what_is_due_a_lead_later():
    lead, slide = 0.4, Slide(along=np.array([0.0, -0.02]), speed=0.02, amplitude=2.0,
                             frequency=0.7)
    mission = replace(MISSION, steps=[*MISSION.steps[:2], slide, MISSION.steps[3]], lead=lead)
    sim, system = simulator(mission)
    log = []
    for t in np.arange(1.45, 2.3, lead / 4.0):  # All within the slide.
        sim.AdvanceTo(t)
        own = system.GetMyContextFromRoot(sim.get_context())
        assert progress(system, sim.get_context())["step"] == 2.0
        log.append([system.GetOutputPort(name).Eval(own) for name in (
            "desired_force", "place", "due_force", "due_place")])
    for (force, place, *_), (*_, due_force, due_place) in zip(log, log[4:], strict=False):
        assert SURFACE.direction @ force[:3] == pytest.approx(due_force[0])
        assert place == pytest.approx(due_place)
    assert np.ptp([due_place for *_, due_place in log], axis=0)[0] > 0.01


def test_a_clone_goes_on_as_the_original_does():
    sim, system = simulator()
    sim.AdvanceTo(2.3)
    other = Simulator(sim.get_system(), sim.get_context().Clone())
    other.Initialize()
    for t in (2.6, 3.9, 4.4, 6.0):
        sim.AdvanceTo(t)
        other.AdvanceTo(t)
        assert values(system, other.get_context()) == pytest.approx(
            values(system, sim.get_context()), abs=0.0)


def test_a_state_that_is_not_finite_is_not_seen():
    sim, system = simulator(state=lambda time: np.full(14, np.nan) if 0.5 < time < 0.9
                            else state(time))
    sim.AdvanceTo(6.0)
    assert progress(system, sim.get_context())["outcome"] == DONE
