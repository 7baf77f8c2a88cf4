"""The plane as a function of χ and χ̇."""

import numpy as np
import pytest
from support.surfaces import (
    AT_REST,
    DISSIPATION,
    NORMALS,
    STIFFNESS,
    TRANSITION,
    moving,
    plane,
    tip_at,
)

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.surface.contact_laws import dissipation_factor, plane_load


@pytest.mark.parametrize(("rate", "factor"), [
    (0.3, 1.0 + DISSIPATION * 0.3), (-0.3, 1.0 / (1.0 + DISSIPATION * 0.3))])
def test_the_plane_is_harder_on_the_way_in_and_softer_on_the_way_out(rate, factor):
    law, chi = plane(), tip_at(plane(), 0.02)
    np.testing.assert_allclose(
        law.force(chi, moving(law, rate)), factor * law.force(chi, AT_REST), rtol=1e-12)


def test_the_plane_never_pulls_whatever_the_pose_and_speed():
    law, rng = plane(), np.random.default_rng(2)
    for depth, rate in zip(rng.uniform(-0.02, 0.1, 2000), rng.normal(scale=20.0, size=2000),
                           strict=True):
        chi = tip_at(law, depth, rng)
        force = law.force(chi, moving(law, rate))
        assert force[:3] @ law.normal <= 0.0
        np.testing.assert_allclose(np.cross(force[:3], law.normal), 0.0, atol=1e-9)
        np.testing.assert_array_equal(force[3:], 0.0)


@pytest.mark.parametrize("depth", [0.0, TRANSITION])
def test_the_load_and_its_slope_are_continuous(depth):
    h = 1e-7
    left, at, right = plane_load(depth + h * np.array([-1.0, 0.0, 1.0]), TRANSITION)
    slope = 0.0 if depth == 0.0 else 1.0
    np.testing.assert_allclose([(at - left) / h, (right - at) / h], slope, atol=1e-6)


def test_the_dissipation_factor_is_positive_and_its_slope_continuous():
    h = 1e-7
    left, at, right = dissipation_factor(h * np.array([-1.0, 0.0, 1.0]))
    np.testing.assert_allclose([at, (at - left) / h, (right - at) / h], 1.0, atol=1e-6)
    assert np.all(dissipation_factor(np.linspace(-1e6, 1e6, 1001)) > 0.0)


@pytest.mark.parametrize(("depth", "rate"), [(0.0, 0.4), (TRANSITION, -0.4), (0.02, 0.0)])
def test_the_force_is_continuously_differentiable_at_every_seam(depth, rate):
    """The derivative along (χ, χ̇) is the same a little before and a little after the seam."""
    law, step, h = plane(), 1e-7, 1e-20
    chi, chi_dot = tip_at(law, depth), moving(law, rate)
    direction = np.append(-law.normal, [0.3, 0.2, 0.1])

    def derivative(s):
        x = (s + 1j * h) * direction
        return np.imag(law.force(chi + x, chi_dot + x)) / h

    scale = STIFFNESS * (1.0 + DISSIPATION)
    np.testing.assert_allclose(derivative(step), derivative(-step), atol=1e-3 * scale)


def test_the_depth_for_a_force_is_where_the_plane_carries_it():
    law = plane()
    for magnitude in (0.5 * STIFFNESS * TRANSITION, 2.0, 30.0):
        pose = tip_at(law, law.penetration_for(magnitude))
        assert law.static_force(pose) == pytest.approx(magnitude, rel=1e-12)
    with pytest.raises(InvalidParameter, match=r"at least 1\.245 N"):
        law.penetration_for(1.2)


def test_the_plane_rests_at_the_pose_for_a_force_with_everything_else_as_given():
    law, pose = plane(), tip_at(plane(), -0.3, np.random.default_rng(6))
    force = np.append(-20.0 * law.normal, np.zeros(3))
    chi = law.pose_for(force, pose)
    np.testing.assert_allclose(law.force(chi, AT_REST), force, atol=1e-10)
    np.testing.assert_array_equal(chi[3:], pose[3:])
    np.testing.assert_allclose(np.cross(chi[:3] - pose[:3], law.normal), 0.0, atol=1e-14)


@pytest.mark.parametrize(("force", "pose", "message"), [
    (np.append(20.0 * NORMALS[1], np.zeros(3)), np.zeros(6),
     r"^force = .*: must be −F·normal with F ≥ 1\.245 N and no torque: a plane can only push$"),
    (np.append(-20.0 * NORMALS[1], [0, 0, 1.0]), np.zeros(6), r"^force = .*can only push$"),
    (np.append(-20.0 * NORMALS[1], np.zeros(3)), None,
     r"^pose = None: must be given: a plane leaves five coordinates free$"),
])
def test_a_plane_says_which_forces_it_cannot_carry(force, pose, message):
    with pytest.raises(InvalidParameter, match=message):
        plane().pose_for(force, pose)
