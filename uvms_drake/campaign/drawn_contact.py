"""Walls and forces that a campaign draws for a sensed contact.

A mission is the same in every run: its steps have forces of their own, and the wall is of the class
wherever they may touch it.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from uvms_drake.common.errors import RunFailed, require
from uvms_drake.control.contact.press_target import SEARCH_DEPTH, search_speed, touch_to_plan
from uvms_drake.control.mpc.planner import committed_intervals
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.tracking_ocp import TrackingOcp
from uvms_drake.model.surface import ShapedSurface
from uvms_drake.model.surface.law import check_surface
from uvms_drake.plant.surface import SurfaceError
from uvms_drake.station.contact.bounds import (
    largest_force,
    largest_margin,
    pressing_force,
    safe_depth_margin,
    sensed_contact,
    sensing_of,
)
from uvms_drake.station.contact.drawn_mission import (
    ends_of,
    in_words,
    places_of,
    searched,
    seconds_of,
)
from uvms_drake.station.contact.drawn_surfaces import (
    AT_THE_BOUND,
    SOFTEST,
    across,
    draw_wall,
    is_member,
)
from uvms_drake.station.problem import true_surface
from uvms_drake.station.scenario.parts import command_path_of
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.step_size import friction_rate, largest_rate

FORCES = (5.0, 30.0)
"""Range of the desired force, limited to the largest that the class allows [N]."""
SPARE, FARTHEST = 0.02, 0.5
"""Smallest distance to a wall along n beyond the class's clearance, and largest distance [m]."""
PART = 0.8
"""Safety factor on the estimated speed."""
LEAST_CREEP = 0.005
"""Smallest creep of friction [m/s]."""
ATTEMPTS = 1000


def drawn_contact(scenario: Scenario, ocp: Ocp, rng: np.random.Generator,
                  likely: float = AT_THE_BOUND) -> tuple[Scenario, int]:
    """Returns the scenario with an unknown wall of the class, and any admissible desired force.

    Besides, the number of drawn walls. A scenario with a known surface stays as it is.

    Its distance is limited so that it should be reached and pressed in time; a very soft one, or a
    long slide along it, may take longer all the same. A run lasts as long as its wall and a hold
    should need, and no longer than the scenario. With a mission no force and no hold is drawn, and
    at every place the wall is beyond the class's clearance, and pressed within the search distance.

    Args:
        scenario: The scenario.
        ocp: Its problem at the start.
        rng: Random generator.
        likely: Probability of each parameter of the wall to be at its bound.

    Raises:
        RunFailed: No draw is in the class.
    """
    if not isinstance(ocp, TrackingOcp):
        return scenario, 0
    contact = sensed_contact(scenario)
    force = float(rng.uniform(*drawn_forces(scenario)))
    least, longest = scenario.draws.hold
    hold = float(least if scenario.mission.steps else rng.uniform(least, longest))
    steepest = steepest_friction(scenario, ocp)
    scenario = replace(scenario, task=replace(scenario.task, force=contact.wrench(force)))
    start, goal = ends_of(scenario.mission, contact.walls, *tips(scenario, ocp))
    # A wall of the class, at a distance that leaves time to reach it, to settle and to hold.
    for attempt in range(ATTEMPTS):
        far = float(rng.uniform())
        wall = draw_wall(contact, start, goal, rng, likely)
        if wall is None:
            continue
        speed, rest, most = time_of(scenario, ocp, wall, force, hold)
        nearest = contact.clearance + SPARE
        gap = nearest + far * max(most - nearest, 0.0)
        wall = wall.moved(np.eye(3), gap * contact.direction)
        if misplaced(scenario, ocp, wall, force):
            continue
        # A run of whole samples, and friction no steeper than the integration step resolves.
        samples = int(np.ceil((gap / speed + rest) / ocp.time_step))
        drawn = replace(scenario, surface=wall, surface_error=SurfaceError(),
                        duration=min(samples * ocp.time_step, scenario.duration))
        at_unit_creep = friction_rate(drawn, ocp.model, ocp.model.configuration(ocp.y_des))
        creep = max(LEAST_CREEP, at_unit_creep / steepest)
        return replace(drawn, surface=replace(wall, creep=creep)), attempt + 1
    raise RunFailed(f"none of {ATTEMPTS} drawn walls is in the class")


