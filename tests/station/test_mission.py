"""Tests of the mission of a scenario: its file, its place in the loop, and the certificate."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams
from support.meshcat import press

import uvms_drake as uv
from uvms_drake.certificate.run_verdict import broken
from uvms_drake.control.limits import TubeRadii
from uvms_drake.mission import system
from uvms_drake.mission.law import DONE, RETREATED, begin
from uvms_drake.mission.steps import Approach, Hold, Mission, Retreat, Slide
from uvms_drake.model.surface.law import TipErrors
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.model.surface.unknown_contact import UnknownContact
from uvms_drake.report.mission import summarise_mission
from uvms_drake.station import simulation
from uvms_drake.station.contact.bounds import largest_force, mission_conditions
from uvms_drake.station.contact.drawn_mission import (
    ends_of,
    in_words,
    places_of,
    searched,
    seconds_of,
)
from uvms_drake.station.contact.mission_legs import legs_of
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.ultimate_bounds import tip_errors
from uvms_drake.visual.controls import HOME

NAME = "girona500_inspection"


@pytest.fixture(scope="module")
def scenario():
    return uv.load_scenario(NAME)


@pytest.mark.parametrize("name", ["jacket_inspection", "jacket_inspection_real"])
def test_the_leg_of_a_jacket_is_of_the_class_that_the_controller_is_told(name):
    """Wherever the mission goes, and 10 mm beside: no normal is further off than the angle."""
    scenario = uv.load_scenario(name)
    walls, surface = scenario.contact.walls, scenario.surface
    a, b = np.meshgrid(np.linspace(-0.21, 0.31, 9), np.linspace(-0.07, 0.07, 9))
    places = a[..., None] * walls.axes[1] + b[..., None] * walls.axes[2]
    for depth in np.linspace(-0.3, 0.0, 7):
        near, gradient = surface.geometry.depth_and_gradient(places + depth * walls.direction)
        touched = np.abs(near) < 0.05
        assert np.all((gradient @ walls.direction)[touched] >= np.cos(walls.angle))
    assert surface.law.stiffness < walls.stiffness
    assert surface.friction == 0.3 < walls.friction


@pytest.mark.parametrize("name", ["bluerov2_cp_probe", "girona500_unknown_floor"])
def test_a_shipped_surface_is_of_the_class_and_as_far_off_as_told(name):
    """What the controller is told of it at the start: its normal, its law, the way free ahead."""
    scenario = uv.load_scenario(name)
    walls, surface, model = scenario.contact.walls, scenario.surface, uv.load_model(scenario)
    start = np.concatenate([scenario.start.eta, scenario.start.q])
    tip = model.kinematics(start).chi[:3]
    ahead = tip + np.linspace(0.0, scenario.contact.clearance, 7)[:, None] * walls.direction
    depth, gradient = surface.geometry.depth_and_gradient(ahead)
    assert np.all(depth < 0.0)
    assert np.all(gradient @ walls.direction >= np.cos(walls.angle))
    assert surface.law.stiffness < walls.stiffness
    assert surface.friction < scenario.contact.friction
    assert surface.dissipation < scenario.contact.dissipation


def test_the_station_is_driven_by_it(scenario):
    station = uv.make_station(scenario)
    assert station.HasInputPort("stop")
    assert not any(map(station.HasInputPort, ("desired_force", "place", "deepest")))
    context = station.CreateDefaultContext()
    found = {name: station.GetOutputPort(name).Eval(context)
             for name in ("desired_force", "target", "mission_place", "mission_progress")}
    # The first spot is approached off the wall: straight across, with no force.
    assert found["desired_force"] == pytest.approx(np.zeros(6))
    assert found["mission_place"] == pytest.approx(np.zeros(3))
    assert found["mission_progress"] == pytest.approx(np.zeros(5))
    assert found["target"][1:] == pytest.approx(np.zeros(2), abs=1e-12)
    assert -0.3 < found["target"][0] < -0.25, "as deep as the tip is at the start"


def test_a_button_says_stop_to_it(scenario):
    meshcat = Meshcat(MeshcatParams(host="localhost"))
    station = uv.make_station(scenario, meshcat=meshcat)
    assert not station.HasInputPort("stop")
    context = station.CreateDefaultContext()
    mission = station.GetSubsystemByName("mission")
    said = []
    for t in (0.0, 0.05, 0.1):
        context.SetTime(t)
        said.append(mission.GetInputPort("stop").Eval(mission.GetMyContextFromRoot(context))[0])
        if t == 0.05:
            press(meshcat, HOME)
    assert said == [0.0, 0.0, 1.0]


@pytest.mark.parametrize(("outcome", "end"), [(DONE, 0.3), (RETREATED, 0.6)])
def test_a_run_is_over_some_time_after_a_mission_that_is_done_and_after_no_other(
        outcome, end, monkeypatch):
    monkeypatch.setattr(simulation, "REST", 0.25)
    monkeypatch.setattr(system, "begin", lambda *args: begin(*args)._replace(outcome=outcome))
    record = uv.simulate(uv.load_scenario(NAME, ["duration=0.6"]))
    assert record.time[-1] == pytest.approx(end, abs=0.06) and not record.failure
    assert record.scenario.duration == pytest.approx(record.time[-1])


@pytest.mark.long
@pytest.mark.parametrize(("fault", "reason"), [
    ("", "stopped"), ("!LostForce {start: 11.0, duration: 1.0}", "force lost"),
    ("!LostState {start: 11.0, duration: 0.3}", "state lost")])
def test_from_the_middle_of_a_slide_the_vehicle_as_it_is_goes_back_within_all_limits(fault, reason):
    scenario = uv.load_scenario("jacket_inspection_real", [
        "surface.geometry.point.0=-0.27", "duration=15", f"faults=[{fault}]", "mission.steps=["
        "!Approach {at: [-0.09, 0.06], within: 0.3}, !Hold {seconds: 0.5}, "
        "!Slide {along: [0.2, 0.0]}, !Retreat {distance: 0.05}]"])
    meshcat = Meshcat(MeshcatParams(host="localhost"))

    def somebody(_, done):
        if not fault and done * scenario.duration >= 11.0:
            press(meshcat, HOME)

    record = uv.simulate(scenario, meshcat=meshcat, progress=somebody)
    *_, slide, retreat = summarise_mission(record)["steps"]
    assert (slide["kind"], slide["ended"]) == ("Slide", reason)
    assert 11.0 <= retreat["begin_s"] < 11.3
    assert retreat["ended"] == "done"
    assert not broken(uv.summarise(record))
    assert record.force[-1] == pytest.approx(np.zeros(6))


def test_a_step_that_asks_for_more_than_the_front_allows_is_refused(scenario):
    most = largest_force(scenario)
    steps = [Approach(), Hold(force=most + 0.1), Retreat()]
    with pytest.raises(uv.InvalidParameter, match=r"mission\.steps\[1\]\.force = .*: must be less"):
        uv.make_station(replace(scenario, mission=Mission(steps=steps)))


def test_the_certificate_names_the_step_that_it_does_not_cover(scenario):
    conditions = mission_conditions(scenario)
    assert [condition.name.split(",")[0] for condition in conditions] == [
        f"mission.steps[{i}]" for i in (0, 1, 3, 4, 5, 5)]
    assert all(condition.holds for condition in conditions)
    room = scenario.contact.speed_across - scenario.tube.tip_speed
    slide = Slide(along=np.array([0.3, -0.4]), speed=1.3 * room, amplitude=3.0, frequency=0.1,
                  force=largest_force(scenario) - 2.5)
    steps = [Approach(), slide, Retreat()]
    force, speed = mission_conditions(replace(scenario, mission=Mission(steps=steps)))[1:]
    assert not force.holds
    assert speed.left == pytest.approx(0.8 * 1.3 * room)
    assert not speed.holds


# Tests of `station.contact.mission_legs`: what is certified of the steps of a mission.


CONTACT = UnknownContact(angle=0.15, stiffness=900.0, force_error=1.2, dissipation=0.8, delay=0.1)
TUBE = TubeRadii(e=0.01, z=0.1, position=0.002, depth=0.0012, orientation=0.01, joints=0.01,
                 nu1=0.01, nu2=0.01, qdot=0.1, tip_speed=0.03, depth_speed=0.02, roll=0.01,
                 pitch=0.01, u=np.full(10, 0.1))


def worst_of(rng, force, speed, short):
    """Returns the largest |F(t) − F| of drawn walls of the class and histories in the tube.

    Of each wall of slope κ along n and α across it, and whatever was learned of it: a reading of a
    time up to W ago, in error and with the damping of then; the target by it; the tip as far off
    its plan as it may be, at the reading and now.
    """
    n = 200_000
    kappa, learned = rng.uniform(0.0, CONTACT.stiffness, (2, n))
    alpha = CONTACT.walls.tilt
    kappa, learned = (np.where(rng.uniform(size=n) < 0.3, end, each) for end, each in (
        (CONTACT.stiffness, kappa), (0.0, learned)))
    ends = rng.choice([-1.0, 0.3, 1.0], (7, n))
    # On a slide plan and wall go apart by the difference of two inclinations, either way.
    rate = TUBE.depth_speed + alpha * (TUBE.tip_speed + 2.0 * speed)
    # Along n of a normal force 1: by tilt and by friction of any direction, then and now.
    beta, friction = CONTACT.angle * rng.choice([0.5, 1.0], n), CONTACT.friction
    then, now_along = np.cos(beta) + friction * np.sin(beta) * rng.choice([-1.0, 1.0], (2, n))
    size = TUBE.depth + alpha * TUBE.position
    off, later = size * ends[0], size * ends[6]
    most = 2.0 * size + 2.0 * alpha * speed * CONTACT.delay
    way = np.clip(later - off + rate * CONTACT.delay * ends[3], -most, most)
    # F̂ − F = κ̂(ε − ℓ); F(t) = φ(1 + cδ̇), and the reading is φ'(1 + cδ̇') + its error.
    read = force + learned * (off - short * ends[5])
    before = (read + CONTACT.force_error * ends[1]) / (
        then * (1.0 + CONTACT.dissipation * rate * ends[2]))
    static = np.maximum(before + kappa * way, 0.0)
    now = now_along * static * (1.0 + CONTACT.dissipation * rate * ends[4])
    return float(np.max(np.abs(now - force)))


@pytest.mark.parametrize("speed", [0.0, 0.04])
@pytest.mark.parametrize("short", [0.0, 0.002])
@pytest.mark.parametrize("delay", [0.0, 0.01, 0.11])
def test_no_wall_of_the_class_gives_more_and_some_nearly_as_much(speed, short, delay, monkeypatch):
    """With a short delay it is a small estimate of the stiffness that is worst."""
    monkeypatch.setitem(globals(), "CONTACT", replace(CONTACT, delay=delay))
    bound = CONTACT.band(10.0, tip_errors(TUBE), speed, short)
    worst = worst_of(np.random.default_rng(1), 10.0, speed, short)
    assert 0.85 * bound < worst <= bound * (1.0 + 1e-12)


def test_what_is_left_of_it_when_all_but_one_is_exact():
    off = tip_errors(TUBE)
    none = replace(CONTACT, force_error=1e-12, dissipation=0.0, angle=0.0,
                   friction=0.0)
    assert replace(none, delay=0.0).band(10.0, off, 0.02) == pytest.approx(1800.0 * 0.0012)
    assert replace(none, delay=9.0).band(10.0, off, 0.02) == pytest.approx(2700.0 * 0.0012)
    still = TipErrors(0.0, 0.0, 0.0, 0.0, 0.0)
    assert replace(CONTACT, angle=0.0).band(10.0, still, 0.02) == pytest.approx(1.2)
    assert replace(CONTACT, dissipation=50.0).band(10.0, off) == np.inf


def test_every_step_has_its_leg_and_the_one_that_is_void_says_so():
    mission = Mission(steps=[
        Approach(settle=0.5), Hold(seconds=4.0), Slide(along=np.array([0.3, -0.4]), speed=0.05),
        Retreat(timeout=20.0)]).checked()
    name = "mission.steps[2], tangential speed of a plan [m/s]"
    legs = legs_of(mission, CONTACT, TUBE, [
        Condition("mission.steps[1], largest force in the safe region [N]", 10.0, "<", 15.0,
                  theorem="t", about="mission.steps[1]"),
        Condition(name, 0.05, "<=", 0.04, theorem="t", about="mission.steps[2]")])
    assert [leg.kind for leg in legs] == ["Approach", "Hold", "Slide", "Retreat"]
    assert [(leg.least, leg.most) for leg in legs] == [
        (0.5, 60.0), (4.0, 60.0), (10.0, 60.0), (0.0, 20.0)]
    assert [leg.band is None for leg in legs] == [True, False, True, True]
    assert [leg.unmet != "" for leg in legs] == [False, False, True, False]
    assert legs[2].unmet.startswith(name)


# Tests of `station.contact.drawn_mission`: places, times and words of a mission.


WALLS = SurfaceClass(direction=np.array([1.0, 0.0, 0.0]))  # t₁ is down, t₂ to the left.
ORIGIN, START = np.array([0.5, 1.0, 2.0]), np.array([-0.4, 1.1, 2.2])
MISSION = Mission([
    Approach(at=np.array([-0.2, 0.0]), within=0.3), Hold(seconds=4.0), Retreat(distance=0.05),
    Approach(at=np.array([0.0, 0.1]), settle=0.5),
    Slide(along=np.array([0.4, 0.0]), speed=0.1), Retreat(distance=0.1)])


def test_the_places_are_those_of_the_steps_as_deep_as_the_start():
    places = places_of(MISSION, WALLS, ORIGIN, START)
    expected = [START[1:], (1.0, 1.8), (1.0, 1.8), (1.0, 1.8), (1.0, 1.8), (1.0, 1.8), (1.0, 1.8),
                (0.9, 2.0), (0.9, 2.0), (0.9, 2.0), (0.9, 2.4), (0.9, 2.4), (0.9, 2.4)]
    np.testing.assert_allclose(places[:, 1:], expected, atol=1e-12)
    np.testing.assert_allclose(places[:, 0], START[0])
    np.testing.assert_allclose(places_of(Mission(), WALLS, ORIGIN, START), [START])


def test_all_places_are_between_the_ends():
    """In the disk of which they are the ends of a diameter; without a mission: start and goal."""
    first, last = ends_of(MISSION, WALLS, START, ORIGIN)
    middle, radius = 0.5 * (first + last), 0.5 * np.linalg.norm(last - first)
    away = np.linalg.norm(places_of(MISSION, WALLS, ORIGIN, START) - middle, axis=1)
    assert np.max(away) == pytest.approx(radius)
    np.testing.assert_allclose(middle, [START[0], 1.0, 2.1])
    ends = ends_of(Mission(), WALLS, START, ORIGIN)
    assert ends[0] is START and ends[1] is ORIGIN


def test_the_time_is_that_of_holds_lines_ways_and_presses():
    """With a lag of 2 s and 3 s to press."""
    ways = [np.hypot(0.1, 0.4), 0.05, 0.05, np.hypot(0.1, 0.2), 0.1]  # From spot to spot, back, to.
    travel = 2.0 * np.sum(np.log(np.array(ways) / 0.01))
    seconds = seconds_of(MISSION, places_of(MISSION, WALLS, ORIGIN, START), lambda _: 3.0, 2.0)
    settling, holding, sliding, lag = 1.0 + 0.5, 4.0, 4.0, 2.0
    assert seconds == pytest.approx(travel + 2 * 3.0 + settling + holding + sliding + lag)


def test_words_have_every_step_and_its_values():
    assert searched(MISSION) == 0.3
    assert searched(Mission()) == np.inf
    assert in_words(Mission(MISSION.steps[3:], retries=2)) == (
        "approach force 10 N, at (0, 0.1) m; slide force 10 N, along (0.4, 0) m, speed 0.1 m/s; "
        "retreat distance 0.1 m; retries of a spot: 2")
