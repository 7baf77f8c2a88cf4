"""Tests of `uvms_drake.campaign.drawn_contact`: draws of scenarios with unknown surfaces."""

from dataclasses import replace

import numpy as np
import pytest

import uvms_drake as uv
from uvms_drake.campaign.campaign import make_campaign
from uvms_drake.campaign.drawn_contact import (
    FARTHEST,
    FORCES,
    PART,
    SPARE,
    drawn_contact,
    never_pressed,
    pace,
    steepest_friction,
    tips,
)
from uvms_drake.campaign.draws import draw
from uvms_drake.control.contact.press_target import SEARCH_DEPTH, search_speed, touch_to_plan
from uvms_drake.model.surface.contact_laws import Linear
from uvms_drake.plant.surface import SurfaceError
from uvms_drake.station.contact.bounds import largest_force, sensed_contact, sensing_of
from uvms_drake.station.contact.drawn_surfaces import is_member
from uvms_drake.station.problem import first_problem
from uvms_drake.station.scenario.scenario import dump_scenario
from uvms_drake.station.step_size import friction_rate
from uvms_drake.tube.terminal_set import TerminalLoop


@pytest.fixture(scope="module")
def base():
    return uv.load_scenario("girona500_contact")


@pytest.fixture(scope="module")
def ocp(base):
    """The problem at t = 0, with the safe region before any contact."""
    model = uv.load_model(base)
    problem = uv.make_ocp(base, model)
    return first_problem(base, problem, uv.start_state(base, problem))


@pytest.fixture(scope="module")
def drawn(base, ocp):
    """Scenarios with walls of their own, from the start of the file."""
    return [drawn_contact(base, ocp, np.random.default_rng(seed))[0] for seed in range(40)]


def test_a_wall_that_is_known_is_not_drawn_anew():
    scenario = uv.load_scenario("girona500_ideal")
    rng = np.random.default_rng(0)
    before = rng.bit_generator.state
    assert drawn_contact(scenario, None, rng) == (scenario, 0)
    assert rng.bit_generator.state == before


@pytest.mark.long
def test_every_wall_is_of_the_class_and_stands_in_front_of_the_tip(drawn, base, ocp):
    contact, (start, goal) = sensed_contact(base), tips(base, ocp)
    distances = []
    for scenario in drawn:
        wall = scenario.surface.checked()
        assert is_member(wall, contact, start, goal)
        assert wall.geometry.depth(start) <= -contact.clearance
        distances.append((wall.anchor - start) @ contact.direction)
    assert max(distances) <= FARTHEST
    assert np.std(distances) > 0.01


@pytest.mark.long
def test_a_drawn_wall_has_no_error_of_the_scenarios_own_wall(base, ocp):
    wrong = replace(base, surface_error=SurfaceError(shift=[0.05, 0.0, 0.0], stiffness=1.4))
    error = drawn_contact(wrong, ocp, np.random.default_rng(0))[0].surface_error
    assert error.stiffness == 1.0
    assert not np.any(error.shift)


@pytest.mark.long
def test_what_is_asked_for_can_be_given_in_the_time(drawn, base, ocp):
    most, (start, _) = largest_force(base), tips(base, ocp)
    for scenario in drawn:
        force = scenario.task.force[0]
        assert FORCES[0] <= force < min(FORCES[1], most)
        speed, pressing = pace(base, ocp, scenario.surface, force)
        way = scenario.surface.anchor[0] - start[0]
        nearest = pytest.approx(sensed_contact(base).clearance + SPARE)
        assert way == nearest or way / speed + pressing < base.duration
        rest = scenario.duration - (way / speed + pressing)
        shortest, longest = base.draws.hold
        assert scenario.duration == base.duration or (
            shortest - 1e-9 <= rest <= longest + ocp.time_step)
        assert scenario.duration <= base.duration


@pytest.mark.long
def test_no_radius_of_the_tube_is_in_a_declared_distribution():
    """Start, force, wall, gap and duration of runs with two tubes, both with a first plan."""
    real = uv.load_scenario("girona500_real_loop")
    half = replace(real, tube=replace(real.tube, **{
        key: 0.5 * np.asarray(value) if key == "u" else 0.5 * value
        for key, value in vars(real.tube).items() if value is not None}))
    for index in range(3):
        one, other = (draw(make_campaign(each, 7, None), index) for each in (real, half))
        assert one[1]["starts"] >= other[1]["starts"]
        if one[1]["starts"] == other[1]["starts"]:
            assert dump_scenario(replace(one[0], tube=half.tube)) == dump_scenario(other[0])


@pytest.mark.long
def test_a_wall_is_near_where_the_time_is_short(base, ocp):
    drawn, _ = drawn_contact(replace(base, duration=2.0), ocp, np.random.default_rng(0))
    start, _ = tips(base, ocp)
    way = (drawn.surface.anchor - start) @ sensed_contact(base).direction
    assert way == pytest.approx(sensed_contact(base).clearance + SPARE)