def time_of(scenario: Scenario, ocp: TrackingOcp, wall: ShapedSurface, force: float, hold: float
            ) -> tuple[float, float, float]:
    """Returns the expected time of a run: press of a force [N] for a hold [s], or mission.

    It is the speed of the approach [m/s], the time without it: hover, settling of the force and
    hold, or mission [s], and the largest distance of a wall that is pressed in time [m].
    """
    contact, mission = sensed_contact(scenario), scenario.mission
    speed, pressing = pace(scenario, ocp, wall, force)
    if mission.steps:
        start, goal = tips(scenario, ocp)
        pressing = seconds_of(
            mission, places_of(mission, contact.walls, goal, start),
            partial(press_time, scenario, ocp, wall), _lag(scenario, ocp))
    rest = scenario.mpc.hover + pressing + hold
    return speed, rest, min(FARTHEST, speed * (scenario.duration - rest))


def misplaced(scenario: Scenario, ocp: TrackingOcp, wall: ShapedSurface, force: float) -> bool:
    """Returns whether a wall is too near at a place of the task, or beyond a mission's search."""
    contact, mission = sensed_contact(scenario), scenario.mission
    start, goal = tips(scenario, ocp)
    depths = wall.geometry.depth(places_of(mission, contact.walls, goal, start))
    strongest = max((step.strongest for step in mission.steps), default=force)
    pressed = wall.law.depth_for(strongest) - np.min(depths)
    return bool(np.max(depths) > -contact.clearance or pressed > searched(mission))


def never_pressed(scenario: Scenario, ocp: Ocp) -> list[str]:
    """Returns the force or wall of a scenario's own run that no draw of `drawn_contact` has."""
    if not isinstance(ocp, TrackingOcp):
        return []
    contact, wall = sensed_contact(scenario), check_surface(true_surface(scenario))
    (low, high), force = drawn_forces(scenario), pressing_force(scenario)
    if not low <= force <= high:
        return [f"force: {force:.3g} N, drawn from {low:.3g} to {high:.3g} N"]
    start, goal = ends_of(scenario.mission, contact.walls, *tips(scenario, ocp))
    if not (isinstance(wall, ShapedSurface) and is_member(wall, contact, start, goal)
            and max(wall.law.slopes) >= SOFTEST * contact.stiffness):
        return ["wall: not of the class in a ball about all places, as every drawn one is"]
    if misplaced(scenario, ocp, wall, force):
        return ["wall: nearer than the clearance, or beyond the mission's search"]
    gap = -float(wall.geometry.depth(start + 0.5 * across(contact.direction, goal - start)))
    hold, least = float(scenario.draws.hold[0]), contact.clearance + SPARE
    most = max(time_of(scenario, ocp, wall, force, hold)[2], least)
    return [] if least <= gap <= most else [
        f"wall: {gap:.3g} m off, with its stiffness and this force drawn from {least:.3g} to "
        f"{most:.3g} m"]


def drawn_forces(scenario: Scenario) -> tuple[float, float]:
    """Returns the smallest and the largest desired force that is drawn [N].

    With a mission both are the task's, of the first plan.
    """
    if scenario.mission.steps:
        own = pressing_force(scenario)
        return own, own
    asked = scenario.draws.force
    low, high = np.minimum(FORCES, largest_force(scenario)) if asked is None else asked
    return float(low), float(high)


def check_forces(scenario: Scenario) -> None:
    """Raises `InvalidParameter` for a range of forces that a run cannot tell from none."""
    if scenario.contact.declared_wall() is not None and not scenario.mission.steps:
        least, tolerance = drawn_forces(scenario)[0], scenario.task.force_tolerance
        require(least > tolerance, "task.force_tolerance", tolerance,
                f"below {least:.3g} N, the least desired force that is drawn")


def force_to_admit(scenario: Scenario) -> tuple[str, float]:
    """Returns key and size of the largest desired force [N] of a mission's steps, or drawn."""
    steps = {f"mission.steps[{i}].force": step.strongest
             for i, step in enumerate(scenario.mission.steps)}
    return max(steps.items(), key=lambda item: item[1],
               default=("draws.force", drawn_forces(scenario)[1]))


