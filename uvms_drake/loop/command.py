"""Command of a tick: forces, commands of thrusters and joints for them, mode and alarms."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from uvms_drake.actuation import Thrusters
from uvms_drake.common.errors import RunFailed
from uvms_drake.common.finite import is_finite
from uvms_drake.control.mpc.planner import HOVERED, TROUBLE
from uvms_drake.control.plan.plan import Plan
from uvms_drake.control.supervisor.retreat import WATCHING
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.signals.sensor_actuator import CAUSES, VEHICLE_WRENCH
from uvms_drake.sensing.force_fault_detector import ForceStatus
from uvms_drake.station.scenario.scenario import Scenario

ALARMS: tuple[tuple[str, int, Callable[[np.ndarray], str]], ...] = (
    ("safety", 0, lambda now: "retreats: {}: {}".format(*list(CAUSES.items())[int(now[1]) - 1])),
    ("safety", 4, lambda now: f"thruster {int(now[4])} is without power"),
    ("report", 1, lambda now: TROUBLE.get(int(now[1]), "")),
    ("report", 6, lambda now: "the desired force is refused"),
    ("input_limited", 0, lambda now: "a limit cuts the command"),
    ("force_lost", 0, lambda now: "no force for so long that the tip retreats"),
    ("force_status", 0, lambda now: f"the force is {ForceStatus(int(now[0])).name.lower()}"))
"""Signals, their entries that are not zero at an alarm, and the alarm; none if it is empty."""
READ = {VEHICLE_WRENCH, *(name for name, _, _ in ALARMS)} - {"input_limited"}
"""Signals of which commands are made, as far as a controller has them, after a tick's events."""


class Mode(StrEnum):
    """Kind of a command."""

    RUNNING = "running"
    """The law's, about the plan; after a failed first one that is to keep the place."""
    HOVERING = "hovering"
    """Likewise, and the plan is to keep the place until observers have settled, see `mpc.hover`."""
    REPEATED = "repeated"
    """That of the last tick again: the sample was not used."""
    RETREATING = "retreating"
    """That of the supervisor: off the wall, then station, until `reset` or a mission goes on."""
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
    isolated: int = 0
    """Number, from 1, of the thruster that a supervisor has isolated: cut its power; 0: none."""


class Outputs:
    """Commands of the thrusters and joints of a robot for τ.

    Args:
        scenario: Scenario with its actuators.
        model: The controller's model.
        period: T, until the next tick [s].
    """

    def __init__(self, scenario: Scenario, model: ContactModel, period: float):
        self._model, self._period = model, period
        known = [part.known(model) for part in scenario.actuation if isinstance(part, Thrusters)]
        if not known and model.thrusters is not None:
            known = [ThrusterModel.of(model.thrusters)]
        self._allocation = Allocation.to(known[0]) if known else None

    def of(self, time: float, tau: np.ndarray, state: np.ndarray, contact: np.ndarray | None,
           wrench: np.ndarray | None = None, isolated: int = 0, **others: Any) -> LoopCommand:
        """Returns the command with τ (6+n,) [N, N m] in a state.

        The acceleration ζ̇ is that of the model, and q(t + T) = q + T q̇ + ½ T² q̈.

        Args:
            time: Time of the tick [s].
            tau: τ.
            state: (𝔮, ζ) (2(6+n),), finite.
            contact: 𝔉 (6,) [N, N m]; None: by the model's surface.
            wrench: Present wrench τ_v of the thrusters (6,) [N, N m]; None: the commanded one.
            isolated: Number of the thruster without power, from 1, whose force is zero; 0: none.
            **others: Mode, alarms and plan.

        Raises:
            RunFailed: τ is not finite.
        """
        if not is_finite(tau):
            raise RunFailed("the command is not finite")
        config, zeta = np.split(state, 2)
        drift, M = self._model.drift_and_inertia(self._model.kinematics(config), zeta, contact)
        acting = tau if wrench is None else np.append(wrench, tau[6:])
        rates = zeta[6:], zeta[6:] + self._period * (drift + np.linalg.solve(M, acting))[6:]
        forces = commands = None
        if self._allocation is not None:
            forces = self._allocation.forces_without(isolated, tau[:6])
            commands = self._allocation.thrusters.commands_of(forces)
        position = config[6:] + 0.5 * self._period * (rates[0] + rates[1])
        return LoopCommand(time, tau, forces, commands,
                           JointCommand(tau[6:], rates[1], position), isolated=isolated, **others)


def mode_of(signals: dict[str, np.ndarray]) -> Mode:
    """Returns the mode by the signals of a controller, while it runs."""
    if "safety" in signals and signals["safety"][0] != WATCHING:
        return Mode.RETREATING
    return Mode.HOVERING if signals["report"][1] == HOVERED else Mode.RUNNING


def alarms_of(signals: dict[str, np.ndarray]) -> list[str]:
    """Returns the alarms by those signals."""
    return [alarm for name, entry, text in ALARMS if name in signals and signals[name][entry]
            and (alarm := text(signals[name]))]
