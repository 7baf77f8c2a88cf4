"""Tests of the mission of a scenario: its file, its place in the loop, and the certificate."""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.geometry import Meshcat, MeshcatParams
from support.meshcat import press

import uvms_drake as uv
from uvms_drake.common.errors import ScenarioError
from uvms_drake.mission.steps import Approach, Hold, Mission, Retreat, Slide
from uvms_drake.report.mission import summarise_mission
from uvms_drake.report.summary import broken
from uvms_drake.station.contact.bounds import largest_force, mission_conditions
from uvms_drake.station.scenario.scenario import dump_scenario
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


def test_a_mission_comes_from_a_file_and_goes_back_into_one(scenario, tmp_path):
    kinds = [type(step) for step in scenario.mission.steps]
    assert kinds == [Approach, Hold, Retreat, Approach, Hold, Slide, Retreat]
    path = tmp_path / "mine.yaml"
    path.write_text(dump_scenario(scenario))
    assert dump_scenario(uv.load_scenario(str(path))) == dump_scenario(scenario)
    assert uv.load_scenario(NAME, ["mission.steps.5.speed=0.01"]).mission.steps[5].speed == 0.01


@pytest.mark.parametrize(("override", "message"), [
    ("mission.steps.5.speed=-1.0", r"mission\.steps\[5\]\.speed = -1.0: must be positive"),
    ("mission.steps=[!Hold {}]", r"mission\.steps\[0\] = 'Hold': must be an !Approach"),
    ("mission.steps.1=!Wait {}", r"mission\.steps\[?\.?1"),
    ("contact=!KnownSurface {}", r"mission\.steps = .* left out, without a sensed contact")])
def test_a_mission_that_makes_no_sense_is_refused_by_its_key(override, message):
    with pytest.raises(ScenarioError, match=message):
        uv.load_scenario(NAME, [override])


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


def test_without_a_mission_the_targets_come_from_outside(scenario):
    station = uv.make_station(replace(scenario, mission=Mission()))
    assert not station.HasInputPort("stop")
    assert all(map(station.HasInputPort, ("desired_force", "place", "deepest")))


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
