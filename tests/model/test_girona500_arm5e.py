"""Tests of the robot `girona500_arm5e`: its SDFormat file, its YAML file, and how they agree."""

import numpy as np
import pytest
from pydrake.math import RollPitchYaw
from support import dh

from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.uvms import Uvms
from uvms_drake.plant.surface import pose_and_jacobian

# Cylinders of the arm, typed again: radius, length, axis, centre in the body's frame [m].
CYLINDERS = {
    "arm_base": [(0.05, 0.15, 0, (-0.075, 0, 0))],
    "link1": [(0.05, 0.10, 0, (-0.05, 0, 0))],
    "link2": [(0.06, 0.26, 0, (-0.13, 0, 0))],
    "link3": [(0.045, 0.09, 0, (-0.045, 0, 0)), (0.045, 0.19, 2, (0, 0, 0.095))],
    "link4": [(0.037, 0.13, 2, (0, 0, -0.065))],
}
ARM = tuple(CYLINDERS)
ARM_DENSITY = 10.0 / 7.244e-3  # kg/m³: mass over volume of the datasheet
WATER = 1000.0  # kg/m³


def _context(uvms: Uvms, eta, q):
    context = uvms.plant.CreateDefaultContext()
    state = np.concatenate([eta, q, np.zeros(6 + len(uvms.joints))])
    uvms.plant.SetPositionsAndVelocities(context, Coordinates(uvms).to_drake(state))
    return context


def test_every_frame_is_where_the_papers_table_puts_it(uvms):
    for config in dh.random_configurations(seed=1, count=20):
        eta, q = config[:6], config[6:]
        context = _context(uvms, eta, q)
        for name, expected in dh.chain(dh.vehicle(eta), q).items():
            X_WF = uvms.plant.GetFrameByName(name).CalcPoseInWorld(context)
            np.testing.assert_allclose(X_WF.GetAsMatrix4(), expected, atol=1e-12, err_msg=name)


def test_joint_limits_are_the_papers(uvms):
    assert [joint.position_lower_limit() for joint in uvms.joints] == list(dh.LOWER)
    assert [joint.position_upper_limit() for joint in uvms.joints] == list(dh.UPPER)


@pytest.mark.parametrize("name", ARM)
def test_a_link_has_mass_centre_and_inertia_of_its_cylinders(uvms, name):
    volumes = [np.pi * r**2 * L for r, L, *_ in CYLINDERS[name]]
    centres = [np.array(centre, dtype=float) for *_, centre in CYLINDERS[name]]
    com = np.average(centres, axis=0, weights=volumes)
    inertia = np.zeros((3, 3))
    for (r, L, axis, _), volume, centre in zip(CYLINDERS[name], volumes, centres, strict=True):
        m = ARM_DENSITY * volume
        moments = np.full(3, m * (3 * r**2 + L**2) / 12)
        moments[axis] = m * r**2 / 2
        p = centre - com
        inertia += np.diag(moments) + m * (p @ p * np.eye(3) - np.outer(p, p))

    M = uvms.plant.GetBodyByName(name).default_spatial_inertia()
    assert M.get_mass() == pytest.approx(ARM_DENSITY * sum(volumes), rel=1e-3)
    np.testing.assert_allclose(M.get_com(), com, atol=1e-5)
    # Three figures are given of each entry.
    np.testing.assert_allclose(
        M.Shift(M.get_com()).CalcRotationalInertia().CopyToFullMatrix3(), inertia,
        rtol=6e-3, atol=1e-6)

    water = uvms.hydrodynamics.bodies[name]
    assert water.displaced_volume == pytest.approx(sum(volumes), rel=1e-3)
    np.testing.assert_array_equal(water.center_of_buoyancy, M.get_com())
    (added,) = water.added_mass
    np.testing.assert_array_equal(added.point, M.get_com())


@pytest.mark.parametrize("name", ARM)
def test_strips_of_drag_add_up_to_that_of_the_cylinders(uvms, name):
    """Across its axis, a cylinder has ½ ρ C_D 2r L with C_D = 1.1, spread over its length."""
    strips = uvms.hydrodynamics.bodies[name].drag
    assert len(strips) >= 3
    total = np.sum([strip.quadratic for strip in strips], axis=0)
    across = np.zeros(3)
    for r, L, axis, _ in CYLINDERS[name]:
        across += np.where(np.arange(3) == axis, 0.0, 0.5 * WATER * 1.1 * 2 * r * L)
    end_area = np.pi * max(r for r, *_ in CYLINDERS[name]) ** 2
    along = total[:3] - across
    assert np.all(along > -0.01)
    assert np.all(along <= 0.5 * WATER * 1.1 * end_area)
    np.testing.assert_array_equal(total[3:], 0.0)

    for strip in strips:
        inside = [np.abs(np.array(strip.point) - centre)[axis] < L / 2
                  and np.allclose(np.delete(np.array(strip.point) - centre, axis), 0.0)
                  for _, L, axis, centre in CYLINDERS[name]]
        assert any(inside), strip.point
    r, L, axis, centre = CYLINDERS[name][-1]
    stations = sorted(strip.point[axis] - centre[axis] for strip in strips[-3:])
    np.testing.assert_allclose(stations, [-L / 3, 0.0, L / 3], atol=1e-4)


def test_the_arm_weighs_what_its_datasheet_says(uvms):
    """10 kg in air and 2.75 kg in water."""
    mass = sum(uvms.plant.GetBodyByName(name).default_mass() for name in ARM)
    displaced = WATER * sum(uvms.hydrodynamics.bodies[name].displaced_volume for name in ARM)
    assert mass == pytest.approx(10.0, abs=1e-3)
    assert displaced == pytest.approx(7.24, abs=0.01)
    assert mass - displaced == pytest.approx(2.75, abs=0.01)


def test_the_plants_pose_and_jacobian_of_the_tip_are_the_chains(uvms):
    """χ by the paper's table to 1e-12, J_χ v by its five-point differences to 1e-9."""
    rng, coordinates, h = np.random.default_rng(4), Coordinates(uvms), 2e-3
    context = uvms.plant.CreateDefaultContext()
    for _ in range(10):
        config = np.concatenate([rng.uniform(-1.0, 1.0, 3), rng.uniform(-0.4, 0.4, 3),
                                 rng.uniform(dh.LOWER, dh.UPPER)])
        config[7:9] = [1.1, 0.47] + rng.uniform(-0.2, 0.2, 2)  # The tip is far from straight down.
        zeta = rng.normal(size=10)
        state = coordinates.to_drake(np.concatenate([config, zeta]))
        uvms.plant.SetPositionsAndVelocities(context, state)
        chi, J = pose_and_jacobian(uvms.plant, context, uvms.tip)
        np.testing.assert_allclose(chi, dh.chi(config), atol=1e-12)
        rate = np.concatenate([
            dh.vehicle(config)[:3, :3] @ zeta[:3],
            RollPitchYaw(config[3:6]).CalcRpyDtFromAngularVelocityInChild(zeta[3:6]), zeta[6:]])
        ahead, behind, far, back = (dh.chi(config + s * h * rate) for s in (1, -1, 2, -2))
        expected = (8.0 * (ahead - behind) - (far - back)) / (12.0 * h)
        np.testing.assert_allclose(J @ state[uvms.plant.num_positions():], expected, atol=1e-9)
