"""The compliant surface that the end-effector presses on.

Frames: W is World (the paper's Σ_I), E the tip (Σ_E) with origin Eo, T the task's, fixed in World.
χ = (p_WEo, φθψ of R_TE) is the tip's pose, 𝔉 the force that the tip exerts *on* the surface,
conjugate to χ̇: a force in World and a torque conjugate to Euler-angle rates. The law 𝔉(χ, χ̇) is
that of a `Surface`.
"""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from pydrake.math import RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import Frame, JacobianWrtVariable
from pydrake.systems.framework import Context

from uvms_drake.common.constraints import Between, Constraint, Vector
from uvms_drake.common.wiring import WiredSystem, cached, output_of
from uvms_drake.model.frames.euler import WORLD, euler_angles, rate_matrix
from uvms_drake.model.frames.spatial import skew
from uvms_drake.model.surface.law import Surface, check_surface
from uvms_drake.plant.hydrodynamics import declare_workspace

_ORIGIN = np.zeros(3)
AXES_OF_WORLD = RotationMatrix()
"""Attitude of the paper's task frame, which is World."""


def pose(context: Context, tip: Frame, R_TW: RotationMatrix = AXES_OF_WORLD
         ) -> tuple[np.ndarray, np.ndarray]:
    """Returns χ (6,) [m, rad] of a frame and R_WE (3, 3); for the arguments see below."""
    X_WE = tip.CalcPoseInWorld(context).GetAsMatrix34()
    R_WE = X_WE[:, :3]
    return np.concatenate([X_WE[:, 3], euler_angles(R_TW.matrix() @ R_WE)]), R_WE


def pose_and_jacobian(
    plant: MultibodyPlant, context: Context, tip: Frame, R_TW: RotationMatrix = AXES_OF_WORLD
) -> tuple[np.ndarray, np.ndarray]:
    """Returns χ (6,) [m, rad] of a frame and J_χ (6, nv) with χ̇ = J_χ v, v in the plant's order.

    J_χ = (J_p; T R_EW J_ω) with the Jacobians of p_WEo and ω_WE in World, and T(φ, θ) that takes
    ω_WE_E to Euler-angle rates (`rate_matrix`); singular at |θ| = π/2.

    Args:
        plant: A finalized plant.
        context: Its Context.
        tip: E.
        R_TW: Attitude of W in T.
    """
    chi, R_WE = pose(context, tip, R_TW)
    return chi, _jacobian(plant, context, tip, chi, R_WE)


def _jacobian(plant: MultibodyPlant, context: Context, tip: Frame, chi: np.ndarray,
              R_WE: np.ndarray) -> np.ndarray:
    """Returns J_χ (6, nv), see above, at χ (6,) and R_WE (3, 3) of the Context."""
    W = plant.world_frame()
    J = plant.CalcJacobianSpatialVelocity(context, JacobianWrtVariable.kV, tip, _ORIGIN, W, W)
    return np.concatenate([J[3:], rate_matrix(chi[3:]) @ R_WE.T @ J[:3]])


