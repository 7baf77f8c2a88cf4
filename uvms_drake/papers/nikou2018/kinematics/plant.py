"""The robot of the paper's simulation: the velocity is the input, and w moves the tip.

    χ̇ = J(𝔮) ζ + w

has 6 rows for 6 + n coordinates. In the simulation w moves the vehicle and with it the
end-effector, but not the joints: with J_x = [J; 0 I],

    𝔮̇ = Γ(𝔮) [ζ + J_x(𝔮)⁻¹ (w, 0)],    which is    ẏ = J_x(𝔮) ζ + (w, 0)    for y = (χ, q).
"""


import numpy as np
from pydrake.math import RollPitchYaw, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import (
    BasicVector,
    Context,
    ContinuousState,
    Diagram,
    DiagramBuilder,
    InputPort,
    LeafSystem,
    OutputPort,
)
from pydrake.systems.primitives import PassThrough

from uvms_drake.common.errors import RunFailed, require, vector, within
from uvms_drake.common.wiring import added
from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.frames.euler import WORLD
from uvms_drake.model.robot import Robot
from uvms_drake.model.uvms import Uvms
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.plant.disturbance import OpenLoopDisturbance
from uvms_drake.plant.model_error import add_simulated_uvms
from uvms_drake.plant.surface import pose_and_jacobian
from uvms_drake.plant.workspace import declare_workspace

PITCH_MARGIN = 0.01
"""Smallest distance of either pitch from ±π/2 [rad]; there ‖J‖ is about 100."""


