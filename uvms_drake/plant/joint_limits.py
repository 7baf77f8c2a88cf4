"""Joints as they are built: stops, and motors with a largest torque and a largest speed.

A stop at q₊ is a spring with a damper that pushes only, with x = q − q₊ > 0 and Λ the inertia of
the joint with the rest of the robot free,

    τ = −(Λω² x + 2ζωΛ q̇)₊,                                                                     (1)

whose spring gives all energy back, and whose damper only takes it. A motor of the torque E and
the speed V gives, by a commanded τ,

    clip(τ, −E g(−q̇), E g(q̇)),     g(q̇) = clip(1 − (q̇ − V)/b, −1, 1) for q̇ > V, else 1:          (2)

all of E up to V, and beyond it less, until it brakes. Within the limits both leave τ as it is, to
the bit.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from uvms_drake.common.wiring import WiredSystem, output_of
from uvms_drake.model.uvms import Uvms

STOP = (60.0, 0.5)
"""Frequency ω [rad/s] and damping ratio ζ of a joint against its stop."""
MOTOR = 100.0
"""Largest rate E/(bΛ) at which a motor brakes [1/s]: steps of the integrator follow it."""
SHARPEST = 0.1
"""Least b over V."""


@dataclass(frozen=True)
class JointLimits:
    """Limits of n joints; infinite where a file has none."""

    lower: np.ndarray
    """Stops (n,) [rad, m]."""
    upper: np.ndarray
    """Stops (n,) [rad, m]."""
    speed: np.ndarray
    """V (n,) [rad/s, m/s], of motors whose E is finite."""
    effort: np.ndarray
    """E (n,) [N m, N]."""
    inertia: np.ndarray
    """Λ (n,) [kg m², kg]."""

    @classmethod
    def of(cls, plant: MultibodyPlant, uvms: Uvms, M: np.ndarray) -> Self:
        """Returns those of a robot's file, with its mass matrix M (nv, nv), added mass in it."""
        efforts = {actuator.joint().index(): actuator.effort_limit() for actuator in (
            plant.get_joint_actuator(i) for i in plant.GetJointActuatorIndices())}
        rows = [joint.velocity_start() for joint in uvms.joints]
        return cls(*(np.array(each, dtype=float) for each in (
            [joint.position_lower_limits()[0] for joint in uvms.joints],
            [joint.position_upper_limits()[0] for joint in uvms.joints],
            [joint.velocity_upper_limits()[0] for joint in uvms.joints],
            [efforts.get(joint.index(), np.inf) for joint in uvms.joints],
            1.0 / np.diag(np.linalg.inv(M))[rows])))


def stop_torque(limits: JointLimits, q: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Returns the torques (n,) of the stops [N m, N]; see (1)."""
    omega, zeta = STOP
    torque = np.zeros_like(q)
    if ((q <= limits.upper) & (q >= limits.lower)).all():
        return torque
    for sign, stop in ((1.0, limits.upper), (-1.0, limits.lower)):
        x = np.maximum(sign * (q - stop), 0.0)
        response = limits.inertia * (omega**2 * x + 2.0 * zeta * omega * sign * rates)
        torque -= sign * np.where(x > 0.0, np.maximum(response, 0.0), 0.0)
    return torque


def motor_torque(limits: JointLimits, rates: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Returns the torques (n,) of the motors for commanded ones (n,) [N m, N]; see (2)."""
    def largest(rates: np.ndarray) -> np.ndarray:
        beyond = np.where(rates > limits.speed, rates - limits.speed, 0.0)
        band = np.maximum(SHARPEST * limits.speed, limits.effort / (MOTOR * limits.inertia))
        share: np.ndarray = np.where(beyond > 0.0, 1.0 - beyond / band, 1.0)
        return limits.effort * np.maximum(share, -1.0)

    slow = (np.abs(rates) <= limits.speed).all()
    most, least = (limits.effort, limits.effort) if slow else (largest(rates), largest(-rates))
    out: np.ndarray = np.minimum(np.maximum(torque, -least), most)
    return out


class LimitedJoints(WiredSystem):
    """Motors and stops of the joints, between command and plant.

    .. pydrake_system::

        name: LimitedJoints
        input_ports:
        - plant_state
        - tau (optional)
        output_ports:
        - exerted

    - `plant_state` (nq + nv): from `plant.get_state_output_port()`.
    - `tau` (6 + n) [N, N m]: commanded, in the paper's order; unconnected means zero.
    - `exerted` (6 + n): the same, with the torques of `motor_torque` and `stop_torque`.

    It has no state.

    Args:
        plant: A finalized plant.
        uvms: Its robot.
        limits: Limits of its joints.
    """

    def __init__(self, plant: MultibodyPlant, uvms: Uvms, limits: JointLimits):
        super().__init__()
        self._limits, self._size = limits, 6 + len(uvms.joints)
        self._q, self._rates = np.array([
            (joint.position_start(), plant.num_positions() + joint.velocity_start())
            for joint in uvms.joints], dtype=int).reshape(-1, 2).T
        self._state_port = self.DeclareVectorInputPort("plant_state", plant.num_multibody_states())
        self._tau_port = self.DeclareVectorInputPort("tau", self._size)
        output_of(self, "exerted", self._size, self._exerted, {self.all_input_ports_ticket()})

    def _exerted(self, context: Context) -> np.ndarray:
        state = self._state_port.Eval(context)
        q, rates = state[self._q], state[self._rates]
        out = self._tau_port.Eval(context).copy() if self._tau_port.HasValue(context) else (
            np.zeros(self._size))
        out[6:] = motor_torque(self._limits, rates, out[6:])
        out[6:] += stop_torque(self._limits, q, rates)
        return out