class CompliantSurface(WiredSystem):
    """Reaction of a `Surface` on the tip of a robot.

    The generalised force on the robot is −J_χᵀ 𝔉(χ, χ̇), of power −𝔉ᵀχ̇.

    .. pydrake_system::

        name: CompliantSurface
        input_ports:
        - plant_state
        output_ports:
        - generalized_force
        - force
        - penetration
        - chi

    - `plant_state` (nq + nv): from `plant.get_state_output_port()`.
    - `generalized_force` (nv) [N, N m]: on the robot, in the plant's order: to
      `Hydrodynamics.generalized_force`, or for a robot in air to
      `plant.get_applied_generalized_force_input_port()`.
    - `force` (6) [N, N m]: 𝔉, on the surface; force in World, torque conjugate to Euler rates.
    - `penetration` (1) [m]: depth of the tip in a plane, stretch of a spring.
    - `chi` (6) [m, rad]: χ.

    This system does not have any state. The plant's parameters are those of its default Context.

    Args:
        plant: A finalized plant.
        tip: The frame E of `plant` that touches the surface.
        surface: A surface of `model.surface`, or one of your own.
        task_frame: ZYX Euler angles of T in World (3,) [rad].
    """

    def __init__(self, plant: MultibodyPlant, tip: Frame, surface: Surface,
                 task_frame: np.ndarray = WORLD):
        super().__init__()
        self._law = check_surface(surface)
        self._plant = plant
        self._tip = tip
        self._R_TW = RotationMatrix(RollPitchYaw(task_frame)).inverse()
        self._workspace = declare_workspace(self, plant)

        self._plant_state_port = self.DeclareVectorInputPort(
            "plant_state", plant.num_multibody_states())
        inputs = {self.all_input_ports_ticket()}
        self._pose = cached(self, "χ and R_WE", self._placed, inputs)
        touch = cached(self, "reaction and 𝔉", self._touch, inputs)
        now = {touch.ticket()}
        output_of(self, "generalized_force", plant.num_velocities(),
                  lambda c: touch.Eval(c)[0], now)
        output_of(self, "force", 6, lambda c: touch.Eval(c)[1], now)
        output_of(self, "penetration", 1, lambda c: [self._law.penetration(self._pose.Eval(c)[0])],
                  {self._pose.ticket()})
        output_of(self, "chi", 6, lambda c: self._pose.Eval(c)[0], {self._pose.ticket()})

    def _placed(self, context: Context) -> tuple[np.ndarray, np.ndarray]:
        """Returns χ (6,) and R_WE (3, 3), with the workspace in the present state."""
        workspace = self._workspace.Eval(context).context
        self._plant.SetPositionsAndVelocities(workspace, self._plant_state_port.Eval(context))
        chi, R_WE = pose(workspace, self._tip, self._R_TW)
        chi.setflags(write=False)  # A surface of one's own gets it.
        return chi, R_WE

    def _touch(self, context: Context) -> tuple[np.ndarray, np.ndarray]:
        """Returns −J_χᵀ 𝔉 (nv,) and 𝔉 (6,)."""
        (chi, R_WE), nv = self._pose.Eval(context), self._plant.num_velocities()
        if self._law.is_clear(chi[:3]):
            return np.zeros(nv), np.zeros(6)
        J = _jacobian(self._plant, self._workspace.Eval(context).context, self._tip, chi, R_WE)
        force = self._law.force(chi, J @ self._plant_state_port.Eval(context)[-nv:])
        return -force @ J, force


Rotation = Constraint("a rotation of at most π", lambda x: np.linalg.norm(x) <= np.pi)


@dataclass
class SurfaceError:
    """Difference of the simulated surface from the controller's: stiffness, shift and turn."""

    stiffness: Annotated[float, Between(0.01, 100)] = 1.0
    """Factor of the stiffness: the true one over the controller's."""
    shift: Annotated[np.ndarray, Vector(3)] = field(default_factory=lambda: np.zeros(3))
    """Shift of the surface in Σ_I [m]."""
    turn: Annotated[np.ndarray, Vector(3), Rotation] = field(default_factory=lambda: np.zeros(3))
    """Rotation vector in Σ_I, about the surface's anchor [rad]."""

    @property
    def size(self) -> float:
        """Largest of relative error, ‖shift‖ and ‖turn‖; zero if there is none."""
        return max(abs(self.stiffness - 1.0), float(np.linalg.norm(self.shift)),
                   float(np.linalg.norm(self.turn)))


def displaced(surface: Surface, error: SurfaceError) -> Surface:
    """Returns the simulated surface for the controller's `surface`, turned about its anchor."""
    if error.size == 0.0:
        return surface
    R, anchor = rotation_by(error.turn), np.asarray(surface.anchor, dtype=float)
    stiff = surface if error.stiffness == 1.0 else surface.stiffened(error.stiffness)
    return stiff.moved(R, anchor - R @ anchor + error.shift)


def rotation_by(turn: np.ndarray) -> np.ndarray:
    """Returns R (3, 3) of a rotation vector (3,) [rad], by Rodrigues' formula."""
    S, angle = skew(np.asarray(turn, dtype=float)), float(np.linalg.norm(turn))
    return np.eye(3) + np.sinc(angle / np.pi) * S + 0.5 * np.sinc(0.5 * angle / np.pi)**2 * S @ S
