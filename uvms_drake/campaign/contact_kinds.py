"""What a campaign draws and judges of the contact, by what the controller is told of it."""

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any

import numpy as np

from uvms_drake.campaign.contact_metrics import pressed
from uvms_drake.campaign.drawn_surfaces import draw_wall
from uvms_drake.common.errors import RunFailed
from uvms_drake.control.contact.press_target import AHEAD, search_speed, touch_to_plan
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.tracking_ocp import TrackingOcp
from uvms_drake.control.plan.commitment import committed_intervals
from uvms_drake.model.surface import ShapedSurface
from uvms_drake.plant.surface_error import SurfaceError
from uvms_drake.station.contact_bounds import largest_force, sensed_contact, sensing_of
from uvms_drake.station.motions.dynamic import actuation_delay_of
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.step_size import friction_rate, largest_rate

FORCES = (5.0, 30.0)
"""Range of the desired force, as far as the class lets it be asked for [N]."""
SPARE, FARTHEST = 0.02, 0.5
"""Way to a wall along n: what it is more than the class's clearance at least, and all of it at most
[m]."""
PART = 0.8
"""Part of the estimated speed that is counted on."""
SETTLING = 3.0
"""Time that a run goes on when the force should have settled [s]."""
LEAST_CREEP = 0.005
"""Smallest creep of friction [m/s]."""
ATTEMPTS = 1000


class ContactKind(ABC):
    """A kind of contact, for a campaign."""

    @abstractmethod
    def turned(self, scenario: Scenario, R: np.ndarray) -> Scenario:
        """Returns a scenario with what the controller is told turned by R (3, 3)."""

    @abstractmethod
    def drawn(self, scenario: Scenario, ocp: Ocp, rng: np.random.Generator) -> Scenario:
        """Returns a scenario with a contact that is drawn.

        Args:
            scenario: With its place and start.
            ocp: Its problem at t = 0.
            rng: Source of the draws.
        """

    @abstractmethod
    def judged(self, record: Record) -> dict[str, Any]:
        """Returns what is told of a run beside, or in place of, what is told of all."""


class KnownContactKind(ContactKind):
    """A surface that the controller knows: one of the certified, drawn with its desired force."""

    def turned(self, scenario: Scenario, R: np.ndarray) -> Scenario:
        """Returns the scenario as it is: the surface is what is told."""
        return scenario

    def drawn(self, scenario: Scenario, ocp: Ocp, rng: np.random.Generator) -> Scenario:
        """Returns the scenario as it is."""
        return scenario

    def judged(self, record: Record) -> dict[str, Any]:
        """Returns nothing."""
        return {}


class SensedContactKind(ContactKind):
    """A wall of the class that the controller is told of, and any force that may be asked for.

    It stands no farther away than lets it be reached and pressed in time; a very soft one, or one
    along which the tip has far to slide, may take longer all the same. A run is as long as its wall
    should need, and no longer than the scenario.
    """

    def turned(self, scenario: Scenario, R: np.ndarray) -> Scenario:
        """Returns the scenario with n turned."""
        contact = sensed_contact(scenario)
        return replace(scenario, contact=replace(contact, direction=R @ contact.direction))

    def drawn(self, scenario: Scenario, ocp: Ocp, rng: np.random.Generator) -> Scenario:
        """Returns the scenario with a wall and a desired force.

        Raises:
            RunFailed: No draw is in the class.
        """
        assert isinstance(ocp, TrackingOcp)  # That is the problem where the contact is felt.
        contact = sensed_contact(scenario)
        force = float(rng.uniform(*np.minimum(FORCES, largest_force(scenario))))
        steepest = steepest_friction(scenario, ocp)
        scenario = replace(scenario, task=replace(scenario.task, force=contact.wrench(force)))
        start, goal = tips(scenario, ocp)
        for _ in range(ATTEMPTS):
            far = float(rng.uniform())
            wall = draw_wall(contact, start, goal, rng)
            if wall is None:
                continue
            speed, pressing = pace(scenario, ocp, wall, force)
            rest = scenario.mpc.hover + pressing + SETTLING
            most = min(FARTHEST, speed * (scenario.duration - rest))
            nearest = contact.clearance + SPARE
            gap = nearest + far * max(most - nearest, 0.0)
            wall = wall.moved(np.eye(3), gap * contact.direction)
            if wall.geometry.depth(start) > -contact.clearance:
                continue
            samples = int(np.ceil((gap / speed + rest) / ocp.time_step))
            drawn = replace(scenario, surface=wall, surface_error=SurfaceError(),
                            duration=min(samples * ocp.time_step, scenario.duration))
            at_unit_creep = friction_rate(drawn, ocp.model, ocp.model.configuration(ocp.y_des))
            creep = max(LEAST_CREEP, at_unit_creep / steepest)
            return replace(drawn, surface=replace(wall, creep=creep))
        raise RunFailed(f"none of {ATTEMPTS} drawn walls is in the class")

    def judged(self, record: Record) -> dict[str, Any]:
        """Returns how the wall was pressed, as `wall`, and the force along n in place of 𝔉.

        The wall's tilt and its friction push across n, where no force is asked for.
        """
        wall = pressed(record)
        return {"wall": wall, "force_error": wall["final_error"],
                "settling_time_s": wall["settling_time_s"]}


