"""The controller presses on a wall in MuJoCo: its rigid bodies, integrator and contact, not ours.

MuJoCo gets masses, inertias and joints from the robot's file. Of the water, whose coefficients are
in the robot's folder, the added mass is put into MuJoCo's mass matrix between its two half steps,
and buoyancy, drag and the added mass's Coriolis force are applied forces. The controller gets the
pose, the velocity, and the force of MuJoCo's own force sensor at the tool, with the lag and the
noise that the scenario declares of it.

    python examples/your_loop/in_mujoco.py [--robot bluerov2_alpha5] [--stiffer 2] [--off 0.05]
"""

import argparse
import json
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from pydrake.math import RigidTransform, RotationMatrix

import uvms_drake as uv
from uvms_drake.model.description.hydrodynamics_file import added_mass_about_origin
from uvms_drake.model.frames.euler import euler_angles, rotation_matrix
from uvms_drake.model.frames.spatial import cross_force

SCENARIOS = {"girona500_arm5e": "girona500_contact", "bluerov2_alpha5": "bluerov2_contact"}
PERIODS = {"girona500_contact": 0.01, "bluerov2_contact": 0.005}  # s, of the loop
STEP = 0.001  # s, of MuJoCo
BALL = 0.02  # m, radius of the tool's tip
IMPEDANCE = 0.5  # of MuJoCo's soft contact


class Water(NamedTuple):
    """Water of a body, in axes of the body about its origin."""

    body: int
    added: np.ndarray
    lift: np.ndarray  # displaced mass [kg], and its moment [kg m] (4,)
    drag: list[tuple[np.ndarray, np.ndarray, np.ndarray]]  # point, linear, quadratic


def numbers(values: np.ndarray) -> str:
    """Returns numbers as an attribute of MJCF."""
    return " ".join(f"{value:.12g}" for value in np.ravel(values))


def placed(X: RigidTransform) -> str:
    """Returns a pose as attributes of MJCF."""
    return f'pos="{numbers(X.translation())}" quat="{numbers(X.rotation().ToQuaternion().wxyz())}"'


