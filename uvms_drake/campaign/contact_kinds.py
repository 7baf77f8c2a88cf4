"""Draws and metrics of a campaign by the kind of contact: known surface, or sensed contact."""

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any

import numpy as np

from uvms_drake.campaign.contact_metrics import press_metrics
from uvms_drake.campaign.drawn_surfaces import draw_wall
from uvms_drake.common.errors import RunFailed
from uvms_drake.control.contact.press_target import SEARCH_DEPTH, search_speed, touch_to_plan
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.tracking_ocp import TrackingOcp
from uvms_drake.control.plan.commitment import committed_intervals
from uvms_drake.model.surface import ShapedSurface
from uvms_drake.plant.surface_error import SurfaceError
from uvms_drake.station.command_path import actuation_delay_of
from uvms_drake.station.contact.bounds import largest_force, sensed_contact, sensing_of
from uvms_drake.station.record import Record
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


class ContactKind(ABC):
    """Kind of contact of a campaign."""

    @abstractmethod
    def turned(self, scenario: Scenario, R: np.ndarray) -> Scenario:
        """Returns a scenario with the contact specification turned by R (3, 3)."""

    @abstractmethod
    def drawn(self, scenario: Scenario, ocp: Ocp, rng: np.random.Generator) -> Scenario:
        """Returns a scenario with a contact that is drawn.

        Args:
            scenario: Scenario with its place and start.
            ocp: Optimal control problem at t = 0.
            rng: Random generator.
        """

    @abstractmethod
    def metrics(self, record: Record) -> dict[str, Any]:
        """Returns the per-run metrics that add to or replace the default ones."""


class KnownContactKind(ContactKind):
    """A surface that the controller knows: one of the certified, drawn with its desired force."""

    def turned(self, scenario: Scenario, R: np.ndarray) -> Scenario:
        """Returns the scenario unchanged: the surface is the specification."""
        return scenario

    def drawn(self, scenario: Scenario, ocp: Ocp, rng: np.random.Generator) -> Scenario:
        """Returns the scenario unchanged."""
        return scenario

    def metrics(self, record: Record) -> dict[str, Any]:
        """Returns no further metrics."""
        return {}


class SensedContactKind(ContactKind):
    """Unknown surface of the specified class, and any admissible desired force.

    Its distance is limited so that it should be reached and pressed in time; a very soft one, or a
    long slide along it, may take longer all the same. A run lasts as long as its wall should need,
    and no longer than the scenario.
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
        assert isinstance(ocp, TrackingOcp)  # The problem of a sensed contact.
        contact = sensed_contact(scenario)
        force = float(rng.uniform(*np.minimum(FORCES, largest_force(scenario))))
        steepest = steepest_friction(scenario, ocp)
        scenario = replace(scenario, task=replace(scenario.task, force=contact.wrench(force)))
        start, goal = tips(scenario, ocp)
        # A wall of the class, at a distance that leaves time to reach it and to settle.
        for _ in range(ATTEMPTS):
            far = float(rng.uniform())
            wall = draw_wall(contact, start, goal, rng)
            if wall is None:
                continue
            speed, pressing = pace(scenario, ocp, wall, force)
            remaining = scenario.mpc.hover + pressing + SETTLING
            most = min(FARTHEST, speed * (scenario.duration - remaining))
            nearest = contact.clearance + SPARE
            gap = nearest + far * max(most - nearest, 0.0)
            wall = wall.moved(np.eye(3), gap * contact.direction)
            if wall.geometry.depth(start) > -contact.clearance:
                continue
            # A run of whole samples, and friction no steeper than the integration step resolves.
            samples = int(np.ceil((gap / speed + remaining) / ocp.time_step))
            drawn = replace(scenario, surface=wall, surface_error=SurfaceError(),
                            duration=min(samples * ocp.time_step, scenario.duration))
            at_unit_creep = friction_rate(drawn, ocp.model, ocp.model.configuration(ocp.y_des))
            creep = max(LEAST_CREEP, at_unit_creep / steepest)
            return replace(drawn, surface=replace(wall, creep=creep))
        raise RunFailed(f"none of {ATTEMPTS} drawn walls is in the class")

    def metrics(self, record: Record) -> dict[str, Any]:
        """Returns the press metrics as `wall`, and the force error along n in place of that of 𝔉.

        The wall's tilt and its friction exert a force normal to n, where none is desired.
        """
        wall = press_metrics(record)
        return {"wall": wall, "force_error": wall["final_error"],
                "settling_time_s": wall["settling_time_s"]}


CONTACTS: dict[bool, ContactKind] = {True: KnownContactKind(), False: SensedContactKind()}


def contact_of(scenario: Scenario) -> ContactKind:
    """Returns the kind of contact of a scenario."""
    return CONTACTS[scenario.contact.is_modelled]


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
    committed = committed_intervals(
        scenario.ancillary, actuation_delay_of(scenario, ocp.model), ocp.time_step)
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


def steepest_friction(scenario: Scenario, ocp: Ocp) -> float:
    """Returns the largest rate of a drawn wall's friction [1/s], see `with_step`.

    It is that of the scenario's own wall, for which the step is short enough; if that has no
    friction, the largest rate that the step resolves.
    """
    own = friction_rate(scenario, ocp.model, ocp.model.configuration(ocp.y_des))
    return min(own or np.inf, largest_rate(scenario))
