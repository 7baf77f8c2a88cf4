"""Robots of made-up links, in water of their own: forces and energy in a frame I with z down."""

import numpy as np
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput

from uvms_drake.plant.hydrodynamics import Hydrodynamics
from uvms_drake.plant.waves import WaterMotion

G = 9.81  # m/s²
MASS, INERTIA = 3.2, (0.31, 0.27, 0.43)  # kg, kg m²


def link(name: str, mass: float = MASS, com=(0.0, 0.0, 0.0), parent="__model__",
         pose="0 0 0 0 0 0", inertia=INERTIA) -> str:
    ixx, iyy, izz = inertia
    return f"""
      <link name="{name}"><pose relative_to="{parent}">{pose}</pose>
        <inertial><pose>{com[0]} {com[1]} {com[2]} 0 0 0</pose><mass>{mass}</mass>
          <inertia><ixx>{ixx}</ixx><iyy>{iyy}</iyy><izz>{izz}</izz>
                   <ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia></inertial></link>"""


def joint(name: str, parent: str, child: str, axis: str, damping: float) -> str:
    return f"""
      <joint name="{name}" type="revolute"><parent>{parent}</parent><child>{child}</child>
        <axis><xyz>{axis}</xyz><limit><effort>7</effort></limit>
          <dynamics><damping>{damping}</damping></dynamics></axis>
        <drake:rotor_inertia>0.002</drake:rotor_inertia><drake:gear_ratio>11</drake:gear_ratio>
      </joint>"""


def robot(damping: float = 0.0) -> str:
    """A vehicle with an arm of two joints that are neither parallel nor orthogonal."""
    return (
        link("vehicle", 7.3, (0.03, -0.02, 0.06))
        + link("upper", 1.9, (0.11, 0.02, -0.01), "vehicle", "0.4 0.1 0.2 0.1 0.3 -0.5")
        + link("lower", 1.1, (0.17, -0.03, 0.0), "upper", "0.35 0 0.05 -0.4 0.2 0.1")
        + joint("shoulder", "vehicle", "upper", "0 0.6 0.8", damping)
        + joint("elbow", "upper", "lower", "0 1 0", 0.7 * damping)
        + '<frame name="tip" attached_to="lower"><pose>0.4 -0.05 0.1 0.3 0.5 -0.2</pose></frame>')


def plant_of(model: str, builder=None, *, gravity=(0.0, 0.0, 0.0), time_step=0.0, solver=None):
    """Returns a finalized plant of links and joints, in a Diagram if there is a builder."""
    plant = MultibodyPlant(time_step)
    if builder is not None:
        builder.AddNamedSystem("plant", plant)
    Parser(plant).AddModelsFromString(
        f"""<sdf version="1.9" xmlns:drake="drake.mit.edu"><model name="robot">{model}</model>
            </sdf>""", "sdf")
    plant.mutable_gravity_field().set_gravity_vector(np.array(gravity))
    if solver is not None:
        plant.set_discrete_contact_approximation(solver)
    plant.Finalize()
    return plant


def random_added_mass(seed: int) -> np.ndarray:
    A = np.random.default_rng(seed).normal(size=(6, 6))
    return A @ A.T + np.diag([2.0, 5.0, 7.0, 0.2, 0.4, 0.3])