CONTACTS: dict[bool, ContactKind] = {False: KnownContactKind(), True: SensedContactKind()}


def contact_of(scenario: Scenario) -> ContactKind:
    """Returns the kind of contact of a scenario."""
    return CONTACTS[scenario.contact.felt]


def tips(scenario: Scenario, ocp: Ocp) -> tuple[np.ndarray, np.ndarray]:
    """Returns where the tip starts, and where it is to press but for the depth (3,) [m]."""
    return ocp.model.task_pose(scenario.start.config)[:3], ocp.y_des[:3]


def pace(scenario: Scenario, ocp: TrackingOcp, wall: ShapedSurface, force: float
         ) -> tuple[float, float]:
    """Returns the speed v at which a wall is approached [m/s], and the time to press [s].

    A tip follows what moves T late, so what is always s ahead of it is followed at s/T, as far as
    the limit of the speed lets. (What is committed comes to T.) In free water s is the way to the
    front, s₀, and a light press is slower, see `control.contact.press_target`. In a wall of slope
    κ it is
    the lesser of two: to the front, s₀ − F/κ', and to the target, (F_des − F)/κ̂ with κ̂ ≤ 2κ. With
    Ḟ = κ s/T, F is within ε of F_des after T times the larger of

        κ'/κ ln(s₀/(s₀ − F_des/κ'))    and    2 ln(F_des/ε),    κ' = a₋κ₊ (`SurfaceClass.share`),

    to which the time comes that the way F_des/κ takes at the largest speed. Both are estimates,
    taken to be slower than they come out.
    """
    committed = committed_intervals(
        scenario.ancillary, actuation_delay_of(scenario, ocp.model), ocp.time_step)
    contact, late = sensed_contact(scenario), ocp.following_lag(committed)
    room = float(ocp.direction @ (ocp.aim.target - tips(scenario, ocp)[0])) - AHEAD
    fastest = contact.speed - (scenario.tube.depth_speed or 0.0)
    speed = min(room / late, fastest, search_speed(force, contact.stiffness, touch_to_plan(
        ocp.time_step, committed, sensing_of(scenario))))
    slope, stiffest = wall.law.slopes[0], contact.walls.share * contact.stiffness
    slower = max(
        stiffest / slope * np.log(room / (room - force / stiffest)),
        2.0 * np.log(force / scenario.task.force_tolerance))
    pressing = late * slower + force / (slope * min(room / late, fastest))
    return PART * speed, float(pressing) / PART


def steepest_friction(scenario: Scenario, ocp: Ocp) -> float:
    """Returns the largest rate of a drawn wall's friction [1/s], see `check_step`.

    It is that of the scenario's own wall: then the step is short enough, and friction changes no
    faster than there. If that has none, it is what the step is short enough for.
    """
    own = friction_rate(scenario, ocp.model, ocp.model.configuration(ocp.y_des))
    return min(own or np.inf, largest_rate(scenario))