def carried_rate(config: np.ndarray, zeta: np.ndarray, w: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Returns 𝔮̇ (6+n,) = Γ(𝔮) [ζ + J_x(𝔮)⁻¹ (w, 0)].

    With the columns J = [J_v, J_q] of vehicle and joints, J_x⁻¹ (w, 0) = (J_v⁻¹ w, 0).

    Args:
        config: 𝔮 (6+n,).
        zeta: ζ (6+n,).
        w: Disturbance of χ̇ (6,).
        J: J(𝔮) (6, 6+n).
    """
    carried = zeta.copy()
    carried[:6] += np.linalg.solve(J[:, :6], w)
    return configuration_rate(config, carried)


class VelocityDrivenUvms(LeafSystem):
    """A UVMS that moves at the commanded velocity, with w added at the end-effector.

    .. pydrake_system::

        name: VelocityDrivenUvms
        input_ports:
        - zeta (optional)
        - disturbance (optional)
        output_ports:
        - configuration
        - state

    - `zeta`: ζ (6+n) [m/s, rad/s], commanded, in the paper's order; unconnected means zero.
    - `disturbance`: w (6) [m/s, rad/s], added to χ̇; unconnected means zero.
    - `configuration`: 𝔮 (6+n) [m, rad].
    - `state`: (𝔮, ζ) (2(6+n)), ζ as it is commanded.

    The continuous state is 𝔮, of which the Euler angles are not wrapped. Only `state` has
    feedthrough, from `zeta`. Joint limits are left to the controller.

    J is computed from the MultibodyPlant, not from the controller's model. The plant itself is not
    simulated.

    The simulation ends with `RunFailed` if the vehicle's or the end-effector's pitch comes within
    `PITCH_MARGIN` of ±π/2, where Euler angles are singular, or an input is not finite.

    Args:
        uvms: Handles of the robot in a finalized plant.
        start: Default 𝔮 (6+n,) [m, rad]; zero if left out.
        task_frame: ZYX Euler angles of the task's frame in World (3,), to which χ refers [rad].
    """

    def __init__(self, uvms: Uvms, start: np.ndarray | None = None,
                 task_frame: np.ndarray = WORLD):
        super().__init__()
        self.coordinates = Coordinates(uvms)
        self._uvms = uvms
        self._R_TW = RotationMatrix(RollPitchYaw(task_frame)).inverse()
        self._workspace = declare_workspace(self, uvms.plant)
        size = self.coordinates.size
        config = self.DeclareContinuousState(BasicVector(
            np.zeros(size) if start is None else vector("start", start, size)))
        self._zeta_port = self.DeclareVectorInputPort("zeta", size)
        self._disturbance_port = self.DeclareVectorInputPort("disturbance", 6)
        self.DeclareStateOutputPort("configuration", config)
        zeta = self.input_port_ticket(self._zeta_port.get_index())
        self.DeclareVectorOutputPort(
            "state", 2 * size, self._calc_state, {self.xc_ticket(), zeta})

    @staticmethod
    def AddToBuilder(
        builder: DiagramBuilder,
        uvms: Uvms,
        *,
        start: np.ndarray | None = None,
        task_frame: np.ndarray = WORLD,
        zeta: OutputPort | None = None,
        disturbance: OutputPort | None = None,
        name: str = "kinematics",
    ) -> "VelocityDrivenUvms":
        """Adds the system to `builder`; `zeta` and `disturbance` are ports of ζ and w, or None."""
        return added(builder, name, VelocityDrivenUvms(uvms, start, task_frame),
                     zeta=zeta, disturbance=disturbance)

    def tip_motion(self, context: Context) -> tuple[np.ndarray, np.ndarray]:
        """Returns χ (6,) and J (6, 6+n) at the 𝔮 of a Context, by the MultibodyPlant."""
        x = self._plant_state(context.get_continuous_state_vector().CopyToVector())
        workspace = self._workspace.Eval(context).context
        self._uvms.plant.SetPositionsAndVelocities(workspace, x)
        chi, J_v = pose_and_jacobian(self._uvms.plant, workspace, self._uvms.tip, self._R_TW)
        T = np.column_stack([self.coordinates.vector_to_drake(x, unit) for unit in np.eye(
            self.coordinates.size)])  # v = T ζ
        return chi, J_v @ T

    def DoCalcTimeDerivatives(  # noqa: D102  Drake's name and meaning
        self, context: Context, derivatives: ContinuousState
    ) -> None:
        config = context.get_continuous_state_vector().CopyToVector()
        zeta = self._value(context, self._zeta_port)
        w = self._value(context, self._disturbance_port)
        at = f"at t = {context.get_time():g} s"
        for name, value in (("commanded velocity", zeta), ("disturbance", w)):
            if not np.all(np.isfinite(value)):
                raise RunFailed(f"{at} the {name} is not finite")
        chi, J = self.tip_motion(context)
        for owner, pitch in (("vehicle", config[4]), ("end-effector", chi[4])):
            if abs(pitch) > 0.5 * np.pi - PITCH_MARGIN:
                raise RunFailed(f"{at} the pitch of the {owner} is {pitch:.4g} rad: Euler angles "
                                "are singular at ±π/2")
        derivatives.SetFromVector(carried_rate(config, zeta, w, J))

    def _calc_state(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.concatenate([
            context.get_continuous_state_vector().CopyToVector(),
            self._value(context, self._zeta_port)]))

    def _plant_state(self, config: np.ndarray) -> np.ndarray:
        """Returns the plant state (q, 0) at 𝔮."""
        return self.coordinates.to_drake(np.concatenate([config, np.zeros_like(config)]))

    @staticmethod
    def _value(context: Context, port: InputPort) -> np.ndarray:
        return port.Eval(context) if port.HasValue(context) else np.zeros(port.size())


def make_kinematic_plant(
    robot: Robot | str,
    *,
    disturbance: OpenLoopDisturbance | None,
    seed: int = 0,
    start: np.ndarray | None = None,
    task_frame: np.ndarray = WORLD,
) -> Diagram:
    """Returns a velocity-driven UVMS as a Diagram named "uvms".

    ::

        zeta ──────────▶ kinematics ──▶ configuration, state
                              ▲
        disturbance ──────────┴─▶ disturbance

    World is Σ_I (NED); n is the number of the arm's joints.

    .. pydrake_system::

        name: uvms
        input_ports:
        - zeta (optional)
        - disturbance (with disturbance=None)
        output_ports:
        - configuration
        - state
        - disturbance

    - `zeta` (6+n) [m/s, rad/s]: ζ, the velocity, in the paper's order, the vehicle's part in body
      axes; unconnected means zero.
    - `configuration` (6+n): 𝔮 [m, rad]; without feedthrough, so that a controller may read it.
    - `state` (2(6+n)): 𝔮 and the commanded ζ.
    - `disturbance` (6) [m/s, rad/s]: w, added to χ̇.

    The subsystems "kinematics" and "disturbance" are found with `GetSubsystemByName`.

    Args:
        robot: A `Robot`, the name of a shipped one, or a robot's folder.
        disturbance: w, of bound w̃; the paper's w = 0.2 sin(t) 1₆ has w̃ = 0.2 √6. None exports an
            input port `disturbance` for the caller's.
        seed: Seed of the disturbance.
        start: Default 𝔮 (6+n,) [m, rad]; if left out, zero, where the end-effector of an arm may be
            at the Euler angles' singularity.
        task_frame: As of `VelocityDrivenUvms`.
    """
    require(seed >= 0, "seed", seed, "zero or positive")
    builder = DiagramBuilder()
    plant = MultibodyPlant(time_step=0.0)  # Only its kinematics is used.
    uvms = add_simulated_uvms(plant, robot, None)
    plant.Finalize()

    if disturbance is None:
        w = builder.AddNamedSystem("disturbance", PassThrough(6))
        builder.ExportInput(w.get_input_port(), "disturbance")
    else:
        with within("disturbance"):
            w = disturbance.add_source(builder, 6, seed)
    kinematics = VelocityDrivenUvms.AddToBuilder(
        builder, uvms, start=start, task_frame=task_frame,
        disturbance=w.get_output_port())

    builder.ExportInput(kinematics.GetInputPort("zeta"), "zeta")
    builder.ExportOutput(kinematics.GetOutputPort("configuration"), "configuration")
    builder.ExportOutput(kinematics.GetOutputPort("state"), "state")
    builder.ExportOutput(w.get_output_port(), "disturbance")
    diagram = builder.Build()
    diagram.set_name("uvms")
    return diagram
