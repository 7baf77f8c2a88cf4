"""Claims of a `UnknownContact` against walls of its class."""

import numpy as np
import pytest

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.surface import UnilateralPlane
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.unknown_contact import UnknownContact, UnknownSurface

CONTACT = UnknownContact(direction=np.array([0.0, 0.6, 0.8]), angle=0.2, stiffness=800.0,
                        force=40.0, dissipation=3.0, friction=0.4)


def wall(rng: np.random.Generator) -> tuple[UnilateralPlane, np.ndarray]:
    """Returns a plane whose inward normal is within the angle, and that normal."""
    n, across = CONTACT.direction, rng.normal(size=3)
    across -= n * (n @ across)
    across /= np.linalg.norm(across)
    angle = CONTACT.angle * rng.uniform()
    inward = np.cos(angle) * n + np.sin(angle) * across
    plane = UnilateralPlane(point=rng.normal(size=3), normal=-inward,
                            stiffness=CONTACT.stiffness * rng.uniform(0.1, 1.0),
                            dissipation=CONTACT.dissipation * rng.uniform())
    return plane.checked(), inward


def at(points: np.ndarray) -> np.ndarray:
    """Returns poses χ (m, 6) at points (m, 3)."""
    return np.concatenate([points, np.zeros((len(points), 3))], axis=1)


def test_tilted_planes_are_of_the_class():
    rng, n = np.random.default_rng(1), CONTACT.direction
    for _ in range(50):
        plane, _ = wall(rng)
        points = plane.point + rng.normal(size=(200, 3)) * 0.02
        others = points + rng.normal(size=points.shape) * 0.02
        moved = others - points
        across = np.linalg.norm(moved - np.outer(moved @ n, n), axis=1)
        rise = np.maximum(moved @ n + np.tan(CONTACT.angle) * across, 0.0)
        assert np.all(plane.static_force(at(others)) <= plane.static_force(at(points))
                      + CONTACT.stiffness * rise + 1e-9)


def test_the_force_changes_by_no_more_than_the_slope_times_the_way_and_nearly_so():
    """The steepest direction of (1) is at the angle α from n."""
    n, alpha = CONTACT.direction, CONTACT.angle
    across = np.array([1.0, 0.0, 0.0])
    steepest = np.cos(alpha) * n + np.sin(alpha) * across
    by_class = steepest @ n + np.tan(alpha) * (steepest @ across)
    assert CONTACT.slope == pytest.approx(CONTACT.stiffness * by_class, rel=1e-12)


def test_no_tip_within_the_speeds_goes_deeper_faster():
    rng, walls = np.random.default_rng(2), CONTACT.walls
    most = np.array([CONTACT.speed, CONTACT.speed_across, CONTACT.speed_across])
    velocity = rng.uniform(-most, most, (20_000, 3)) @ walls.axes
    corner = most @ walls.axes
    assert np.max(walls.advance(velocity)) <= CONTACT.largest_advance
    assert walls.advance(corner) == pytest.approx(CONTACT.largest_advance)


def test_a_model_of_it_is_free_water_and_passes_the_check_of_surfaces():
    controller_surface = UnknownSurface(CONTACT)
    surface = check_surface(controller_surface)
    chi = np.random.default_rng(4).normal(size=(5, 6))
    assert not surface.exerts_force
    assert not surface.force(chi, chi).any()
    assert surface.stiffness_bound == CONTACT.slope


def test_a_task_presses_along_the_direction_and_less_than_the_largest_force():
    controller_surface, pose = UnknownSurface(CONTACT), np.arange(6.0)
    assert controller_surface.pose_for(CONTACT.wrench(20.0), pose) == pytest.approx(pose)
    for force in (CONTACT.wrench(-1.0), CONTACT.wrench(40.0), np.array([5.0, 0, 0, 0, 0, 0])):
        with pytest.raises(InvalidParameter, match="force"):
            controller_surface.pose_for(force, pose)
    with pytest.raises(InvalidParameter, match="pose"):
        controller_surface.pose_for(CONTACT.wrench(20.0), None)
