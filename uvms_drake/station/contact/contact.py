"""The interface of a kind of contact between end-effector and surface, with its defaults."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from uvms_drake.common.errors import require, within
from uvms_drake.control.limits import Limit, Limits, TubeRadii
from uvms_drake.control.mpc.planner import Targets
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.ocp.solvers import make_solver
from uvms_drake.control.tube_mpc import make_tube_mpc
from uvms_drake.mission.steps import Mission
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.sensor_actuator import MEASURED_FORCE, Part, Signals
from uvms_drake.model.surface.law import Surface
from uvms_drake.model.surface.unknown_contact import UnknownContact
from uvms_drake.sensing.measurements import HoldLastValue
from uvms_drake.station.command_path import command_limits, command_path_of
from uvms_drake.station.contact.mission_legs import Leg
from uvms_drake.station.problem import make_dynamic_ocp, retargeted_ocp
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds
from uvms_drake.tube.law_tube import Basis, LawTube

if TYPE_CHECKING:
    from uvms_drake.station.scenario.scenario import Scenario

OPERATOR = "operator"
"""Guarantor of the declared surface."""
Statement = tuple[str, str, str]
"""Subject, statement and guarantor of an assumption."""


class Contact(ABC):
    """Kind of contact: a dataclass, whose fields are its settings in a scenario's file.

    It has the surface of the nominal model, the optimal control problem, the controller, the
    conditions and assumptions of a certificate, and the checks. By default the controller's model
    has the force of its surface, and a further desired force has a problem of its own; then a kind
    has to have its surface only.
    """

    bounded_along_run: ClassVar[bool] = True
    """Whether the law's bound along a run holds, which covers d alone."""
    draws_surface: ClassVar[bool] = False
    """Whether `drawn` chooses surface and desired force, all of which one certificate covers."""
    depends_on_duration: ClassVar[bool] = False
    """Whether a certificate depends on the duration of the run, as by the drift of a sensor."""

    @abstractmethod
    def controller_surface(self, surface: Surface) -> Surface:
        """Returns the surface of the nominal model, for the scenario's surface."""

    def shown_surface(self, nominal: Surface, true: Surface) -> Surface:
        """Returns the surface for drawing and for task errors, of the nominal and the true one."""
        return nominal

    def check_in(self, scenario: "Scenario") -> None:
        """Raises `InvalidParameter` for the first value that has no meaning with this contact."""
        require(not scenario.mission.steps, "mission.steps", scenario.mission.steps,
                "left out, without a sensed contact")

    def limits(self) -> list[Limit]:
        """Returns the limits that the contact adds to those of the scenario."""
        return []

    def force_limit(self, limits: Limits) -> float | None:
        """Returns the largest static force of the plans and their tube [N]; None: not limited."""
        return limits.static_force

    def takes_static_force(self, surface: Surface) -> bool:
        """Returns whether `limits.static_force` can limit the force on the scenario's surface."""
        return type(surface).static_force_rows is not Surface.static_force_rows

    # The controller.

    def make_ocp(self, scenario: "Scenario", model: ContactModel) -> Ocp:
        """Returns the nominal MPC's problem; see `problem.make_ocp`."""
        return make_dynamic_ocp(scenario, model)

    def make_controller(self, scenario: "Scenario", model: ContactModel, ocp: Ocp
                        ) -> Diagram:
        """Returns the tube-based NMPC that solves a problem of `make_ocp`; see `command_limits`."""
        targets = Targets(np.asarray(scenario.task.force, dtype=float),
                          partial(retargeted_ocp, scenario, model))
        command_path = command_path_of(scenario.actuation, model)
        with within("mpc"):
            solver = make_solver(ocp)
        with within("ancillary"):
            return make_tube_mpc(ocp, scenario.ancillary, targets, command_limits(scenario),
                                 command_path, solver)

    def measured_force(self, builder: DiagramBuilder, scenario: "Scenario", model: ContactModel,
                       state: OutputPort, valid: OutputPort, signals: Signals
                       ) -> dict[str, OutputPort]:
        """Adds the systems of a measured force before a controller; by default a `HoldLastValue`.

        Args:
            builder: Builder to add to.
            scenario: The scenario.
            model: The controller's model.
            state: Output port of the measured (𝔮, ζ).
            valid: Output port of 𝔉_s (6), which may not be finite.
            signals: Signals of the loop, to which those of the measurement are added.

        Returns:
            Ports by the names of the controller's inputs.
        """
        force = HoldLastValue.AddToBuilder(
            builder, measured=valid, release=signals.get("force_lost")).get_output_port()
        signals["force_last_valid"] = force
        return {MEASURED_FORCE: force}

    def first_problem(self, scenario: "Scenario", model: ContactModel, ocp: Ocp, start: np.ndarray
                      ) -> Ocp:
        """Returns the problem at t = 0 from (𝔮, ζ) (2(6+n),): `ocp` itself, if it is constant."""
        return ocp

    # A run.

    def goal(self, scenario: "Scenario", model: ContactModel, logs: Mapping[str, np.ndarray]
             ) -> np.ndarray:
        """Returns the pose χ_des (6,) that the end-effector was to have at the end."""
        return model.surface.pose_for(logs["desired_force"][-1], scenario.task.pose)

    def force_direction(self, force: np.ndarray) -> np.ndarray:
        """Returns the direction (3,) in which a desired force (3,) is controlled."""
        return force

    def force_in_law(self, logs: Mapping[str, np.ndarray]) -> np.ndarray | None:
        """Returns the force 𝔉 (T, 6) that the law should take in place of the model's, if any."""
        return logs.get("force_last_valid")

    def declared_wall(self) -> UnknownContact | None:
        """Returns the declared bounds that a report checks; None: the surface is known."""
        return None


    # A campaign.

    def turned(self, R: np.ndarray) -> Self:
        """Returns the contact turned by R (3, 3); by default it has no direction."""
        return self

    def drawn(self, scenario: "Scenario", ocp: Ocp, rng: np.random.Generator) -> "Scenario":
        """Returns a scenario with a surface that is drawn; by default with the declared one.

        Args:
            scenario: Scenario with its place and start.
            ocp: Optimal control problem at t = 0.
            rng: Random generator.
        """
        return scenario

    def about_drawn(self, scenario: "Scenario") -> Iterator[str]:
        """Yields the sentences on the distribution of `drawn`; by default nothing is drawn."""
        yield from ()


    # The certificate.

    def force_bounds(self, scenario: "Scenario") -> MeasuredForceBounds | None:
        """Returns the bounds of a force that is measured, not modelled; None: it is modelled."""
        return None

    def in_contact(self, tube: LawTube, scenario: "Scenario", basis: Basis) -> LawTube:
        """Returns the tube of a law with the unmodelled effects of contact: none by default."""
        return tube

    def legs(self, mission: Mission, tube: TubeRadii, conditions: Sequence[Condition]
             ) -> list[Leg]:
        """Returns the certified bounds of each step of a mission; see `mission_legs`."""
        return []


    def assumed_settings(self) -> list[tuple[str, str, float]]:
        """Returns key, reason and size of the proofs' assumptions about its settings; 0 if kept."""
        return []

    def bounds_error_of(self, part: Part) -> bool:
        """Returns whether its tube has the errors of a part of sensing."""
        return False

    def about_sensing(self, scenario: "Scenario") -> Iterator[Statement]:
        """Yields the assumptions about a measured force."""
        yield from ()

    def about_surface(self, scenario: "Scenario") -> Iterator[Statement]:
        """Yields the assumptions about the surface."""
        yield ("surface", f"the declared !{type(scenario.surface).__name__}, exactly: its place, "
               "normal and stiffness, without friction that it does not declare", OPERATOR)
