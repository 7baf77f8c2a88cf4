"""Brake of a joint, whatever torque is commanded: a fault."""

from dataclasses import dataclass
from functools import partial
from typing import Annotated

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort

from uvms_drake.common.constraints import NotNegative
from uvms_drake.common.errors import require
from uvms_drake.model.signals.fault import Fault, FaultySignal
from uvms_drake.model.signals.sensor_actuator import Part, Signals
from uvms_drake.model.uvms_model import UvmsModel

BRAKE = (400.0, 40.0)
"""Stiffness [1/s²] and damping [1/s] of a brake, per inertia: critical, settled in 0.3 s."""


def braked(model: UvmsModel, joint: int, tau: np.ndarray, closed: np.ndarray, now: np.ndarray
           ) -> np.ndarray:
    """Returns τ (6+n,) [N, N m] with the torque of a brake on a joint.

    Args:
        model: Supplies the joint's inertia, that of the joint alone.
        joint: Index of the joint.
        tau: Commanded τ (6+n,).
        closed: (𝔮, ζ) (2(6+n),) when the brake closed; the joint's angle is held.
        now: The present (𝔮, ζ).
    """
    row, (config, zeta) = 6 + joint, np.split(now, 2)
    stiffness, damping = BRAKE
    inertia = model.mass_matrix(model.kinematics(config))[row, row]
    out = tau.copy()
    out[row] = -inertia * (stiffness * (config[row] - closed[row]) + damping * zeta[row])
    return out


@dataclass
class StuckJoint(Fault, Part):
    """Brake, a stiff spring with a damper, on a joint at its angle at `start`.

    In a simulation that begins after that, at its angle at the beginning. It is as strong as the
    joint's motor, behind which it acts.
    """

    place = "actuation"

    joint: Annotated[int, NotNegative] = 0
    """Index of the joint, from 0."""
    start: Annotated[float, NotNegative] = 0.0
    """First instant of the braking [s]."""

    def add_to(self, builder: DiagramBuilder, model: UvmsModel, port: OutputPort,
               signals: Signals, seed: int) -> OutputPort:
        """Adds a `FaultySignal` with the law `braked`; see `Part`."""
        require(self.joint < model.num_joints, "joint", self.joint,
                f"an index from 0 to {model.num_joints - 1}")
        state, law = signals["state"], partial(braked, model, self.joint)
        return FaultySignal.AddToBuilder(
            builder, self, law, port.size(), state.size(), name="joint_brake", signal=port,
            watched=state).get_output_port()
