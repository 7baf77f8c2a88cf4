"""Command of a tick: forces, commands of thrusters and joints for them, mode and alarms."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from uvms_drake.actuation import Thrusters
from uvms_drake.control.plan.plan import Plan
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.station.scenario.scenario import Scenario


class Mode(StrEnum):
    """Kind of a command."""

    RUNNING = "running"
    """The law's, about the plan."""
    HOVERING = "hovering"
    """Likewise, and the plan is to keep the place until observers have settled, see `mpc.hover`."""
    REPEATED = "repeated"
    """That of the last tick again: the sample was not used."""
    RETREATING = "retreating"
    """That of the scenario's supervisor: off the wall, then station there, until `reset`."""
    STOPPED = "stopped"
    """That of keeping station at the last place known, until `reset`; see `loop.controller`."""


@dataclass(frozen=True)
class JointCommand:
    """Command of the joints, of which an arm takes one (n,)."""

    torque: np.ndarray
    """τ_q [N m]."""
    velocity: np.ndarray
    """Velocity one period later, by the model under τ_q and the vehicle's wrench [rad/s]."""
    position: np.ndarray
    """Angle then [rad]."""


@dataclass(frozen=True)
class LoopCommand:
    """Command of a tick, to be sent at once."""

    time: float
    """Time of its tick by the clock of the loop [s]."""
    tau: np.ndarray
    """τ (6+n,): wrench on the vehicle in body axes about Bo, torques of the joints [N, N m]."""
    thruster_forces: np.ndarray | None
    """Forces of the thrusters (m,) [N]; None: the robot's folder has no `thrusters.yaml`."""
    thruster_commands: np.ndarray | None
    """Their commands (m,) by the curves of that file, in its unit, such as µs of PWM or rpm."""
    joints: JointCommand
    mode: Mode
    alarms: tuple[str, ...] = ()
    """Alarms for the pilot, one line each; empty if all is well."""
    plan: Plan | None = None
    """The plan, for display."""


class Outputs:
    """Commands of the thrusters and joints of a robot for τ.

    Args:
        scenario: Scenario with its actuators.
        model: The controller's model.
        period: T, until the next tick [s].
    """

    def __init__(self, scenario: Scenario, model: ContactModel, period: float):
        self._model, self._period = model, period
        known = next((part.known(model) for part in scenario.actuation
                      if isinstance(part, Thrusters)), None)
        if known is None and model.thrusters is not None:
            known = ThrusterModel.of(model.thrusters)
        self._allocation = None if known is None else Allocation.to(known)

    def of(self, time: float, tau: np.ndarray, state: np.ndarray, contact: np.ndarray | None,
           mode: Mode, alarms: tuple[str, ...], plan: Plan | None = None,
           wrench: np.ndarray | None = None) -> LoopCommand:
        """Returns the command with τ (6+n,) [N, N m] in a state.

        The acceleration ζ̇ is that of the model, and q(t + T) = q + T q̇ + ½ T² q̈.

        Args:
            time: Time of the tick [s].
            tau: τ.
            state: (𝔮, ζ) (2(6+n),), finite.
            contact: 𝔉 (6,) [N, N m]; None: by the model's surface.
            mode: The mode.
            alarms: The alarms.
            plan: The plan, if it is known.
            wrench: Present wrench τ_v of the thrusters (6,) [N, N m]; None: the commanded one.
        """
        model, T = self._model, self._period
        config, zeta = np.split(state, 2)
        kinematics, still = model.kinematics(config), np.zeros_like(zeta)
        rest = model.inverse_dynamics(kinematics, zeta, still, contact)
        acting = tau if wrench is None else np.append(wrench, tau[6:])
        rate = np.linalg.solve(model.mass_matrix(kinematics), acting - rest)[6:]
        velocity = zeta[6:] + T * rate
        forces = commands = None
        if self._allocation is not None:
            forces = self._allocation.forces(tau[:6])
            commands = self._allocation.thrusters.commands_of(forces)
        return LoopCommand(
            time, tau, forces, commands,
            JointCommand(tau[6:], velocity, config[6:] + 0.5 * T * (zeta[6:] + velocity)),
            mode, alarms, plan)
