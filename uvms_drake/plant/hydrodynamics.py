"""The water's forces on a robot, solved for the acceleration together with the robot itself.

Frames: W is World (inertial), B a body with origin Bo, P a point of B. Velocities and forces of a
body are in axes of B and in Fossen's order: ν = (v_WBo_B, ω_WB_B), f = (force, moment about Bo).
ν_r = ν − (R_BW v_c, 0) is the velocity through the water, which moves with v_c(t), the same all
over the robot. Every law takes stacks of any leading shape.

Water accelerates by a gradient of its pressure, −∇p + ρg = ρv̇_c. It exerts the force ρV v̇_c of
Froude and Krylov on a body, as if gravity were g − v̇_c for buoyancy and g for weight; and the added
mass resists the acceleration through the water. The water inside of a flooded hull counts as added
mass: its M_A v̇_c is the same force on the volume that it occupies.

References: Fossen (2021), *Handbook of Marine Craft Hydrodynamics and Motion Control*; Newman
(1977), *Marine Hydrodynamics*, chapter 4.
"""

from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import ExternallyAppliedSpatialForceMultiplexer, MultibodyPlant
from pydrake.multibody.tree import BodyIndex, JacobianWrtVariable, MultibodyForces, RigidBody
from pydrake.systems import framework
from pydrake.systems.primitives import ConstantVectorSource

from uvms_drake.common.errors import require
from uvms_drake.common.schema import check_values
from uvms_drake.common.wiring import cached, output_of
from uvms_drake.model.description.hydrodynamics_file import (
    BodyHydrodynamics,
    HydrodynamicParameters,
    added_mass_about_origin,
)
from uvms_drake.model.frames.spatial import cross, cross_force, skew, times


class Workspace(NamedTuple):
    """Scratch data of a calculation."""

    context: framework.Context
    """Context of the plant, with the parameters of the default Context."""
    forces: MultibodyForces
    """Forces of the plant."""


def declare_workspace(system: framework.LeafSystem, plant: MultibodyPlant) -> framework.CacheEntry:
    """Returns a cache entry of a system with a `Workspace` that is never out of date.

    Args:
        system: System that computes.
        plant: A finalized plant.
    """
    return system.DeclareCacheEntry(
        description="workspace",
        value_producer=framework.ValueProducer(
            allocate=lambda: AbstractValue.Make(
                Workspace(plant.CreateDefaultContext(), MultibodyForces(plant))),
            calc=framework.ValueProducer.NoopCalc),
        prerequisites_of_calc={system.nothing_ticket()})


_FROM_DRAKE = np.array([3, 4, 5, 0, 1, 2])  # Drake's spatial vectors have the angular part first.


def relative_acceleration(acceleration: np.ndarray, nu_r: np.ndarray, water: np.ndarray
                          ) -> np.ndarray:
    """Returns ν̇_r (..., 6), the rate of the components of ν_r in the turning axes of B.

    Bo accelerates by a and the water by a_c; as B sees it the water's velocity also turns with −ω,
    so that its components change by a_c − ω × v_c. Hence ν̇_r = (a − ω × v − (a_c − ω × v_c), α) =
    (a − a_c − ω × v_r, α).

    Args:
        acceleration: (a_WBo_B, α_WB_B) (..., 6) [m/s², rad/s²].
        nu_r: ν_r (..., 6) [m/s, rad/s].
        water: a_c in axes of B (..., 3) [m/s²].
    """
    out = acceleration.copy()
    out[..., :3] -= cross(nu_r[..., 3:], nu_r[..., :3])
    out[..., :3] -= water
    return out


def kirchhoff_force(M_A: np.ndarray, nu_r: np.ndarray, nu_r_dot: np.ndarray) -> np.ndarray:
    """Returns the force (..., 6) [N, N m] of an ideal fluid on a body that moves through it.

    Kirchhoff's equations, f = −[M_A ν̇_r + ν_r ×* (M_A ν_r)]; the second term is C_A(ν_r) ν_r of
    Fossen (2021, chapter 6) and does no work.

    Args:
        M_A: Added mass (..., 6, 6) about Bo, symmetric [kg, kg m, kg m²].
        nu_r: ν_r (..., 6) [m/s, rad/s].
        nu_r_dot: ν̇_r (..., 6), see `relative_acceleration` [m/s², rad/s²].
    """
    return -(times(M_A, nu_r_dot) + cross_force(nu_r, times(M_A, nu_r)))


def drag_force(linear: np.ndarray, quadratic: np.ndarray, nu_r: np.ndarray) -> np.ndarray:
    """Returns −(linear + quadratic ⊙ |ν_r|) ⊙ ν_r (..., 6), see `hydrodynamics_file.Drag`."""
    return -(linear + quadratic * np.abs(nu_r)) * nu_r