def about_drawn(scenario: Scenario) -> Iterator[str]:
    """Yields the sentences on the mission or the force, and on the wall, if it is drawn."""
    if scenario.contact.declared_wall() is None:
        return
    contact, mission, forces = sensed_contact(scenario), scenario.mission, drawn_forces(scenario)
    if mission.steps:
        yield f"mission, the same in every run: {in_words(mission)}"
    else:
        yield (f"desired force: uniform from {forces[0]:.3g} to {forces[1]:.3g} N, held for "
               f"{scenario.draws.hold[0]:g} to {scenario.draws.hold[1]:g} s, but no longer than to "
               f"{scenario.duration:g} s")
    yield ("wall: plane, hull, pipe from inside or bumps, with a linear, hardening or bilinear "
           f"force; normal within {contact.angle:.3g} rad of the direction, stiffness from "
           f"{SOFTEST:g} of {contact.stiffness:g} N/m to all of it, friction up to "
           f"{contact.friction:g}, dissipation up to {contact.dissipation:g} s/m: each at its "
           f"bound with the probability {AT_THE_BOUND:g}, else uniform; at a distance of up to "
           f"{FARTHEST:g} m, as far as it can be pressed in time"
           + (", of this class and within the search distance wherever the mission may touch it"
              if mission.steps else ""))


def tips(scenario: Scenario, ocp: Ocp) -> tuple[np.ndarray, np.ndarray]:
    """Returns the start of the tip, and its desired position but for the depth (3,) [m]."""
    return ocp.model.task_pose(scenario.start.config)[:3], ocp.y_des[:3]


def pace(scenario: Scenario, ocp: TrackingOcp, wall: ShapedSurface, force: float
         ) -> tuple[float, float]:
    """Returns the approach speed v to a wall [m/s], and the time to press [s].

    A tip follows a moving target with a lag T (committed horizon included), so a target always s
    away is followed at s/T, up to the speed limit. In free water s is the distance s₀ to the end of
    the safe region; a light press is slower, see `control.contact.press_target`. In a wall of
    stiffness κ it is the lesser of two: to the end of the safe region, s₀ − F/κ', and to the
    target, (F_des − F)/κ̂ with κ̂ ≤ 2κ. With Ḟ = κ s/T, F is within ε of F_des after T times the
    larger of

        κ'/κ ln(s₀/(s₀ − F_des/κ'))    and    2 ln(F_des/ε),    κ' = a₋κ₊ (`SurfaceClass.share`),

    plus the time of the distance F_des/κ at the largest speed. Both are conservative estimates.

    With a declared `draws.speed` no radius is in them: that is the speed limit, and s₀ that of
    the largest tube with which the safe region admits the largest force.
    """
    committed = _committed(scenario, ocp)
    contact, lag = sensed_contact(scenario), ocp.following_lag(committed)
    distance = float(ocp.direction @ (ocp.aim.target - tips(scenario, ocp)[0])) - SEARCH_DEPTH
    fastest = scenario.draws.speed or contact.speed - (scenario.tube.depth_speed or 0.0)
    if scenario.draws.speed is not None:
        distance += safe_depth_margin(scenario) - largest_margin(
            scenario, force_to_admit(scenario)[1])
    speed = min(distance / lag, fastest, search_speed(force, contact.stiffness, touch_to_plan(
        ocp.time_step, committed, sensing_of(scenario))))
    slope, stiffest = wall.law.slopes[0], contact.walls.share * contact.stiffness
    slower = max(
        stiffest / slope * np.log(distance / (distance - force / stiffest)),
        2.0 * np.log(force / scenario.task.force_tolerance))
    pressing = lag * slower + force / (slope * min(distance / lag, fastest))
    return PART * speed, float(pressing) / PART


def press_time(scenario: Scenario, ocp: TrackingOcp, wall: ShapedSurface, force: float) -> float:
    """Returns the time to press of `pace` without its safety factor [s]."""
    return PART * pace(scenario, ocp, wall, force)[1]


def _committed(scenario: Scenario, ocp: TrackingOcp) -> int:
    """Returns the number of committed intervals at the beginning of a plan."""
    return int(ocp.in_advance) + committed_intervals(
        scenario.ancillary, command_path_of(scenario.actuation, ocp.model), ocp.time_step)


def _lag(scenario: Scenario, ocp: TrackingOcp) -> float:
    """Returns the lag of a tip behind a moving target [s]."""
    return ocp.following_lag(_committed(scenario, ocp))


def steepest_friction(scenario: Scenario, ocp: Ocp) -> float:
    """Returns the largest rate of a drawn wall's friction [1/s], see `with_step`.

    It is that of the scenario's own wall, for which the step is short enough; if that has no
    friction, the largest rate that the step resolves.
    """
    own = friction_rate(scenario, ocp.model, ocp.model.configuration(ocp.y_des))
    return min(own or np.inf, largest_rate(scenario))
