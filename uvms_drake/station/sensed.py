"""Dynamic motion against a wall that nobody measured: the contact is felt."""

from dataclasses import replace
from itertools import product

import numpy as np
from pydrake.systems.framework import Diagram

from uvms_drake.common.errors import InvalidParameter, require, within
from uvms_drake.control.contact.felt import ForceSensing
from uvms_drake.control.dynamic_ocp import DynamicOcp
from uvms_drake.control.limits import Limit, resolved_radii
from uvms_drake.control.limits.contact import ForceCone, UnderContact
from uvms_drake.control.limits.inputs import InputLimit
from uvms_drake.control.ocp import MpcConfig
from uvms_drake.control.sensed_tube_mpc import make_sensed_tube_mpc
from uvms_drake.control.tracking_ocp import TrackingOcp
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.surface import SensedContact
from uvms_drake.station.dynamic import Dynamic, command_limits
from uvms_drake.station.problem import posed_task
from uvms_drake.station.scenario import Scenario
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.law_tube import Basis, LawTube
from uvms_drake.tube.sensed import contact_input_rest, sensor_share

SPEED_LIMIT = "tip_velocity"
"""Name of the limit that says how fast the tip may be."""


class Sensed(Dynamic):
    """Forces move the robot under water, to a wall that it feels and does not know."""

    knows_force = False
    controller_signals = (*Dynamic.controller_signals, "target", "safe_depth", "touched", "slope",
                          "contact_depth")

    def make_ocp(self, scenario: Scenario, model: ContactModel) -> TrackingOcp:
        """Returns the problem for every target, with inputs for all contact forces."""
        contact = sensed_contact(scenario)
        y_des, limits = posed_task(scenario, model, accelerations=True)
        speed = float(np.linalg.norm(limits_of_tip(scenario).bounds()[1]))
        cone = ForceCone.of_surface(
            contact.walls, contact.peak(contact.force, speed) + contact.force_error)
        limits = {name: UnderContact(limit, cone) if isinstance(limit, InputLimit) else limit
                  for name, limit in limits.items()}
        with within("mpc"):
            return TrackingOcp(model, scenario.mpc, y_des, limits, contact.direction)

    def make_controller(self, scenario: Scenario, model: ContactModel, ocp: DynamicOcp) -> Diagram:
        """Returns the tube-based NMPC that presses where it feels."""
        assert isinstance(ocp, TrackingOcp)
        contact, margin = sensed_contact(scenario), front_margin(scenario)
        reach = plan_reach(scenario, ocp)
        force, largest = pressing_force(scenario), largest_force(contact, margin, reach)
        require(force < largest, "task.force", scenario.task.force, f"less than {largest:.3g} N: "
                "contact.force less what sensor, tube, angle and stiffness take of it")
        with within("ancillary"):
            return make_sensed_tube_mpc(
                ocp, scenario.ancillary, contact.walls, sensing_of(contact),
                force=force, largest=largest, margin=margin,
                reach=reach, speed=float(np.linalg.norm(
                    ocp.lasting_limits[SPEED_LIMIT].upper)),
                limits=command_limits(scenario))


    def in_contact(self, tube: LawTube, scenario: Scenario, basis: Basis) -> LawTube:
        """Returns the tube with what the contact's part of the input may differ, and a condition.

        The sensor's errors are part of d: they have to fit into the share of its bound that is left
        to what the controller does not know. Both numbers are estimates, with the safety factor.
        """
        contact, radii, settings = sensed_contact(scenario), tube.radii, basis.settings
        box = basis.declared.q_lower, basis.declared.q_upper
        share = sensor_share(basis.model, *box, scenario.disturbance.axes(basis.model.size),
                             contact.force_error, contact.torque_error, settings.seed)
        fastest = float(np.linalg.norm(limits_of_tip(scenario).bounds()[1]))
        largest = np.hypot(1.0, contact.friction) * (
            contact.peak(contact.force, fastest) + contact.force_error)
        rest = contact_input_rest(basis.model, *box, largest, radii.joints or radii.e,
                                  radii.orientation or radii.e, settings.seed)
        return LawTube(replace(radii, u=radii.u + settings.safety_factor * rest), (
            *tube.conditions,
            Condition("contact, what the sensor's errors take of d̃", settings.safety_factor * share,
                      "<=", scenario.model_error.share)))

    def goal(self, scenario: Scenario, model: ContactModel, logs: dict[str, np.ndarray]
             ) -> np.ndarray:
        """Returns the last target, in the attitude of the task."""
        pose = super().goal(scenario, model, logs)
        return np.concatenate([logs["target"][-1], pose[3:]])

    def given_up(self, mpc: MpcConfig) -> list[tuple[str, float]]:
        """Returns the assumptions about the MPC, and what the proofs of a felt contact lack yet."""
        return [*super().given_up(mpc),
                ("contact, felt: friction may change as fast as it likes", 1.0)]


def sensed_contact(scenario: Scenario) -> SensedContact:
    """Returns what the controller is told of the wall."""
    assert isinstance(scenario.contact, SensedContact)  # Else there is another motion.
    with within("contact"):
        return scenario.contact.checked()


def limits_of_tip(scenario: Scenario) -> Limit:
    """Returns the limit that says how fast the tip may be."""
    for limit in scenario.limits.more:
        if limit.name == SPEED_LIMIT:
            return limit
    raise InvalidParameter("limits.more", [], "with a !TipVelocity: the force of a wall that "
                           "nobody measured changes as fast as the tip moves")


def sensing_of(contact: SensedContact) -> ForceSensing:
    """Returns what is known of the sensor."""
    return ForceSensing(force_max=contact.force, noise=contact.force_error, period=contact.period)


def front_margin(scenario: Scenario) -> float:
    """Returns E = E_n + tan α E_t [m], how far the real tip may be beyond the planned one."""
    position = resolved_radii(scenario.tube).position or 0.0
    return position * float(np.hypot(1.0, np.tan(sensed_contact(scenario).angle)))


def plan_reach(scenario: Scenario, ocp: TrackingOcp) -> float:
    """Returns ℓ [m], how far from the tip across n a plan can go: no faster than its limit, for T.

    The plan may be a sampling period old, and the tip as far from it as the tube says.
    """
    n, position = ocp.direction, resolved_radii(scenario.tube).position or 0.0
    corners = ocp.lasting_limits[SPEED_LIMIT].upper * np.array(list(product((-1.0, 1.0), repeat=3)))
    fastest = float(np.max(np.linalg.norm(corners - np.outer(corners @ n, n), axis=1)))
    return fastest * (ocp.horizon + 1) * ocp.time_step + position


def pressing_force(scenario: Scenario) -> float:
    """Returns the desired force along n [N]."""
    return float(np.asarray(scenario.task.force)[:3] @ sensed_contact(scenario).direction)


def largest_force(contact: SensedContact, margin: float, reach: float) -> float:
    """Returns the largest force that may be asked for [N].

    The front lets the planned tip press on at F as long as (F_max − F − 2ν)/κ₊ is more than 2E, see
    `control.contact.target`, and 2αℓ, which `safe_depth` takes off for what is across n.
    """
    lost = 2.0 * (margin + float(np.tan(contact.angle)) * reach)
    return contact.force - 2.0 * contact.force_error - contact.stiffness * lost
