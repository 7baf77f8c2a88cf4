"""Tests of `uvms_drake.control.limits.static_force`."""

from types import SimpleNamespace

import numpy as np
import pytest

from uvms_drake.control.limits import TubeRadii, tighten
from uvms_drake.control.limits.static_force import StaticForce
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.surface.spring import BilateralSpring

SPRING = check_surface(BilateralSpring(
    stiffness=np.diag([900.0, 400.0, 300.0, 9.0, 8.0, 7.0]) + np.array(
        [[0, 50, 0, 20, 0, 5], [50, 0, 0, 0, 10, 0], [0, 0, 0, 0, 0, 0],
         [20, 0, 0, 0, 0, 0], [0, 10, 0, 0, 0, 0], [5, 0, 0, 0, 0, 0]]),
    equilibrium=np.array([0.3, -0.2, 1.1, 0.1, -0.2, 0.4])))
PLANE = check_surface(UnilateralPlane(
    point=np.array([0.3, -0.2, 1.1]), normal=np.array([-0.6, 0.0, 0.8]), stiffness=830.0))
TUBE = TubeRadii(position=0.002, orientation=0.01)


def tightened(bound: float, surface, tube: TubeRadii = TUBE) -> StaticForce:
    return tighten({"static_force": StaticForce(bound, surface)}, tube)["static_force"]


@pytest.mark.parametrize("surface", [SPRING, PLANE], ids=["spring", "plane"])
def test_what_the_tube_leaves_of_the_force_keeps_its_limit_and_no_less_would_do(surface):
    """At 4000 poses of just the nominal force, each off by a deviation of the tube."""
    limit = 40.0
    bound = tightened(limit, surface).upper[0]
    rng = np.random.default_rng(0)
    nominal = np.concatenate([rng.normal(size=(4000, 3)), 0.02 * rng.normal(size=(4000, 3))], 1)
    if surface is SPRING:
        turned = np.zeros((4000, 6))
        turned[:, 3:] = nominal[:, 3:]
        direction = nominal[:, :3] / np.linalg.norm(nominal[:, :3], axis=1)[:, None]
        missing = bound * direction - (turned @ surface.stiffness)[:, :3]
        nominal[:, :3] = np.linalg.solve(surface.stiffness[:3, :3], missing.T).T
        nominal += surface.equilibrium
    else:
        along = nominal[:, :3] @ surface.normal + surface.penetration_for(bound)
        nominal[:, :3] += surface.point - along[:, None] * surface.normal
    np.testing.assert_allclose(surface.static_force(nominal), bound)
    off = [radius * step / np.linalg.norm(step, axis=1)[:, None] for radius, step in (
        (TUBE.position, rng.normal(size=(4000, 3))),
        (TUBE.orientation, rng.normal(size=(4000, 3))))]
    worst = np.max(surface.static_force(nominal + np.concatenate(off, axis=1)))
    assert bound + 0.8 * (limit - bound) < worst <= limit + 1e-9


@pytest.mark.parametrize(("surface", "stiffness"), [
    (PLANE, 830.0), (SPRING, np.linalg.norm(SPRING.stiffness[:3, :3], 2))], ids=["plane", "spring"])
def test_an_excess_is_a_depth(surface, stiffness):
    limit = StaticForce(20.0, surface)
    at = SimpleNamespace(y=np.array([[0.33, -0.25, 1.02, 0.1, -0.2, 0.4, 0.0]]))
    force = surface.static_force(at.y[:, :6])[0]
    assert force > 20.0
    assert limit.excess(at)[0, 0] == pytest.approx((force - 20.0) / stiffness)


@pytest.mark.parametrize("surface", [SPRING, PLANE], ids=["spring", "plane"])
def test_the_convex_program_has_the_same_limit_as_an_evaluation(surface):
    """On poses about the limit: a row or a cone is broken where the values are above the bound."""
    limit = StaticForce(20.0, surface)
    rng = np.random.default_rng(1)
    y = np.concatenate([surface.equilibrium if surface is SPRING else np.append(
        surface.point, [0.1, -0.2, 0.4]), [0.0]]) + rng.normal(size=(500, 7)) * 0.04
    at = SimpleNamespace(y=y, model=SimpleNamespace(size=7))
    cone = limit.cone(at)
    if surface is SPRING:
        broken = np.linalg.norm(cone.value, axis=1) > cone.bound
        np.testing.assert_allclose(
            cone.value[1] - cone.value[0], cone.slopes.y @ (y[1] - y[0]), atol=1e-12)
    else:
        assert cone is None
        value, slopes = limit.row_values(at), limit.row_slopes(at)
        broken = value[:, 0] > limit.row_bounds(at)[1][0]
        np.testing.assert_allclose(
            value[1] - value[0], slopes.y @ (y[1] - y[0]), atol=1e-12)
    np.testing.assert_array_equal(broken, limit.values(at)[:, 0] > 20.0)
    assert 50 < np.sum(broken) < 450