def buoyancy_force(displaced_mass: np.ndarray, p_BoBb_B: np.ndarray, g_B: np.ndarray) -> np.ndarray:
    """Returns −ρV g at the centre of buoyancy Bb, as a force (..., 6) [N, N m] about Bo.

    It is linear in g.

    Args:
        displaced_mass: ρV (...) [kg].
        p_BoBb_B: Centre of buoyancy (..., 3) [m].
        g_B: Gravity less the acceleration of the water, in axes of B (..., 3) [m/s²].
    """
    force = -displaced_mass[..., None] * g_B
    return np.concatenate([force, cross(p_BoBb_B, force)], axis=-1)


@dataclass(frozen=True)
class Water:
    """The parameters of nb bodies with nd drag points between them, stacked."""

    M_A: np.ndarray
    """Added mass about Bo (nb, 6, 6)."""
    buoyancy: np.ndarray
    """Buoyancy by gravity (nb, 6, 3) [kg, kg m], see `buoyancy_force`."""
    drag_points: np.ndarray
    """H (6 nd, 6 nb), the map from the ν of all bodies to those of the drag points."""
    linear: np.ndarray
    """Linear drag coefficients (nd, 6)."""
    quadratic: np.ndarray
    """Quadratic drag coefficients (nd, 6)."""

    def fluid_force(self, nu_r: np.ndarray, nu_r_dot: np.ndarray, g_B: np.ndarray) -> np.ndarray:
        """Returns the force on each body (nb, 6): Kirchhoff's, drag and buoyancy.

        `g_B` is gravity less the acceleration of the water, see `buoyancy_force`.
        """
        nu_P = (self.drag_points @ nu_r.ravel()).reshape(-1, 6)
        drag = self.drag_points.T @ drag_force(self.linear, self.quadratic, nu_P).ravel()
        return (kirchhoff_force(self.M_A, nu_r, nu_r_dot) + drag.reshape(-1, 6)
                + times(self.buoyancy, g_B))


def make_water(parameters: HydrodynamicParameters) -> Water:
    """Checks the parameters and stacks them in the order of `parameters.bodies`."""
    check_values(parameters)
    bodies: list[BodyHydrodynamics] = list(parameters.bodies.values())
    drags = [(i, drag) for i, body in enumerate(bodies) for drag in body.drag]
    drag_points = np.zeros((len(drags), 6, len(bodies), 6))
    for row, (i, drag) in enumerate(drags):
        drag_points[row, :, i] = np.eye(6)
        drag_points[row, :3, i, 3:] = -skew(np.asarray(drag.point, dtype=float))
    rho = parameters.fluid_density
    return Water(
        M_A=_stack([added_mass_about_origin(body.added_mass) for body in bodies], 6, 6),
        buoyancy=buoyancy_force(
            rho * _stack([body.displaced_volume for body in bodies]),
            _stack([body.center_of_buoyancy for body in bodies], 3),
            np.eye(3)[:, None, :]).transpose(1, 2, 0),
        drag_points=drag_points.reshape(6 * len(drags), 6 * len(bodies)),
        linear=_stack([drag.linear for _, drag in drags], 6),
        quadratic=_stack([drag.quadratic for _, drag in drags], 6),
    )


def _stack(items: list, *shape: int) -> np.ndarray:
    """Returns the items as one array; without items it still has the right shape."""
    return np.array(items, dtype=float).reshape(-1, *shape)