def mjcf(uvms: uv.UvmsModel, wall: np.ndarray, normal: np.ndarray, friction: float) -> str:
    """Returns a robot and a wall as MJCF; the world is NED, as ours."""
    plant, context = uvms.plant, uvms.plant.CreateDefaultContext()
    inside = {joint.child_body().index(): joint for joint in uvms.joints}
    bodies = [plant.get_body(i) for i in plant.GetBodyIndices(uvms.model_instance)]

    def element(body, parent) -> str:
        """Returns a body with those that are fixed to it or hang on it."""
        joint, inner = inside.get(body.index()), ""
        if body is uvms.vehicle:
            X_PC, inner = RigidTransform(), "<freejoint/>"
        elif joint is not None:
            X_CM = joint.frame_on_child().GetFixedPoseInBodyFrame()
            X_PC = joint.frame_on_parent().GetFixedPoseInBodyFrame() @ X_CM.inverse()
            axis = X_CM.rotation() @ joint.revolute_axis()
            motor = uvms.motor(joint)
            rotor = 0.0 if motor is None else (
                motor.default_gear_ratio() ** 2 * motor.default_rotor_inertia())
            inner = (f'<joint name="{joint.name()}" axis="{numbers(axis)}" pos="'
                     f'{numbers(X_CM.translation())}" damping="{joint.default_damping()}" '
                     f'armature="{rotor}"/>')
        else:
            X_PC = plant.CalcRelativeTransform(context, parent.body_frame(), body.body_frame())
        if body.default_mass() > 0.0:
            M = body.default_spatial_inertia()
            J = M.Shift(M.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
            inner += (f'<inertial mass="{M.get_mass():.12g}" pos="{numbers(M.get_com())}" '
                      f'fullinertia="{numbers(J[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])}"/>')
        if body.index() == uvms.tip.body().index():  # The tool behind the force sensor.
            inner += (f'<body name="tool" {placed(uvms.tip.GetFixedPoseInBodyFrame())}>'
                      '<site name="sensor"/><inertial mass="0.001" pos="0 0 0" '
                      f'diaginertia="1e-7 1e-7 1e-7"/><geom size="{BALL}" friction="{friction}" '
                      'condim="3"/></body>')
        inner += "".join(element(child, body) for child in children(body))
        return f'<body name="{body.name()}" {placed(X_PC)}>{inner}</body>'

    def children(body) -> list:
        """Returns the bodies that a joint or a weld joins to a body from outside."""
        ends = {plant.get_joint(i).child_body().index(): plant.get_joint(i).parent_body().index()
                for i in plant.GetJointIndices(uvms.model_instance)}
        return [each for each in bodies if ends.get(each.index()) == body.index()]

    # The surface is a ball's radius behind the wall, so that it is touched by the tip as a point.
    z = -normal
    x = np.cross([0.0, 1.0, 0.0], z)
    R = np.column_stack([x / np.linalg.norm(x), np.cross(z, x / np.linalg.norm(x)), z])
    X = RigidTransform(RotationMatrix(R @ np.diag([1.0, -1.0, -1.0])), wall - BALL * normal)
    return f"""<mujoco><compiler angle="radian" autolimits="false" inertiafromgeom="false"/>
        <option gravity="0 0 9.81" timestep="{STEP}" cone="elliptic">
        <flag energy="enable"/></option>
        <worldbody><geom name="wall" type="plane" size="2 2 0.1" {placed(X)}
        friction="{friction}"/>{element(uvms.vehicle, None)}</worldbody>
        <sensor><force site="sensor"/><torque site="sensor"/></sensor></mujoco>"""


class MujocoRobot:
    """A robot of ours in MuJoCo, in water, before a wall.

    Args:
        scenario: Its robot, start and wall.
        stiffness: Of the wall [N/m].
        wall: A point of the wall [m].
    """

    def __init__(self, scenario: uv.Scenario, stiffness: float, wall: np.ndarray):
        uvms = uv.read_uvms(scenario.model)
        surface = scenario.surface
        self.normal = np.asarray(surface.geometry.normal)
        self.model = m = mujoco.MjModel.from_xml_string(
            mjcf(uvms, wall, self.normal, surface.friction))
        self.data = d = mujoco.MjData(m)
        self.water = [Water(
            mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, name),
            added_mass_about_origin(water.added_mass),
            uvms.hydrodynamics.fluid_density * water.displaced_volume * np.append(
                1.0, water.center_of_buoyancy),
            [(np.asarray(drag.point), np.asarray(drag.linear), np.asarray(drag.quadratic))
             for drag in water.drag]) for name, water in uvms.hydrodynamics.bodies.items()]
        self.tool = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_BODY, "tool")
        self._set_contact(stiffness, surface.dissipation * scenario.task.force[0])
        # At rest at the start.
        eta, self.joints = np.asarray(scenario.start.eta), len(uvms.joints)
        d.qpos[:3] = eta[:3]
        mujoco.mju_mat2Quat(d.qpos[3:7], rotation_matrix(eta[3:]).ravel())
        d.qpos[7:] = scenario.start.q
        self.tau, self._J_last = np.zeros(6 + self.joints), None
        self.work = self.traffic = 0.0
        self.lag, self.reading = scenario.sensing[0].lag, np.zeros(3)
        mujoco.mj_forward(m, d)

    def _set_contact(self, stiffness: float, damping: float) -> None:
        """Makes the contact a spring with a damper: R f = d k r + b ṙ with R = A (1 − d)/d.

        So d k = K R, b = C R; MuJoCo's settings are −d² k and −d b. The damping C is that of our
        wall at the desired force.
        """
        m = self.model
        A = m.body_invweight0[self.tool, 0]
        R = A * (1.0 - IMPEDANCE) / IMPEDANCE
        for i in range(m.ngeom):
            m.geom_solref[i] = -stiffness * R * IMPEDANCE, -damping * R * IMPEDANCE
            m.geom_solimp[i] = IMPEDANCE, IMPEDANCE, 0.001, 0.5, 2.0

    def step(self) -> None:
        """Advances MuJoCo by a step, with τ and the water."""
        m, d = self.model, self.data
        mujoco.mj_step1(m, d)
        R = d.xmat[1].reshape(3, 3)
        thrust = np.concatenate([R @ self.tau[:3], self.tau[3:]])
        water, M_A, J = np.zeros(m.nv), np.zeros((m.nv, m.nv)), []
        for i, of in enumerate(self.water):
            J.append(self._jacobian(of.body))
            nu, R_b = J[i] @ d.qvel, d.xmat[of.body].reshape(3, 3)
            drift = np.zeros(6) if self._J_last is None else (
                (J[i] - self._J_last[i]) / STEP @ d.qvel)
            force = -(of.added @ drift + cross_force(nu, of.added @ nu))
            up = R_b.T @ np.array([0.0, 0.0, -9.81])
            force += np.concatenate([of.lift[0] * up, np.cross(of.lift[1:], up)])
            for point, linear, quadratic in of.drag:
                at = nu + np.append(np.cross(nu[3:], point), np.zeros(3))
                drag = -(linear + quadratic * np.abs(at)) * at
                force += drag + np.append(np.zeros(3), np.cross(point, drag[:3]))
            water += J[i].T @ force
            M_A += J[i].T @ of.added @ J[i]
        self._J_last = J
        before = self.energy(M_A)
        d.qfrc_applied[:] = thrust + water
        self._add_to_mass(M_A)
        mujoco.mj_factorM(m, d)
        mujoco.mj_projectConstraint(m, d)
        speed = d.qvel.copy()
        mujoco.mj_step2(m, d)
        # Work of all forces but gravity, of which MuJoCo has the potential.
        power = (thrust + water + d.qfrc_constraint + d.qfrc_passive) @ (0.5 * (speed + d.qvel))
        self.work += STEP * power
        self.traffic += STEP * abs(power)
        self.reading = self.reading + STEP / self.lag * (self.sensed_force() - self.reading)
        self.stored = before

    def _jacobian(self, body: int) -> np.ndarray:
        """Returns J (6, nv) of a body's origin, in axes of the body."""
        linear, angular = np.zeros((3, self.model.nv)), np.zeros((3, self.model.nv))
        mujoco.mj_jacBody(self.model, self.data, linear, angular, body)
        R = self.data.xmat[body].reshape(3, 3)
        return np.vstack([R.T @ linear, R.T @ angular])

    def _add_to_mass(self, M_A: np.ndarray) -> None:
        m = self.model
        for i in range(m.nv):
            entries = slice(m.M_rowadr[i], m.M_rowadr[i] + m.M_rownnz[i])
            self.data.M[entries] += M_A[i, m.M_colind[entries]]

    def energy(self, M_A: np.ndarray) -> float:
        """Returns MuJoCo's potential and kinetic energy, and that of the added mass [J]."""
        v = self.data.qvel
        return float(np.sum(self.data.energy) + 0.5 * v @ M_A @ v)

    def state(self) -> np.ndarray:
        """Returns (𝔮, ζ): the pose as a navigation gives it."""
        d, R = self.data, np.zeros(9)
        mujoco.mju_quat2Mat(R, d.qpos[3:7])
        R = R.reshape(3, 3)
        return np.concatenate([d.qpos[:3], euler_angles(R), d.qpos[7:], R.T @ d.qvel[:3],
                               d.qvel[3:]])

    def contact_force(self) -> np.ndarray:
        """Returns the force of the contacts on the wall (3,) in the world [N], by the solver."""
        total, one = np.zeros(3), np.zeros(6)
        for i, contact in enumerate(self.data.contact):
            mujoco.mj_contactForce(self.model, self.data, i, one)
            total += contact.frame.reshape(3, 3).T @ one[:3]
        return total if total @ self.normal < 0.0 else -total

    def sensed_force(self) -> np.ndarray:
        """Returns the force on the wall (3,) in the world [N], by MuJoCo's force sensor."""
        R = self.data.site_xmat[0].reshape(3, 3)
        return R @ self.data.sensordata[:3]


