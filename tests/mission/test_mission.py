"""Missions: the state machine alone, and its system."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from support.scripts import Script
from support.tiny_robots import drill

from uvms_drake.mission import law
from uvms_drake.mission.steps import REACHED, Approach, Hold, Mission, Retreat, Slide
from uvms_drake.mission.system import PROGRESS, MissionControl
from uvms_drake.model.surface.surface_class import SurfaceClass

PERIOD = 0.05
WALL = 0.3  # m, its depth
STIFFNESS = 1000.0  # N/m


class Tip:
    """A tip that goes where it is sent, at 0.1 m/s along n and 0.05 m/s across, to a wall."""

    def __init__(self, mission, wall=WALL):
        self.mission, self.wall = mission.checked(), wall
        self.tip, self.t, self.asked = np.zeros(3), 0.0, []
        self.state = law.begin(self.mission, self.tip, 0.0)

    def measured(self):
        force = max(STIFFNESS * (self.tip[0] - self.wall), 0.0)
        return law.Measured(self.tip.copy(), force, touched=force > 2.0)

    def go(self, until, change=lambda t, measured: measured):
        """Runs until a time [s], or the end; `change` falsifies the measurements."""
        while self.t < until and self.state.outcome == law.RUNNING:
            self.state, asked = law.advance(
                self.mission, self.state, change(self.t, self.measured()), self.t)
            self.asked.append((self.t, self.state.step, asked, self.tip.copy()))
            depth = min(self.wall + asked.force / STIFFNESS, asked.deepest) \
                if asked.force else asked.deepest
            for part, goal, speed in ((slice(0, 1), depth, 0.1), (slice(1, 3), asked.place, 0.05)):
                way = goal - self.tip[part]
                self.tip[part] += way * min(1.0, speed * PERIOD / max(np.linalg.norm(way), 1e-12))
            self.t += PERIOD
        return self.state


JOB = Mission(steps=[
    Approach(at=np.array([0.1, 0.0])), Hold(seconds=5.0), Retreat(),
    Approach(at=np.array([0.1, 0.1])), Slide(along=np.array([0.0, -0.2])), Retreat(distance=0.15)])


def longest(mission, period=0.0):
    """Returns the time after which a mission is over in any case [s]."""
    return (1 + mission.retries) * sum(step.timeout + period for step in mission.steps)


def test_a_job_is_done_step_by_step():
    run = Tip(JOB)
    assert run.go(np.inf).outcome == law.DONE
    assert run.state.outcomes == (law.DONE,) * 6
    assert run.state.failures == 0
    steps = np.array([step for _, step, *_ in run.asked])
    assert np.all(np.diff(steps) >= 0)
    spent = PERIOD * np.bincount(steps, minlength=7)
    assert spent[1] == pytest.approx(5.0, abs=2 * PERIOD)
    assert spent[4] == pytest.approx(0.2 / 0.02, abs=2 * PERIOD)
    assert run.tip[0] == pytest.approx(WALL + 0.01 - 0.15, abs=REACHED)
    assert run.t < longest(JOB)
    for _, step, asked, tip in run.asked:  # It presses at its place only, and moves off the wall.
        if asked.force > 0.0 and step in (0, 3):
            assert np.linalg.norm(tip[1:] - JOB.steps[step].at) <= REACHED + 1e-9
        assert step != 3 or asked.force > 0.0 or tip[0] < WALL
    end = law.due_at(run.mission, run.state, run.t + 100.0)
    assert (end.force, end.deepest) == (0.0, pytest.approx(WALL + 0.01 - 0.15))


def test_a_slide_asks_for_a_place_that_moves_at_its_speed_and_for_a_force_that_swings():
    steps = [Approach(), Slide(along=np.array([0.3, -0.4]), speed=0.05, force=10.0, amplitude=3.0,
                               frequency=0.1), Retreat()]
    run = Tip(Mission(steps=steps))
    assert run.go(np.inf).outcome == law.DONE
    asked = [(t, now.place, now.force) for t, step, now, _ in run.asked if step == 1]
    times, places, forces = (np.array(each) for each in zip(*asked, strict=True))
    spent = times - times[0]
    moving = spent < 0.5 / 0.05
    speeds = np.diff(places[moving], axis=0) / PERIOD
    assert speeds == pytest.approx(np.broadcast_to([0.03, -0.04], speeds.shape))
    assert forces == pytest.approx(10.0 + 3.0 * np.sin(0.2 * np.pi * spent))
    assert places[-1] == pytest.approx([0.3, -0.4], abs=0.05 * PERIOD)


@pytest.mark.parametrize(("change", "reason"), [
    ({"touched": False, "force": 0.0}, law.CONTACT_LOST), ({"lost": True}, law.FORCE_LOST),
    ({"lost": True, "tip": np.full(3, np.nan)}, law.STATE_LOST), ({"stop": True}, law.STOPPED)])
def test_from_the_middle_of_a_slide_it_goes_straight_back_and_a_copy_does_so_too(change, reason):
    """The state is all there is to remember: the mission goes on from a copy as if never killed."""
    mission = Mission(steps=[Approach(), Slide(along=np.array([0.4, 0.0])), Retreat()])
    run, other = Tip(mission), Tip(mission)

    def wrong(step, t, measured):
        return measured._replace(**change) if step == 1 and t > 15.0 else measured

    run.go(11.0)
    other.state, other.tip, other.t = pickle.loads(pickle.dumps((run.state, run.tip, run.t)))
    for each in (run, other):
        state = each.go(np.inf, lambda t, measured, at=each: wrong(at.state.step, t, measured))
        assert (state.reason, state.outcomes) == (reason, (law.DONE, law.SKIPPED, law.DONE))
    assert other.tip == pytest.approx(run.tip, abs=0.0)
    back = [now.place for _, step, now, _ in run.asked if step == 2]
    assert np.ptp(back, axis=0) == pytest.approx(np.zeros(2)), "straight"
    assert 0.15 < back[0][0] < 0.25, "from where it was on the line"
    assert all(now.force == 0.0 for _, step, now, _ in run.asked if step == 2)


def test_a_wall_that_is_not_there_is_given_up_and_the_next_spot_begun():
    run = Tip(JOB, wall=5.0)
    state = run.go(np.inf)
    assert state.outcome == law.SKIPPED
    assert state.outcomes == 2 * (law.SKIPPED, law.SKIPPED, law.DONE)
    assert state.reason == law.TIME_OUT
    assert max(tip[0] for *_, tip in run.asked) <= 0.5 + JOB.steps[0].within + 1e-9


@pytest.mark.parametrize(("change", "reason"), [
    ({"touched": False, "force": 0.0}, law.CONTACT_LOST),
    ({"lost": True}, law.FORCE_LOST),
    ({"force": 30.0}, law.TIME_OUT),
    ({"stop": True}, law.STOPPED)])
@pytest.mark.parametrize("choice", ["skip", "retry", "home"])
def test_what_goes_wrong_in_a_hold_ends_in_the_retreat_of_its_spot(change, reason, choice):
    """It goes wrong once, until the retreat; a second try finds all as it should be."""
    mission = Mission(steps=[Approach(), Hold(on_failure=choice), Retreat(),
                             Approach(at=np.array([0.1, 0.0])), Retreat()])
    run = Tip(mission)

    def wrong(t, measured):
        return measured._replace(**change) if run.state.step == 1 and not run.state.failures \
            else measured

    state = run.go(np.inf, wrong)
    order = [step for i, (_, step, *_) in enumerate(run.asked) if step != run.asked[i - 1][1]]
    home = reason == law.STOPPED or choice == "home"
    assert (state.failures, state.reason) == (1, reason)
    if home:
        assert state.outcome == law.RETREATED
        assert state.outcomes == (law.DONE, law.SKIPPED, law.DONE, law.SKIPPED, law.SKIPPED)
    elif choice == "retry":
        assert state.outcome == law.DONE
        assert order == [0, 1, 2, 0, 1, 2, 3, 4, 5]
    else:
        assert state.outcome == law.SKIPPED
        assert state.outcomes == (law.DONE, law.SKIPPED, law.DONE, law.DONE, law.DONE)
    assert law.due_at(run.mission, state, run.t).force == 0.0


def test_a_spot_is_tried_again_as_often_as_is_said():
    mission = Mission(steps=[Approach(on_failure="retry", timeout=10.0), Retreat()], retries=3)
    run = Tip(mission, wall=5.0)
    assert run.go(np.inf).outcome == law.SKIPPED
    assert (run.state.failures, run.state.tries) == (4, 3)


def test_a_tip_that_cannot_get_back_ends_the_mission():
    run = Tip(JOB)

    def stuck(t, measured):
        return measured._replace(tip=np.array([WALL, 0.1, 0.0])) if run.state.step == 2 \
            else measured

    state = run.go(np.inf, stuck)
    assert state.outcome == law.RETREATED
    assert state.reason == law.TIME_OUT
    asked = law.due_at(run.mission, state, run.t)
    assert asked.force == 0.0
    assert asked.deepest < WALL


def random_mission(rng):
    steps = []
    for _ in range(rng.integers(1, 4)):
        def options():
            return {"timeout": rng.uniform(2.0, 5.0), "force": rng.uniform(2.0, 20.0),
                    "on_failure": rng.choice(["skip", "retry", "home"])}
        steps.append(Approach(at=rng.uniform(-0.1, 0.1, 2), settle=rng.uniform(0.0, 1.0),
                              **options()))
        for _ in range(rng.integers(0, 3)):
            steps.append(Hold(seconds=rng.uniform(0.0, 1.5), **options()) if rng.random() < 0.5
                         else Slide(along=rng.uniform(0.01, 0.05, 2), speed=0.1, **options()))
        steps.append(Retreat(distance=rng.uniform(0.01, 0.2), timeout=rng.uniform(0.5, 3.0)))
    return Mission(steps=steps, retries=int(rng.integers(0, 3)))


def test_random_missions_with_random_measurements_all_end_and_never_in_limbo():
    """Random measurements: a wall, nothing, not a number, or far away."""
    rng, period, ends = np.random.default_rng(0), 0.5, []
    for _ in range(400):
        mission = random_mission(rng).checked()
        state, t, helpful = law.begin(mission, np.zeros(3), 0.0), 0.0, rng.random() ** 0.3
        while state.outcome == law.RUNNING:
            now = law.due_at(mission, state, t)
            tip = np.append(min(now.deepest, WALL), now.place)
            measured = law.Measured(tip, now.force, touched=now.force > 0.0)
            if rng.random() > helpful:
                kind = rng.integers(0, 5)
                measured = (
                    measured._replace(tip=np.full(3, np.nan)),
                    measured._replace(tip=rng.normal(size=3)),
                    measured._replace(force=np.nan, touched=False),
                    measured._replace(force=0.0, touched=bool(rng.random() < 0.5), lost=True),
                    measured._replace(stop=bool(rng.random() < 0.05)))[kind]
            before = state
            state, asked = law.advance(mission, state, measured, t)
            t += period
            # Never from a contact to elsewhere without a retreat; always something to steer for.
            step = mission.steps[before.step]
            if step.touches and state.step != before.step:
                assert state.step == before.step + 1 or isinstance(
                    mission.steps[state.step], Retreat)
            assert np.all(np.isfinite([*asked.place, asked.force, asked.deepest]))
            assert t <= longest(mission, period)
        end = law.due_at(mission, state, t)
        assert end.force == 0.0
        assert law.RUNNING not in state.outcomes
        assert (state.outcome == law.DONE) == all(each == law.DONE for each in state.outcomes)
        ends.append(state.outcome)
    assert np.all(np.bincount(ends, minlength=4)[1:] > 20)


SURFACE = SurfaceClass(np.array([0.0, 1.0, 0.0]), 2000.0)
ORIGIN = np.array([0.3, -5.0, 0.4])
MISSION = Mission(steps=[
    Approach(settle=0.2), Hold(seconds=1.0), Slide(along=np.array([0.0, -0.02])),
    Retreat(distance=0.05)]).checked()
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
    system = MissionControl.AddToBuilder(
        builder, mission, drill(), SURFACE, ORIGIN, period=PERIOD, name="mission",
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
    now = law.begin(MISSION, np.array([tip(0.0)[1], 0.0, 0.0]), 0.0)
    n, axes = SURFACE.direction, SURFACE.axes
    for t in np.arange(0.0, 6.0, PERIOD):
        seen = np.append(n @ tip(t), axes[1:] @ (tip(t) - ORIGIN))
        now, asked = law.advance(MISSION, now, law.Measured(seen, 10.0 * (t < BACK), t < BACK), t)
        sim.AdvanceTo(t + 1e-6)
        found = values(system, sim.get_context())
        assert found[:6] == pytest.approx(np.append(asked.force * n, np.zeros(3)))
        assert axes[1:] @ (found[6:9] - ORIGIN) == pytest.approx(asked.place, abs=1e-6)
        assert found[9] == asked.deepest
    assert progress(system, sim.get_context())["outcome"] == law.DONE == now.outcome


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
    assert progress(system, sim.get_context())["outcome"] == law.DONE
