"""Tests of `uvms_drake.campaign.certified_surfaces`."""


import numpy as np
import pytest
from pydrake.math import RotationMatrix
from support.campaigns import CLOSE, WALLS

from uvms_drake.campaign.certified_surfaces import moved
from uvms_drake.certificate.certify import certified_once
from uvms_drake.station.scenario.scenario import dump_scenario, load_scenario
from uvms_drake.station.simulation import simulate

pytestmark = pytest.mark.long


def test_another_place_makes_no_difference():
    """Rotated and translated, the same run: forces turn along, deviations do not change."""
    scenario = load_scenario("girona500_ideal", [
        "duration=1.2", CLOSE[1], "current=[0.02, 0.01, 0]", "surface_error.stiffness=1.02",
        "surface_error.shift=[0.001, 0, 0]", "surface_error.turn=[0, 0.01, 0.01]"])
    yaw = 2.2
    here, there = simulate(scenario), simulate(moved(scenario, yaw, np.array([3.0, -8.0, 5.0])))
    assert np.max(here.penetration) > 0.002
    R = RotationMatrix.MakeZRotation(yaw).matrix()
    np.testing.assert_allclose(there.force[:, :3], here.force[:, :3] @ R.T, atol=2e-4)
    np.testing.assert_allclose(there.tube_deviation, here.tube_deviation, atol=1e-6)
    np.testing.assert_allclose(there.u, here.u, atol=1e-4)


def test_another_place_of_a_spring_makes_no_difference():
    scenario = load_scenario("girona500_bilateral", ["duration=0.4"])
    yaw = -1.3
    here, there = simulate(scenario), simulate(moved(scenario, yaw, np.array([1.0, 2.0, -3.0])))
    R = RotationMatrix.MakeZRotation(yaw).matrix()
    np.testing.assert_allclose(there.force[:, :3], here.force[:, :3] @ R.T, atol=2e-4)
    np.testing.assert_allclose(there.force[:, 3:], here.force[:, 3:], atol=2e-4)
    np.testing.assert_allclose(there.tube_deviation, here.tube_deviation, atol=1e-6)


def test_surfaces_have_certificates_of_their_own(certified):
    """A stiffer one turns the same deviation into more force; a tilted one is pressed as hard."""
    declared = {(certified.walls[target.wall].stiffness, certified.walls[target.wall].tilt):
                certified.declared(target) for target in certified.targets}
    assert set(declared) == {(1.0, 0.0), *WALLS}
    own = declared[1.0, 0.0]
    assert dump_scenario(own) == dump_scenario(certified.base)
    for (stiffness, tilt), scenario in declared.items():
        assert scenario.tube.e == pytest.approx(own.tube.e, rel=0.02)  # J_x over another set.
        assert scenario.surface.stiffness == pytest.approx(stiffness * own.surface.stiffness)
        normal, force = np.asarray(scenario.surface.normal), np.asarray(scenario.task.force)
        np.testing.assert_allclose(force[:3], -20.0 * normal, atol=1e-9)
        assert np.arccos(normal @ own.surface.normal) == pytest.approx(abs(tilt), abs=1e-7)
        certificate = certified_once(scenario, progress=lambda *_: pytest.fail("not this one"))
        assert certificate.certified
        assert dump_scenario(certificate.applied_to(scenario)) == dump_scenario(scenario)
    joints = [np.max(declared[stiffness, 0.0].tube.u[7:9]) for stiffness in (1.0, 1.25)]
    assert joints == sorted(joints)
    assert len({target.factor for target in certified.targets}) == 4