class Hydrodynamics(framework.LeafSystem):
    """Hydrodynamic forces on a `MultibodyPlant`.

    The generalised acceleration v̇ solves, once and without a loop or a delay,

        (M_RB + Σ JᵢᵀM_AᵢJᵢ) v̇₀ = τ − b(q, v) + Σ Jᵢᵀfᵢ,      v̇ = v̇₀ + d,

    with M_RB and b (bias, gravity, joint damping, springs) the plant's own, Jᵢ the Jacobian of body
    i in its axes and fᵢ the force of the water on it less M_AᵢJᵢv̇. The output M_RB v̇ + b then makes
    the plant accelerate by v̇. Feeding the added-mass force back from a measured acceleration
    instead would be an algebraic loop, or with a delay unstable as soon as M_A > M_RB.

    - Weight acts on the dry mass and is the plant's own; buoyancy uses the plant's gravity vector.
    - All other forces must come in through `generalized_force`, spatial forces through
      `AppliedForces`. Forces that reach the plant in another way, as contact and joint limits of a
      discrete plant do, move the dry mass only; `AddToBuilder` closes its ports for spatial forces
      and actuation.
    - In a discrete plant with time step h, v⁺ = v + h v̇ holds exactly while no constraint acts. Its
      solvers but TAMSI treat joint damping D as implicit, and so does this system: M_RB + hD
      stands for M_RB. The force of the water is that at (q, v); h must resolve the drag.

    .. pydrake_system::

        name: Hydrodynamics
        input_ports:
        - plant_state
        - generalized_force (optional)
        - current (optional)
        - current_acceleration (optional)
        - acceleration_disturbance (optional)
        output_ports:
        - applied_generalized_force
        - acceleration

    With nq, nv of the plant, everything in the plant's order:

    - `plant_state` (nq + nv): from `plant.get_state_output_port()`.
    - `generalized_force` (nv) [N, N m]: τ, sum of all other forces; unconnected means zero.
    - `current` (3) [m/s]: v_c, velocity of the water in World; unconnected means still water.
    - `current_acceleration` (3) [m/s²]: v̇_c in World; unconnected means that the current is steady.
    - `acceleration_disturbance` (nv) [m/s², rad/s²]: d; unconnected means zero.
    - `applied_generalized_force` (nv) [N, N m]: to
      `plant.get_applied_generalized_force_input_port()`.
    - `acceleration` (nv) [m/s², rad/s²]: v̇.

    This system does not have any state. The plant's parameters are those of its default Context: a
    mass that is set in another one changes the plant and not this system.

    Args:
        plant: A finalized plant, continuous or discrete.
        parameters: Added mass, drag and buoyancy by name of the body, see `HydrodynamicParameters`.
    """

    def __init__(self, plant: MultibodyPlant, parameters: HydrodynamicParameters):
        super().__init__()
        self._water = make_water(parameters)
        bodies = [_find_body(plant, name) for name in parameters.bodies]
        self._frames = [body.body_frame() for body in bodies]
        self._indices = [int(body.index()) for body in bodies]
        self._plant = plant
        self._workspace = declare_workspace(self, plant)
        self._no_acceleration, self._origin = np.zeros(plant.num_velocities()), np.zeros(3)
        self._world = plant.world_frame()
        self._gravity = plant.gravity_field().gravity_vector()
        self._implicit_damping = plant.time_step() * _implicit_joint_damping(plant)

        nv = plant.num_velocities()
        self._plant_state_port = self.DeclareVectorInputPort(
            "plant_state", plant.num_multibody_states())
        self._force_port = self.DeclareVectorInputPort("generalized_force", nv)
        self._current_port = self.DeclareVectorInputPort("current", 3)
        self._current_rate_port = self.DeclareVectorInputPort("current_acceleration", 3)
        self._disturbance_port = self.DeclareVectorInputPort("acceleration_disturbance", nv)
        inputs = {self.all_input_ports_ticket()}
        solution = cached(self, "v̇ and the force that produces it", self._solve, inputs)
        output_of(
            self, "applied_generalized_force", nv, lambda c: solution.Eval(c)[1], inputs)
        output_of(self, "acceleration", nv, lambda c: solution.Eval(c)[0], inputs)

    @staticmethod
    def AddToBuilder(builder: framework.DiagramBuilder, plant: MultibodyPlant,
                     parameters: HydrodynamicParameters) -> "Hydrodynamics":
        """Adds the system to `builder` and wires it to the state and force ports of `plant`.

        The ports `applied_spatial_force` and `actuation` of the plant get an empty list and zeros,
        so that a later connection (as by `AddDefaultVisualization` in newer versions of Drake)
        fails instead of moving the dry mass only.

        Raises:
            InvalidParameter: One of these ports is connected already.
        """
        system = builder.AddNamedSystem("hydrodynamics", Hydrodynamics(plant, parameters))
        builder.Connect(plant.get_state_output_port(), system.GetInputPort("plant_state"))
        for port, nothing in (
            (plant.get_applied_spatial_force_input_port(),
             ExternallyAppliedSpatialForceMultiplexer(num_inputs=0)),
            (plant.get_actuation_input_port(),
             ConstantVectorSource(np.zeros(plant.num_actuated_dofs()))),
        ):
            require(not builder.IsConnectedOrExported(port),
                    f"plant.{port.get_name()}", "connected",
                    "free: under water, forces go to Hydrodynamics.generalized_force")
            builder.AddNamedSystem(f"hydrodynamics.no_{port.get_name()}", nothing)
            builder.Connect(nothing.get_output_port(), port)
        builder.Connect(system.GetOutputPort("applied_generalized_force"),
                        plant.get_applied_generalized_force_input_port())
        return system

    def mass_matrix(self, state: np.ndarray) -> np.ndarray:
        """Returns the mass matrix (nv, nv) with added mass at a state (nq + nv) of the plant."""
        plant, workspace = self._plant, self._plant.CreateDefaultContext()
        plant.SetPositionsAndVelocities(workspace, state)
        v = state[-plant.num_velocities():]
        J, _ = self._water_at_no_acceleration(workspace, v, None, None)
        M: np.ndarray = plant.CalcMassMatrix(workspace) + np.einsum(
            "bki,bkl,blj->ij", J, self._water.M_A, J)
        return M

    def _solve(self, context: framework.Context) -> tuple[np.ndarray, np.ndarray]:
        plant, (workspace, forces) = self._plant, self._workspace.Eval(context)
        state = cast(np.ndarray, self._plant_state_port.Eval(context))
        plant.SetPositionsAndVelocities(workspace, state)
        M_RB = plant.CalcMassMatrix(workspace) + self._implicit_damping
        plant.CalcForceElementsContribution(workspace, forces)
        bias = plant.CalcInverseDynamics(workspace, self._no_acceleration, forces)
        J, force = self._water_at_no_acceleration(
            workspace, state[-len(bias):], _value(self._current_port, context),
            _value(self._current_rate_port, context))

        nb, _, nv = J.shape
        J_all, M_A_J = J.reshape(6 * nb, nv), (self._water.M_A @ J).reshape(6 * nb, nv)
        total = force.ravel() @ J_all - bias
        if (tau := _value(self._force_port, context)) is not None:
            total += tau
        v_dot = np.linalg.solve(M_RB + J_all.T @ M_A_J, total)
        if (d := _value(self._disturbance_port, context)) is not None:
            v_dot += d
        return v_dot, M_RB @ v_dot + bias

    def _water_at_no_acceleration(
        self, workspace: framework.Context, v: np.ndarray, v_c_W: np.ndarray | None,
        a_c_W: np.ndarray | None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns Jᵢ (nb, 6, nv) and fᵢ (nb, 6) in the state of the workspace at v̇ = 0.

        None for v_c or v̇_c means zero.
        """
        plant, W, zero = self._plant, self._world, self._origin
        J, R_WB = np.empty((len(self._frames), 6, len(v))), np.empty((len(self._frames), 3, 3))
        for i, B in enumerate(self._frames):
            J[i] = plant.CalcJacobianSpatialVelocity(
                workspace, JacobianWrtVariable.kV, B, zero, W, B)
            R_WB[i] = B.CalcRotationMatrixInWorld(workspace).matrix()
        A = plant.CalcSpatialAccelerationsFromVdot(workspace, self._no_acceleration)  # in World
        A_B = _stack([A[index].get_coeffs() for index in self._indices], 2, 3) @ R_WB
        J, nu_r_dot = J.take(_FROM_DRAKE, 1), A_B.reshape(-1, 6).take(_FROM_DRAKE, 1)
        nu_r, g_B = J @ v, self._gravity @ R_WB
        if v_c_W is not None:
            nu_r[:, :3] -= v_c_W @ R_WB
        if a_c_W is None:
            water_rate = self._origin
        else:
            water_rate = a_c_W @ R_WB
            g_B -= water_rate
        nu_r_dot = relative_acceleration(nu_r_dot, nu_r, water_rate)
        return J, self._water.fluid_force(nu_r, nu_r_dot, g_B)


def _value(port: framework.InputPort, context: framework.Context) -> np.ndarray | None:
    """Returns the value of an optional port, None if it is not connected."""
    return cast(np.ndarray, port.Eval(context)) if port.HasValue(context) else None


def _find_body(plant: MultibodyPlant, name: str) -> RigidBody:
    bodies = [plant.get_body(BodyIndex(i)) for i in range(1, plant.num_bodies())]  # 0 is World.
    found = [body for body in bodies if body.name() == name]
    names = ", ".join(dict.fromkeys(body.name() for body in bodies))
    require(len(found) == 1, "bodies", name, f"the name of one body of the plant: {names}")
    return found[0]


def _implicit_joint_damping(plant: MultibodyPlant) -> np.ndarray:
    """Returns the viscous damping (nv, nv) [N s/m, N m s/rad] that a discrete step takes at v⁺."""
    D = np.zeros(plant.num_velocities())
    if plant.get_discrete_contact_approximation().name == "kTamsi":  # Not in newer Drake versions.
        return np.diag(D)
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        D[joint.velocity_start():][: joint.num_velocities()] = joint.default_damping_vector()
    return np.diag(D)