def press(robot: str, duration: float, stiffer: float = 1.0, off: float = 0.0, seed: int = 0
          ) -> dict[str, np.ndarray]:
    """Returns time, forces, states and energy of a press in MuJoCo, a row for each tick."""
    name = SCENARIOS[robot]
    scenario = uv.load_scenario(name)
    n = np.asarray(scenario.contact.direction)
    wall = np.asarray(scenario.surface.geometry.point) + off * n
    mj = MujocoRobot(scenario, stiffer * scenario.surface.law.stiffness, wall)
    controller = uv.Controller(scenario, period=PERIODS[name])
    noise = np.asarray(scenario.sensing[0].noise)[:3]
    rng, rows = np.random.default_rng(seed), []
    controller.reset(mj.state())
    tare = mj.reading = mj.sensed_force()
    for k in range(round(duration / controller.period)):
        force = np.append(mj.reading - tare + noise * rng.standard_normal(3), np.zeros(3))
        command = controller.step(k * controller.period, mj.state(), force)
        mj.tau = command.tau
        for _ in range(round(controller.period / STEP)):
            mj.step()
        rows.append([k * controller.period, mj.contact_force() @ n,
                     (mj.sensed_force() - tare) @ n, mj.stored, mj.work, mj.traffic,
                     len(command.alarms), *mj.state()])
    names = ("time", "force", "sensed", "energy", "work", "traffic", "alarms")
    table = np.array(rows)
    return {name: table[:, i] for i, name in enumerate(names)} | {"state": table[:, len(names):]}


def main() -> None:
    """Presses, and prints force, sensors and energy."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robot", choices=SCENARIOS, default="girona500_arm5e")
    parser.add_argument("--duration", type=float, default=24.0, help="simulated time [s]")
    parser.add_argument("--stiffer", type=float, default=1.0, help="factor of the wall's stiffness")
    parser.add_argument("--off", type=float, default=0.0, help="shift of the wall [m]")
    parser.add_argument("--save", type=Path, help="file for the rows (JSON)")
    arguments = parser.parse_args()
    run = press(arguments.robot, arguments.duration, arguments.stiffer, arguments.off)
    late = run["time"] > run["time"][-1] - 3.0
    print(f"force over the last 3 s: {np.mean(run['force'][late]):.2f} N, "
          f"{np.min(run['force'][late]):.2f} to {np.max(run['force'][late]):.2f} N, "
          f"largest {np.max(run['force']):.2f} N")
    print(f"force sensor less solver: {np.max(np.abs(run['sensed'] - run['force'])):.3f} N at most")
    change = run["energy"] - run["energy"][0]
    print(f"energy less work: {np.max(np.abs(change - run['work'])):.3g} J, of "
          f"{run['traffic'][-1]:.3g} J")
    if arguments.save:
        arguments.save.write_text(json.dumps({k: v.tolist() for k, v in run.items()}))


if __name__ == "__main__":
    main()
