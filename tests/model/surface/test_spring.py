"""The paper's spring as a function of χ."""

import numpy as np
import pytest
from support.surfaces import (
    AT_REST,
    NORMALS,
    STIFFNESS,
    TRANSITION,
    plane,
    spring,
    stiffness_matrix,
    tip_at,
    work,
)

from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.spring import BilateralSpring


def test_the_spring_pulls_and_pushes_by_k_times_its_stretch():
    law = spring()
    stretch = np.array([0.02, -0.01, 0.03, 0.1, -0.2, 0.05])
    for sign in (1.0, -1.0):
        np.testing.assert_allclose(
            law.force(law.equilibrium + sign * stretch, AT_REST),
            sign * stiffness_matrix() @ stretch, rtol=1e-12)


def test_the_spring_does_no_work_around_a_closed_path():
    assert work(spring()) == pytest.approx(0.0, abs=1e-12)


def test_the_spring_does_not_jump_where_an_euler_angle_does():
    """Angles a little below π and a little above −π are the same attitude but for a little."""
    equilibrium = np.array([0.0, 0.0, 0.0, np.pi, 0.0, -np.pi + 0.01])
    law = check_surface(BilateralSpring(stiffness_matrix(), equilibrium))
    chi = np.array([0.0, 0.0, 0.0, -np.pi + 0.02, 0.0, np.pi - 0.01])
    np.testing.assert_allclose(
        law.force(chi, AT_REST), stiffness_matrix() @ [0, 0, 0, 0.02, 0, -0.02], atol=1e-12)


@pytest.mark.parametrize("normal", NORMALS)
def test_past_the_transition_the_plane_is_a_spring(normal):
    law, depth = plane(normal), 0.02
    magnitude = STIFFNESS * (depth - 0.5 * TRANSITION)
    np.testing.assert_allclose(
        law.force(tip_at(law, depth), AT_REST), np.append(-magnitude * normal, np.zeros(3)),
        atol=1e-11)
