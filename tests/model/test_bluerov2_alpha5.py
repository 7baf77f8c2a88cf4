"""Tests of the robot `bluerov2_alpha5`: its files against the sources, and how they agree."""

import numpy as np
import pytest
from pydrake.geometry import Role
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder
from support.dh import rotation, translation

from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.trim import middle_posture, trim_of
from uvms_drake.model.uvms import Uvms, add_uvms
from uvms_drake.model.uvms_model import UvmsModel, read_uvms

ROBOT = "bluerov2_alpha5"
# The maker's table, standard Denavit-Hartenberg: d, a [m], alpha, offset of the angle [rad].
TABLE = ((0.0462, 0.020, np.pi / 2, np.pi), (0.0, 0.15071, np.pi, -np.arctan2(145.3, 40.0)),
         (0.0, 0.020, -np.pi / 2, -np.arctan2(145.3, 40.0)), (-0.180, 0.0, np.pi / 2, np.pi / 2))
ARM = ("arm_base", "shoulder", "upper_arm", "elbow", "wrist", "jaws")


@pytest.fixture(scope="module")
def uvms() -> Uvms:
    return read_uvms(ROBOT)


def chain(q: np.ndarray) -> list[np.ndarray]:
    """Returns the table's poses in the vehicle's frame (4, 4), of base and of links 1 to 4."""
    poses = [translation(0.203, 0.0, 0.1317)]  # FLU (0.203, 0, -0.1317), rolled by pi
    for (d, a, alpha, offset), angle in zip(TABLE, q, strict=True):
        poses.append(poses[-1] @ rotation("z", angle + offset) @ translation(0, 0, d)
                     @ translation(a, 0, 0) @ rotation("x", alpha))
    return poses


def test_the_tip_is_where_the_makers_table_puts_it(uvms):
    """0.04 m beyond the table's end along the jaws, which its last rotation turns to y."""
    model, rng = UvmsModel(uvms), np.random.default_rng(0)
    for q in rng.uniform(model.q_lower, model.q_upper, size=(20, 4)):
        kinematics = model.kinematics(np.concatenate([np.zeros(6), q]))
        end = chain(q)[-1]
        jaws = -end[:3, 1]  # z of the frame before alpha = pi/2 is y after it
        np.testing.assert_allclose(kinematics.p_BL[-1], end[:3, 3] + 0.04 * jaws, atol=1e-5)
        np.testing.assert_allclose(kinematics.R_BL[-1][:, 0], jaws, atol=1e-5)


def test_the_arm_weighs_what_its_maker_says(uvms):
    """About 1.4 kg in air and 0.9 kg in water."""
    masses = [uvms.plant.GetBodyByName(name).default_mass() for name in ARM]
    volumes = [uvms.hydrodynamics.bodies[name].displaced_volume for name in ARM]
    assert sum(masses) == pytest.approx(1.462)
    assert sum(masses) - 1000.0 * sum(volumes) == pytest.approx(0.839)


def test_it_floats_up_and_is_upright_in_every_posture(uvms):
    model, rng = UvmsModel(uvms), np.random.default_rng(1)
    for q in rng.uniform(model.q_lower, model.q_upper, size=(20, 4)):
        trim = trim_of(uvms, q)
        assert trim.displaced_mass - trim.mass == pytest.approx(0.010, abs=1e-6)
        assert trim.righting_lever > 0.01


def test_its_top_speed_is_near_the_makers(uvms):
    """1.5 m/s at the 130 N that four thrusters give ahead, two of them backwards."""
    model = UvmsModel(uvms)
    thrusters = ThrusterModel.of(uvms.thrusters)
    surge = np.where(thrusters.B[0] > 0.0, thrusters.upper, thrusters.lower) @ thrusters.B[0]
    assert surge == pytest.approx(129.2, abs=0.2)
    config = np.concatenate([np.zeros(6), middle_posture(uvms)])
    speeds = np.linspace(1.0, 2.0, 201)
    zeta = np.outer(speeds, np.eye(10)[0])
    kinematics = model.kinematics(np.tile(config, (len(speeds), 1)))
    force = model.inverse_dynamics(kinematics, zeta, 0.0 * zeta)[:, 0]
    assert speeds[np.argmin(np.abs(force - surge))] == pytest.approx(1.6, abs=0.12)


def test_thrusters_drive_every_axis_and_are_drawn_where_they_push(uvms):
    thrusters = uvms.thrusters
    assert ThrusterModel.of(thrusters).driven.tolist() == list(range(6))
    plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), time_step=0.0)
    drawn = add_uvms(plant, ROBOT)
    plant.Finalize()
    inspector = scene_graph.model_inspector()
    ducts = {}
    for shape in inspector.GetGeometries(
            plant.GetBodyFrameIdOrThrow(drawn.vehicle.index()), Role.kIllustration):
        name = inspector.GetName(shape).split("::")[-1]
        if name.endswith("_duct"):
            ducts[name.removesuffix("_duct")] = inspector.GetPoseInFrame(shape)
    assert set(ducts) == set(thrusters.thrusters)
    for name, thruster in thrusters.thrusters.items():
        np.testing.assert_allclose(ducts[name].translation(), thruster.position, atol=1e-9)
        along = ducts[name].rotation().matrix()[:, 2] @ thruster.axis
        assert abs(along) == pytest.approx(1.0, abs=1e-4)
