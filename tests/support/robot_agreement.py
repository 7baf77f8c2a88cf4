"""A loaded robot beside a reading of its files."""

import numpy as np

from support.robot_reading import Reading
from uvms_drake.model.robot import Robot
from uvms_drake.model.uvms_model import UvmsModel

FAR = 1e15
"""A limit that is none in the one format and infinite in the other."""


def differences(robot: Robot, reading: Reading) -> list[str]:
    """Returns what of the robot is not as its files say."""
    plant, instance, found = robot.uvms.plant, robot.uvms.model_instance, []

    def compare(what, left, right):
        left, right = (np.asarray(each, dtype=float) for each in (left, right))
        scale = 1.0 + np.max(np.abs(right), initial=0.0)
        if left.shape != right.shape or np.any(np.abs(left - right) > 1e-9 * scale):
            found.append(f"{what}: {left} loaded, {right} in the file")

    loaded = [plant.get_body(index) for index in plant.GetBodyIndices(instance)]
    if {body.name() for body in loaded} != set(reading.bodies):
        return [f"links {[body.name() for body in loaded]}"]
    for body in loaded:
        mass, com, inertia = reading.bodies[body.name()]
        M = body.default_spatial_inertia()
        compare(f"mass of {body.name()}", body.default_mass(), mass)
        if mass > 0.0:
            compare(f"centre of {body.name()}", body.default_com(), com)
            compare(f"inertia of {body.name()}", M.Shift(M.get_com()).CalcRotationalInertia(
                ).CopyToFullMatrix3(), inertia)
    water = robot.uvms.hydrodynamics
    compare("bodies in water", len(water.bodies), len(reading.added))
    for name, body in water.bodies.items():
        compare(f"buoyancy of {name}", [water.fluid_density * body.displaced_volume,
                                        *body.center_of_buoyancy], reading.buoyancy[name])
        total = np.zeros((6, 6))
        for item in body.added_mass:  # By unit velocities of the origin, one by one.
            M = np.asarray(item.matrix)
            M, p = np.diag(M) if M.ndim == 1 else M, np.asarray(item.point)
            H = np.array([[*(v[:3] + np.cross(v[3:], p)), *v[3:]] for v in np.eye(6)]).T
            total += H.T @ M @ H
        compare(f"added mass of {name}", 0.5 * (total + total.T), reading.added[name])
    model = UvmsModel(robot.uvms)
    names = [joint.name() for joint in robot.uvms.joints]
    if names != [row[0] for row in reading.joints]:
        return [*found, f"joints {names} loaded, {[row[0] for row in reading.joints]} in the file"]
    limits = np.array([row[1:3] for row in reading.joints]).reshape(-1, 2)
    compare("limits", np.clip(np.column_stack([model.q_lower, model.q_upper]), -FAR, FAR),
            np.clip(limits, -FAR, FAR))
    compare("damping", model.links.joint_damping, [row[3] for row in reading.joints])
    compare("motors", model.links.rotor_inertia, [row[4] for row in reading.joints])
    rng = np.random.default_rng(1)
    for q in (np.zeros(len(names)), rng.uniform(-1.0, 1.0, len(names))):
        at = model.kinematics(np.concatenate([np.zeros(6), q]))
        compare("tip", np.column_stack([at.R_BL[-1], at.p_BL[-1]]), reading.tip(q)[:3])
    thrusters = robot.uvms.thrusters
    if (thrusters is None) != (not reading.thrusters):
        return [*found, "thrusters"]
    for (name, item), (other, place, axis, kind) in zip(
            [] if thrusters is None else thrusters.thrusters.items(), reading.thrusters,
            strict=True):
        compare(f"thruster {name}", np.concatenate([item.position, item.axis / np.linalg.norm(
            item.axis)]), np.concatenate([place, axis]))
        if name != other:
            found.append(f"thruster {other} is {name}")
        known = thrusters.kinds[item.kind]
        compare(f"lag of {name}", known.lag, kind["lag"])
        for curve, data in zip(known.curves, kind["curves"], strict=True):
            compare(f"curve of {name}", np.array([curve.command, curve.force]),
                    np.array([data["command"], data["force"]], dtype=float))
    return found
