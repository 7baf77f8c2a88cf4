"""Walls and forces that a campaign draws for a sensed contact.

A mission is the same in every run: its steps have forces of their own, and the wall is of the class
wherever they may touch it.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from uvms_drake.common.errors import RunFailed
from uvms_drake.control.contact.press_target import SEARCH_DEPTH, search_speed, touch_to_plan
from uvms_drake.control.mpc.planner import committed_intervals
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.tracking_ocp import TrackingOcp
from uvms_drake.model.surface import ShapedSurface
from uvms_drake.plant.surface import SurfaceError
from uvms_drake.station.contact.bounds import (
    largest_force,
    pressing_force,
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
from uvms_drake.station.contact.drawn_surfaces import AT_THE_BOUND, SOFTEST, draw_wall
from uvms_drake.station.scenario.parts import command_path_of
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.step_size import friction_rate, largest_rate

FORCES = (5.0, 30.0)
"""Range of the desired force, limited to the largest that the class allows [N]."""
SPARE, FARTHEST = 0.02, 0.5
"""Smallest distance to a wall along n beyond the class's clearance, and largest distance [m]."""
PART = 0.8
"""Safety factor on the estimated speed."""
SETTLING = 3.0
"""Duration of a run after the expected settling of the force [s]."""
LEAST_CREEP = 0.005
"""Smallest creep of friction [m/s]."""
ATTEMPTS = 1000


def drawn_contact(scenario: Scenario, ocp: Ocp, rng: np.random.Generator) -> Scenario:
    """Returns the scenario with an unknown wall of the class, and any admissible desired force.

    One with a known surface stays as it is.

    Its distance is limited so that it should be reached and pressed in time; a very soft one, or a
    long slide along it, may take longer all the same. A run lasts as long as its wall should need,
    and no longer than the scenario. With a mission no force is drawn, and at every place
    the wall is beyond the class's clearance, and pressed within the search distance.

    Raises:
        RunFailed: No draw is in the class.
    """
    if not isinstance(ocp, TrackingOcp):
        return scenario
    contact, mission = sensed_contact(scenario), scenario.mission
    force = float(rng.uniform(*drawn_forces(scenario)))
    steepest = steepest_friction(scenario, ocp)
    scenario = replace(scenario, task=replace(scenario.task, force=contact.wrench(force)))
    start, goal = tips(scenario, ocp)
    places = places_of(mission, contact.walls, goal, start)
    strongest = max((step.strongest for step in mission.steps), default=force)
    start, goal = ends_of(mission, contact.walls, start, goal)
    # A wall of the class, at a distance that leaves time to reach it and to settle.
    for _ in range(ATTEMPTS):
        far = float(rng.uniform())
        wall = draw_wall(contact, start, goal, rng)
        if wall is None:
            continue
        speed, pressing = pace(scenario, ocp, wall, force)
        if mission.steps:
            pressing = seconds_of(
                mission, places, partial(press_time, scenario, ocp, wall), _lag(scenario, ocp))
        remaining = scenario.mpc.hover + pressing + SETTLING
        most = min(FARTHEST, speed * (scenario.duration - remaining))
        nearest = contact.clearance + SPARE
        gap = nearest + far * max(most - nearest, 0.0)
        wall = wall.moved(np.eye(3), gap * contact.direction)
        depths = wall.geometry.depth(places)
        pressed = wall.law.depth_for(strongest) - np.min(depths)
        if np.max(depths) > -contact.clearance or pressed > searched(mission):
            continue
        # A run of whole samples, and friction no steeper than the integration step resolves.
        samples = int(np.ceil((gap / speed + remaining) / ocp.time_step))
        drawn = replace(scenario, surface=wall, surface_error=SurfaceError(),
                        duration=min(samples * ocp.time_step, scenario.duration))
        at_unit_creep = friction_rate(drawn, ocp.model, ocp.model.configuration(ocp.y_des))
        creep = max(LEAST_CREEP, at_unit_creep / steepest)
        return replace(drawn, surface=replace(wall, creep=creep))
    raise RunFailed(f"none of {ATTEMPTS} drawn walls is in the class")


def drawn_forces(scenario: Scenario) -> tuple[float, float]:
    """Returns the smallest and the largest desired force that is drawn [N].

    With a mission both are the task's, of the first plan.
    """
    if scenario.mission.steps:
        own = pressing_force(scenario)
        return own, own
    low, high = np.minimum(FORCES, largest_force(scenario))
    return float(low), float(high)


def about_drawn(scenario: Scenario) -> Iterator[str]:
    """Yields the sentences on the mission or the force, and on the wall, if it is drawn."""
    if scenario.contact.declared_wall() is None:
        return
    contact, mission, forces = sensed_contact(scenario), scenario.mission, drawn_forces(scenario)
    if mission.steps:
        yield f"mission, the same in every run: {in_words(mission)}"
    else:
        yield f"desired force: uniform from {forces[0]:.3g} to {forces[1]:.3g} N"
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
    """
    committed = _committed(scenario, ocp)
    contact, lag = sensed_contact(scenario), ocp.following_lag(committed)
    distance = float(ocp.direction @ (ocp.aim.target - tips(scenario, ocp)[0])) - SEARCH_DEPTH
    fastest = contact.speed - (scenario.tube.depth_speed or 0.0)
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
    return committed_intervals(
        scenario.ancillary, command_path_of(scenario.actuation, ocp.model), ocp.time_step,
        ocp.in_advance)


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