@pytest.mark.long
def test_the_step_is_short_enough_for_the_friction(drawn, base, ocp):
    config = ocp.model.configuration(ocp.y_des)
    rates = [friction_rate(scenario, ocp.model, config) for scenario in drawn]
    assert max(rates) == pytest.approx(friction_rate(base, ocp.model, config))
    uv.with_step(drawn[int(np.argmax(rates))], ocp.model)
    # With a given step friction is no steeper than that resolves.
    base = uv.load_scenario("girona500_contact", ["simulator.max_step_size=0.002"])
    smooth = replace(base, surface=replace(base.surface, friction=0.0))
    steepest = steepest_friction(smooth, ocp)
    unit = friction_rate(replace(base, surface=replace(base.surface, creep=1.0)), ocp.model, config)
    just = replace(base.surface, creep=1.001 * unit / steepest)
    uv.with_step(replace(base, surface=just), ocp.model)
    with pytest.raises(uv.InvalidParameter, match="max_step_size"):
        uv.with_step(replace(base, surface=replace(just, creep=0.9 * just.creep)), ocp.model)


def test_what_is_followed_is_followed_late(ocp):
    """A reference that moves along n, under the terminal controller, sample by sample."""
    size, h, speed = ocp.model.size, ocp.time_step, 0.01
    loop, xi = TerminalLoop(ocp).closed, np.zeros(2 * ocp.model.size)
    for _ in range(300):
        xi = loop @ xi - h * speed * np.pad(ocp.direction, (0, 2 * size - 3))
    behind = -xi[:3] @ ocp.direction
    assert ocp.following_lag() == pytest.approx(behind / speed, rel=1e-6)
    assert ocp.following_lag(2) == pytest.approx(behind / speed + 2 * h, rel=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("force", [6.0, 26.0])
def test_the_time_to_press_is_no_less_than_that_of_the_way_at_the_speed_that_is_left(
        base, ocp, force):
    """∫ dx/v with v = s/T, with s to the end of the safe region, the target, or by the limit."""
    contact, stiffness = sensed_contact(base), 150.0
    most = contact.walls.share * contact.stiffness
    start, _ = tips(base, ocp)
    speed, pressing = pace(base, ocp, uv.ShapedSurface(law=Linear(stiffness)), force)
    room = ocp.aim.target[0] - SEARCH_DEPTH - start[0]
    now = np.linspace(0.0, force - base.task.force_tolerance, 20001)
    way = np.minimum(room - now / most, (force - now) / (2.0 * stiffness))
    fastest = contact.speed - base.tube.depth_speed
    slowness = np.maximum(ocp.following_lag() / way, 1.0 / fastest)
    spent = np.sum(0.5 * (slowness[1:] + slowness[:-1]) * np.diff(now)) / stiffness
    assert spent <= PART * pressing <= 3.0 * spent
    light = search_speed(force, contact.stiffness, touch_to_plan(
        base.mpc.time_step, 0, sensing_of(base)))
    assert speed == pytest.approx(PART * min(room / ocp.following_lag(), fastest, light))


@pytest.mark.long
def test_what_is_drawn_is_accepted_by_the_test_of_the_draws(drawn, ocp):
    """The replay is of a drawn run as a scenario of its own, whose duration is the least."""
    for scenario in drawn[:10]:
        longer = replace(scenario, duration=scenario.duration + ocp.time_step)
        assert never_pressed(longer, ocp) == []


@pytest.mark.parametrize(("changes", "said"), [
    ({"force": 60.0}, "force: 60 N, drawn from 5 to"), ({"stiffness": 3000.0}, "not of the class"),
    ({"stiffness": 30.0}, "not of the class"), ({"near": 0.05}, "nearer than the clearance"),
    ({"near": 0.1}, "drawn from"),
    ({"near": 0.488, "force": 5.0, "stiffness": 150.0}, "wall: 0.4")])
def test_values_in_the_box_of_the_ranges_that_no_draw_has_are_named(base, ocp, changes, said):
    """As 5 N on a soft wall half a metre off: each is in its range, and never touched in time."""
    start, _ = tips(base, ocp)
    point = start + changes.get("near", 0.2) * sensed_contact(base).direction
    wall = replace(base.surface, law=Linear(changes.get("stiffness", 700.0)),
                   geometry=replace(base.surface.geometry, point=point))
    scenario = replace(base, surface=wall, duration=14.0, task=replace(
        base.task, force=sensed_contact(base).wrench(changes.get("force", 20.0))))
    found = never_pressed(scenario, ocp)
    assert len(found) == 1 and said in found[0]
