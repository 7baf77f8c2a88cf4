"""Dry friction in the joints of an arm, as of gears and screws, without a jump.

The friction on a joint that turns at q̇ is

    τ = −F(|q̇|) ρ(|q̇|/v_s) sign q̇,     F(v) = F_C + (F_S − F_C) exp(−((v − v_s)₊/v_b)²),       (1)

Coulomb's torque F_C, and at break-away the static one F_S (Stribeck). ρ is that of the friction of
a contact, `model.surface.contact_laws`: a sticking joint creeps at up to v_s.
"""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context

from uvms_drake.common.constraints import AtLeast, Constraint
from uvms_drake.common.errors import require
from uvms_drake.common.wiring import WiredSystem, output_of
from uvms_drake.model.surface.contact_laws import STEEPEST, slip_factor
from uvms_drake.model.uvms import Uvms

STRIBECK = 0.05
"""Stribeck velocity v_b, over which the static torque falls to Coulomb's [rad/s]."""
FrictionTorques = Constraint(
    "from 0 to 10000 N m, one for all joints or one each",
    lambda x: (np.ndim(x) == 1) & (x >= 0.0) & (x <= 1e4))


@dataclass
class JointFriction:
    """Friction of the joints in addition to the damping of the controller's model."""

    coulomb: Annotated[np.ndarray, FrictionTorques] = field(default_factory=lambda: np.zeros(1))
    """F_C of each joint, or one for all [N m]."""
    static: Annotated[np.ndarray, FrictionTorques] = field(default_factory=lambda: np.zeros(1))
    """F_S likewise, if larger than F_C [N m]."""
    creep: Annotated[float, AtLeast(1e-6)] = 0.005
    """Creep velocity v_s of a sticking joint [rad/s]; a smaller one needs shorter steps."""

    def torques(self, joints: int) -> tuple[np.ndarray, np.ndarray]:
        """Returns F_C and F_S ≥ F_C (n,) [N m]."""
        both = []
        for key in ("coulomb", "static"):
            value = np.asarray(getattr(self, key), dtype=float)
            require(len(value) in (1, joints), key, value, f"one number, or one for each of the "
                    f"{joints} joints")
            both.append(np.broadcast_to(value, joints))
        return both[0], np.maximum(*both)

    @property
    def largest(self) -> float:
        """Largest torque of a joint [N m]."""
        return float(max(np.max(self.coulomb, initial=0.0), np.max(self.static, initial=0.0)))

    def slopes(self, joints: int) -> np.ndarray:
        """Returns the largest slope (n,) of the torques by the rates [N m s/rad]."""
        return STEEPEST / self.creep * self.torques(joints)[1]


def friction_torque(friction: JointFriction, rates: np.ndarray) -> np.ndarray:
    """Returns τ (..., n) [N m] at rates q̇ (..., n) [rad/s]; see (1)."""
    coulomb, static = friction.torques(rates.shape[-1])
    speed = np.abs(rates)
    beyond = np.maximum(speed - friction.creep, 0.0) / STRIBECK
    size = coulomb + (static - coulomb) * np.exp(-beyond**2)
    return -size * slip_factor(speed / friction.creep) * rates / friction.creep


class DryJoints(WiredSystem):
    """Dry friction in the joints of a robot.

    .. pydrake_system::

        name: DryJoints
        input_ports:
        - plant_state
        output_ports:
        - generalized_force

    - `plant_state` (nq + nv): from `plant.get_state_output_port()`.
    - `generalized_force` (nv) [N, N m]: in the plant's order; to `Hydrodynamics.generalized_force`.

    It has no state.

    Args:
        plant: A finalized plant.
        uvms: Its robot.
        friction: Friction of its joints.
    """

    def __init__(self, plant: MultibodyPlant, uvms: Uvms, friction: JointFriction):
        super().__init__()
        friction.torques(len(uvms.joints))
        self._friction, nv = friction, plant.num_velocities()
        self._rows = np.array([joint.velocity_start() for joint in uvms.joints], dtype=int)
        self._first = plant.num_positions()
        self._port = self.DeclareVectorInputPort("plant_state", plant.num_multibody_states())
        output_of(self, "generalized_force", nv, self._force, {self._port.ticket()})

    def _force(self, context: Context) -> np.ndarray:
        v = self._port.Eval(context)[self._first:]
        force = np.zeros(len(v))
        force[self._rows] = friction_torque(self._friction, v[self._rows])
        return force