class Tank:
    """One robot under water, in a Diagram of its own; `X_WI` puts I into World, gravity too."""

    def __init__(self, parameters, model=None, X_WI=None, *, gravity=(0.0, 0.0, G), time_step=0.0,
                 solver=None, waves=(), current=(0.0, 0.0, 0.0)):
        self.X_WI = X_WI or RigidTransform()
        builder = DiagramBuilder()
        self.plant = plant_of(
            model or link("vehicle"), builder, time_step=time_step, solver=solver,
            gravity=self.X_WI.rotation() @ np.array(gravity))
        self.water = Hydrodynamics.AddToBuilder(builder, self.plant, parameters)
        if waves:
            moving = builder.AddSystem(WaterMotion(np.array(current), waves))
            for name in ("current", "current_acceleration"):
                builder.Connect(moving.GetOutputPort(name), self.water.GetInputPort(name))
        self.log = LogVectorOutput(self.plant.get_state_output_port(), builder, 0.1)
        self.diagram = builder.Build()
        self.context = self.diagram.CreateDefaultContext()
        self.plant_context = self.plant.GetMyMutableContextFromRoot(self.context)
        self.nv = self.plant.num_velocities()

    def set(self, nu, X_IB=None, q=(), q_dot=()):
        """Sets the body-axes velocity ν = (v, ω) of the vehicle, its pose in I, and the joints."""
        X_WB = self.X_WI @ (X_IB or RigidTransform())
        R = X_WB.rotation().matrix()
        nu = np.asarray(nu, dtype=float)
        self.plant.SetPositionsAndVelocities(self.plant_context, np.concatenate([
            X_WB.rotation().ToQuaternion().wxyz(), X_WB.translation(), q,
            R @ nu[3:], R @ nu[:3], q_dot]))

    def fix(self, port, value):
        self.water.GetInputPort(port).FixValue(
            self.water.GetMyMutableContextFromRoot(self.context), np.asarray(value, dtype=float))

    def fix_current(self, current_I):
        self.fix("current", self.X_WI.rotation() @ np.asarray(current_I))

    def fix_force(self, f_B):
        """Applies a force and moment (6,) in vehicle axes about its origin."""
        R = self.pose_W().rotation().matrix()
        tau = np.zeros(self.nv)
        tau[:6] = np.concatenate([R @ f_B[3:], R @ f_B[:3]])
        self.fix("generalized_force", tau)

    def pose_W(self):
        return self.plant.GetBodyByName("vehicle").EvalPoseInWorld(self.plant_context)

    def v_dot(self):
        """Returns the plant's acceleration: v̇, or (v⁺ − v)/h of a discrete plant."""
        if self.plant.time_step() == 0.0:
            return self.diagram.EvalTimeDerivatives(self.context).CopyToVector()[-self.nv:]
        h = self.plant.time_step()
        simulator = Simulator(self.diagram, self.context.Clone())
        simulator.AdvanceTo(0.5 * h)  # The step from 0 to h is taken at 0.
        after = self.plant.GetMyContextFromRoot(simulator.get_context())
        return (self.plant.GetVelocities(after) - self.plant.GetVelocities(self.plant_context)) / h

    def solved(self):
        return self.water.GetOutputPort("acceleration").Eval(
            self.water.GetMyContextFromRoot(self.context))

    def nu(self):
        v = self.plant.GetVelocities(self.plant_context)
        R = self.pose_W().rotation().matrix()
        return np.concatenate([v[3:6] @ R, v[:3] @ R])

    def nu_dot(self):
        """Returns ν̇ of the vehicle: body-axes derivative of body-axes components."""
        v_dot, nu, R = self.v_dot(), self.nu(), self.pose_W().rotation().matrix()
        return np.concatenate([v_dot[3:6] @ R - np.cross(nu[3:], nu[:3]), v_dot[:3] @ R])

    def simulate(self, duration, accuracy=1e-10):
        """Returns times and v (T, nv) every 0.1 s."""
        simulator = Simulator(self.diagram, self.context)
        ResetIntegratorFromFlags(simulator, "runge_kutta5", 0.1)
        simulator.get_mutable_integrator().set_target_accuracy(accuracy)
        simulator.AdvanceTo(duration)
        log = self.log.FindLog(self.context)
        return log.sample_times(), log.data().T[:, -self.nv:]

    def kinetic_energy(self, parameters):
        energy = self.plant.CalcKineticEnergy(self.plant_context)
        for name, body in parameters.bodies.items():
            frame = self.plant.GetFrameByName(name)
            X_WB = frame.CalcPoseInWorld(self.plant_context)
            V = frame.CalcSpatialVelocityInWorld(self.plant_context)
            R = X_WB.rotation().matrix()
            for item in body.added_mass:
                v_P = V.translational() + np.cross(V.rotational(), R @ item.point)
                nu_P = np.concatenate([v_P @ R, V.rotational() @ R])
                energy += 0.5 * nu_P @ item.matrix @ nu_P
        return energy

    def potential_energy(self, parameters):
        energy = self.plant.CalcPotentialEnergy(self.plant_context)
        g_W = self.plant.gravity_field().gravity_vector()
        for name, body in parameters.bodies.items():
            p_WBb = self.plant.GetFrameByName(name).CalcPoseInWorld(
                self.plant_context) @ body.center_of_buoyancy
            energy += parameters.fluid_density * body.displaced_volume * g_W @ p_WBb
        return energy
