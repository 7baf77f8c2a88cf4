"""Contact with an unknown wall: its force is measured, its place and stiffness are estimated."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from uvms_drake.common.errors import require, within
from uvms_drake.control.contact.contact_state import initial_contact_state, updated_contact_state
from uvms_drake.control.contact.press_control import PressControl
from uvms_drake.control.contact.press_target import SEARCH_DEPTH
from uvms_drake.control.contact.safe_region import bounds, safe_depth
from uvms_drake.control.contact.tangential_filter import TangentialFilter
from uvms_drake.control.limits import Limit, Limits, TubeRadii, resolved_radii
from uvms_drake.control.limits.input_in_contact import ForceCone, UnderContact
from uvms_drake.control.limits.inputs import InputLimit
from uvms_drake.control.limits.pose import ToolAngle
from uvms_drake.control.limits.speeds import ContactSpeed
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.solvers import make_solver
from uvms_drake.control.ocp.tracking_ocp import TrackingOcp, TrackingTarget
from uvms_drake.control.plan.plan import off_parabola, stopping_distance
from uvms_drake.control.tube_mpc import make_tube_mpc
from uvms_drake.mission.steps import Mission
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.sensor_actuator import MEASURED_FORCE, Part, Signals
from uvms_drake.model.surface.law import Surface, check_surface
from uvms_drake.model.surface.unknown_contact import UnknownContact, UnknownSurface
from uvms_drake.sensing.force_fault_detector import (
    CHANCE,
    ForceFaultDetector,
    chance_of_run,
    run_of_frozen,
)
from uvms_drake.station.command_path import command_limits, command_path_of
from uvms_drake.station.contact.bounds import (
    BETWEEN_KNOTS,
    SAFE_REGION,
    between_knots,
    fastest_advance,
    known_reading,
    largest_force,
    largest_normal_force,
    largest_reading_error,
    mission_conditions,
    pressing_force,
    reading_of,
    safe_depth_margin,
    sensed_contact,
    sensing_of,
    slower,
)
from uvms_drake.station.contact.contact import OPERATOR, Contact, Statement
from uvms_drake.station.contact.drawn_contact import about_drawn, drawn_contact, drawn_forces
from uvms_drake.station.contact.hold import hold_radii
from uvms_drake.station.contact.measurement_path import SENSOR_MAKER, measurement_path
from uvms_drake.station.contact.mission_legs import Leg, legs_of
from uvms_drake.station.problem import posed_task
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds, contact_input_remainder
from uvms_drake.tube.contact.tip_motion import JERK, second_jerk, tip_jerk, unevenness
from uvms_drake.tube.estimates import Estimate, largest_of, together
from uvms_drake.tube.law_tube import Basis, LawTube

if TYPE_CHECKING:
    from uvms_drake.station.scenario.scenario import Scenario

SAFETY_OF_JERK = 1.1
"""Factor of the largest jerk of the tip that was found; see `tip_jerk`."""
SLOPES = 0.0, 15.0
"""Slopes of friction by the tip's speed over the force, of the linear walls [s/m]: of a tip that
sticks, and of one that slips at half of a creep velocity of 25 mm/s with μ = 0.2."""


def _multiple(longer: float, period: float) -> bool:
    """Returns whether a time is a whole number of periods, but for rounding."""
    return round(longer / period) >= 1 and bool(
        np.isclose(longer / period, round(longer / period), rtol=0.0, atol=1e-6))


CERTIFIER = "the person who certifies"


@dataclass
class SensedContact(UnknownContact, Contact):
    """Contact with a measured force; place and stiffness of the wall are unknown."""

    bounded_along_run: ClassVar[bool] = False
    draws_surface: ClassVar[bool] = True
    depends_on_duration: ClassVar[bool] = True

    def controller_surface(self, surface: Surface) -> UnknownSurface:
        """Returns free water, for any true surface."""
        return UnknownSurface(self)

    def shown_surface(self, nominal: Surface, true: Surface) -> Surface:
        """Returns the true surface: the nominal model has none."""
        return check_surface(true)

    def check_in(self, scenario: "Scenario") -> None:
        """Returns None: every scenario has a meaning."""

    def limits(self) -> list[Limit]:
        """Returns the limits of the tip's velocity and of the tool's angle."""
        with within("contact"):
            contact = self.checked()
        return [ContactSpeed(contact.walls.axes, contact.speed, contact.speed_across),
                ToolAngle(contact.direction, contact.tool_angle)]

    def force_limit(self, limits: Limits) -> float:
        """Returns the declared largest static force [N]."""
        return self.force

    def takes_static_force(self, surface: Surface) -> bool:
        """Returns that `limits.static_force` is left out: `force` limits it."""
        return False

    def make_ocp(self, scenario: "Scenario", model: ContactModel) -> TrackingOcp:
        """Returns the problem for every target, with inputs for all contact forces."""
        contact, force = sensed_contact(scenario), scenario.limits.static_force
        require(force is None, "limits.static_force", force,
                "left out (null) with a sensed contact, whose force contact.force limits")
        y_des, limits = posed_task(scenario, model)
        cone = ForceCone.of_surface(contact.walls, largest_normal_force(contact))
        limits = {name: UnderContact(limit, cone) if isinstance(limit, InputLimit) else limit
                  for name, limit in limits.items()}
        with within("mpc"):
            return TrackingOcp(model, scenario.mpc, y_des, limits, contact.direction,
                               contact.walls.facets)

    def make_controller(self, scenario: "Scenario", model: ContactModel, ocp: Ocp
                        ) -> Diagram:
        """Returns the tube-based NMPC that presses by the measured force."""
        assert isinstance(ocp, TrackingOcp)
        contact, margin = sensed_contact(scenario), safe_depth_margin(scenario)
        force, largest = pressing_force(scenario), largest_force(scenario)
        require(force < largest, "task.force", scenario.task.force, f"less than {largest:.3g} N: "
                "contact.force less the parts of sensor, tube, angle and stiffness")
        reading = known_reading(scenario)
        require(reading is None or largest + contact.force_error < reading.largest,
                "sensing", scenario.sensing,
                f"with a range of more than {largest + contact.force_error:.3g} N")
        for i, step in enumerate(scenario.mission.steps):
            require(step.strongest < largest, f"mission.steps[{i}].force", step.strongest,
                    f"less than {largest:.3g} N, like task.force")
        command_path = command_path_of(scenario.actuation, model)
        with within("mpc"):
            solver = make_solver(ocp)
        with within("ancillary"):
            return make_tube_mpc(
                ocp, scenario.ancillary, limits=command_limits(scenario),
                command_path=command_path, solver=solver, press=PressControl(
                    contact.walls, sensing_of(scenario), force, largest, margin))

    def measured_force(self, builder: DiagramBuilder, scenario: "Scenario", model: ContactModel,
                       state: OutputPort, valid: OutputPort, signals: Signals
                       ) -> dict[str, OutputPort]:
        """Adds the systems of the measured force before the controller, see `Contact`.

        ::

            valid ─▶ ForceFaultDetector ─▶ HoldLastValue ─▶ TangentialFilter ─▶ law
                             └─ force_valid ─▶ contact estimator

        The filter is only there with a `tangential_lag`. A controller without a contact estimator
        has the last valid value alone.
        """
        if "force_lost" not in signals:
            return super().measured_force(builder, scenario, model, state, valid, signals)
        contact, reading = sensed_contact(scenario), reading_of(scenario)
        detector = ForceFaultDetector.AddToBuilder(
            builder, model, contact.period, repeats=sensing_of(scenario).repeats,
            tare=reading.tare, largest=reading.largest, state=state, force_measured=valid)
        valid = detector.GetOutputPort("force_valid")
        signals["force_status"] = detector.GetOutputPort("force_status")
        given = super().measured_force(builder, scenario, model, state, valid, signals)
        if contact.tangential_lag > 0.0:
            given[MEASURED_FORCE] = signals["force_filtered"] = TangentialFilter.AddToBuilder(
                builder, contact.direction, contact.tangential_lag, contact.period,
                measured=given[MEASURED_FORCE]).get_output_port()
        return {"force_valid": valid, **given}

    def force_bounds(self, scenario: "Scenario") -> MeasuredForceBounds:
        """Returns the bounds of the force of all walls of the class, and of its measurement."""
        contact, reading = sensed_contact(scenario), reading_of(scenario)
        speed = fastest_advance(contact)
        return MeasuredForceBounds(
            size=float(np.hypot(1.0, contact.friction)) * contact.peak(contact.force, speed),
            rate=contact.stiffness * speed, ripple=contact.force * contact.dissipation * speed,
            tangential_rate=contact.force_rate, tangential_ripple=contact.force_ripple,
            reading=reading, tool_angle=contact.tool_angle)

    def in_contact(self, tube: LawTube, scenario: "Scenario", basis: Basis) -> LawTube:
        """Returns the tube with the contact's input error, and the contact's conditions.

        These are that readings have no more than the declared error (for one, the tip turns while
        the sensor averages), that no wall is near during the tare, that the tip is not much faster
        between the knots of a plan, and that the safe region admits the desired force.
        """
        if not np.size(tube.radii.u):
            return tube
        # Remainder of the contact's part of the input, with a second search for its check.
        contact, settings, declared = sensed_contact(scenario), basis.settings, basis.declared
        radii, measured = resolved_radii(tube.radii), self.force_bounds(scenario)
        assert radii.joints is not None and radii.orientation is not None  # they are filled in
        largest = np.hypot(1.0, contact.friction) * largest_normal_force(contact)
        worst, second = contact_input_remainder(
            basis.model, declared.q_lower, declared.q_upper, largest, radii.joints,
            radii.orientation, settings.seed)
        # Jerk of the tip, by which a plan leaves its limits between knots.
        tangential = np.sqrt(2.0) * contact.walls.tilt  # A facet's part across n.
        planned, cone = slower(declared, radii), contact.tool_angle + np.arctan(tangential)
        tip = SAFETY_OF_JERK * tip_jerk(basis.model, planned, scenario.mpc.time_step, cone,
                                        10 * settings.constant_samples, settings.seed)
        jerk = np.hypot(1.0, tangential) * tip
        # The tube that plans are tightened by: both added to the radii.
        remainder = settings.safety_factor * worst
        u_remainder, tau_remainder = np.split(remainder, 2)
        tau = tube.radii.tau
        radii = replace(tube.radii, u=tube.radii.u + u_remainder,
                        tau=None if tau is None else tau + tau_remainder,
                        between_knots=off_parabola(jerk, scenario.mpc.time_step),
                        **between_knots(planned, scenario.mpc.time_step))
        # Conditions of the safe region, with this tube.
        with_tube = replace(scenario, tube=radii)
        margin = safe_depth_margin(with_tube)
        reading, faster = reading_of(scenario), 0.125 * scenario.mpc.time_step**2 * jerk
        off = largest_reading_error(scenario, measured, self._unevenness(
            scenario, tube, measured, jerk))
        share = max(contact.walls.share, np.finfo(float).tiny)
        free = stopping_distance(
            contact.force, contact.force_error / share, contact.stiffness, margin,
            retreat=contact.dissipation * fastest_advance(contact))
        # Smaller radii once a plan stands.
        decay = []
        if tube.hold is not None:
            hold, condition = hold_radii(scenario, tube.hold, measured)
            likely_hold, _ = hold_radii(scenario, tube.hold, measured, likely=True)
            radii, decay = replace(radii, hold=hold, likely_hold=likely_hold), [condition]
        return LawTube(radii, (
            *tube.conditions, *decay,
            Condition("contact.force_error, not less than the sensor's error",
                      contact.force_error, ">=", off,
                      f"--set contact.force_error={np.ceil(10.0 * off) / 10.0:.3g}"
                      if np.isfinite(off) else "", theorem=SAFE_REGION,
                      topic="contact.force_error"),
            Condition("sensing, largest force within the range [N]", reading.largest, ">",
                      measured.size + measured.error, theorem=SAFE_REGION),
            Condition("sensing, probability that a working sensor is taken for frozen, a reading",
                      chance_of_run(reading.repeated, run_of_frozen(reading.repeated))
                      if sensing_of(scenario).repeats else 0.0, "<=", CHANCE,
                      theorem="sensing/theory.md#detection-of-a-frozen-force"),
            Condition("contact.clearance, not less than the path of the tip in the tare [m]",
                      contact.clearance, ">=",
                      fastest_advance(contact) * reading.tare, theorem=SAFE_REGION,
                      topic="contact.clearance"),
            Condition("contact.speed, excess between two knots [m/s]", faster, "<=",
                      BETWEEN_KNOTS * min(contact.speed, contact.speed_across),
                      theorem="control/theory.md#motion-between-two-knots", topic="contact.speed"),
            Condition("safe region, margin from a reading without touch [m]", free, ">", 0.0,
                      theorem=SAFE_REGION, topic="safe region"),
            Condition("task.force, largest force in the safe region [N]",
                      pressing_force(scenario), "<", largest_force(with_tube), theorem=SAFE_REGION,
                      topic="task.force"),
            *mission_conditions(with_tube)), tube.budget, tube.estimated,
            together(tube.check, lambda: (
                largest_of("remainder of u in contact", remainder, second),
                Estimate(JERK, tip, second_jerk(
                    basis.model, planned, scenario.mpc.time_step, cone, settings.seed)))),
            tube.hold, tube.along)

    @staticmethod
    def _unevenness(scenario: "Scenario", tube: LawTube, force: MeasuredForceBounds, jerk: float
                    ) -> float:
        """Returns the largest variation of the tip's acceleration between two readings [m/s²].

        A knot of a plan is between two readings unless its step is a multiple of their period, and
        so is a reading of the sensor. The velocity of a plan is within its limit at its knots.
        """
        contact, step = sensed_contact(scenario), scenario.mpc.time_step
        if tube.along is None:
            return np.inf
        planned = jerk * contact.period
        if not _multiple(step, contact.period):
            planned += 2.0 * (2.0 * contact.speed / step + 0.5 * jerk * step)
        return unevenness(tube.along, force, contact.period, planned,
                          read_between=not _multiple(force.period, contact.period))

    def first_problem(self, scenario: "Scenario", model: ContactModel, ocp: Ocp, start: np.ndarray
                      ) -> Ocp:
        """Returns the problem at t = 0: no contact at the start, and the target further along n."""
        assert isinstance(ocp, TrackingOcp)
        contact, n = sensed_contact(scenario), ocp.direction
        before, sensing = initial_contact_state(sensing_of(scenario)), sensing_of(scenario)
        tip = np.append(model.task_pose(start[: model.size])[:3], np.zeros(3))
        known = updated_contact_state(
            contact.walls, sensing, np.zeros((2, 2)), before, tip, np.zeros(3))
        margin = safe_depth_margin(scenario)
        depth = float(safe_depth(contact.walls, known.apex, tip[:3], margin))
        across = ocp.y_des[:3] - (n @ ocp.y_des[:3]) * n
        return ocp.aimed(TrackingTarget(across + (depth + SEARCH_DEPTH) * n,
                                        bounds(contact.walls, known.apex, margin)))

    def goal(self, scenario: "Scenario", model: ContactModel, logs: Mapping[str, np.ndarray]
             ) -> np.ndarray:
        """Returns the last target, in the attitude of the task."""
        pose = super().goal(scenario, model, logs)
        return np.concatenate([logs["target"][-1], pose[3:]])

    def force_direction(self, force: np.ndarray) -> np.ndarray:
        """Returns the direction n into the wall (3,)."""
        return np.asarray(self.direction, dtype=float)

    def force_in_law(self, logs: Mapping[str, np.ndarray]) -> np.ndarray:
        """Returns the true force (T, 6): the errors of its measurement count as a disturbance."""
        return logs["force"]

    def declared_wall(self) -> Self:
        """Returns the declared bounds of wall, forces and readings, checked."""
        with within("contact"):
            return self.checked()


    def turned(self, R: np.ndarray) -> Self:
        """Returns the contact with n turned by R (3, 3)."""
        with within("contact"):
            contact = self.checked()
        return replace(contact, direction=R @ contact.direction)

    def drawn(self, scenario: "Scenario", ocp: Ocp, rng: np.random.Generator) -> "Scenario":
        """Returns the scenario with a wall and a desired force of its class."""
        return drawn_contact(scenario, ocp, rng)

    def about_drawn(self, scenario: "Scenario") -> Iterator[str]:
        """Yields the sentences on the desired force and the wall."""
        return about_drawn(
            sensed_contact(scenario), scenario.mission, drawn_forces(scenario))


    def legs(self, mission: Mission, tube: TubeRadii, conditions: Sequence[Condition]
             ) -> list[Leg]:
        """Returns the certified bounds of each step of a mission."""
        with within("contact"):
            return legs_of(mission.checked(), self.checked(), tube, conditions)


    def assumed_settings(self) -> list[tuple[str, str, float]]:
        """Returns key, reason and size of the proofs' assumptions about its settings; 0 if kept."""
        return [("contact.tangential_lag", "delayed feedback of the friction", self.tangential_lag)]

    def bounds_error_of(self, part: Part) -> bool:
        """Returns whether a part measures the force."""
        return part.reading(0.0, 0.0) is not None

    def about_sensing(self, scenario: "Scenario") -> Iterator[Statement]:
        """Yields the assumptions about the force sensor, and about all between it and the law."""
        yield ("sensing", "noise, bias, drift, lag and range of the force sensor, and mass and "
               "inertia of the tool beyond it, are as declared until "
               f"t = {scenario.duration:g} s", SENSOR_MAKER)
        yield ("sensing", "between two readings of the force the feedback adds nothing to the "
               "variation of the tip's acceleration along n that forces, disturbance and plan make "
               "(tube/contact/theory.md#unevenness-of-the-tips-motion)", CERTIFIER)
        for element in measurement_path(scenario):
            covered = element.theorem or "no theorem covers it"
            yield ("sensing", f"{element.system}, before the law: {element.statement} ({covered})",
                   element.guaranteed_by)

    def about_surface(self, scenario: "Scenario") -> Iterator[Statement]:
        """Yields the class of walls, and the rates of a force that is not the normal one."""
        yield ("surface", f"every wall, {self.clearance:g} m or more off the tip at the start, "
               f"with its normal within {np.rad2deg(self.angle):.3g}° of the direction, "
               f"{self.stiffness:g} N/m at most with the tool, friction {self.friction:g}, "
               f"dissipation {self.dissipation:g} s/m", OPERATOR)
        yield ("surface", "friction and a normal that turns change the force by "
               f"{self.force_rate:g} N/s at most, and by {self.force_ripple:g} N at any rate",
               OPERATOR)
        if (slow := self.hold) is not None:
            yield ("surface", "in a hold they change it by "
                   f"{slow.force_rate:g} N/s and {slow.force_ripple:g} N at most", OPERATOR)
