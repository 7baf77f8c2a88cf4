"""Classes of walls and their readings, against walls of the class."""

import numpy as np
import pytest
from support.walls import random_direction, random_walls, rotated_from_x

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.surface.contact_laws import dissipation_factor
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.surface_class import SurfaceClass, axis_names, wall_axes
from uvms_drake.model.surface.unknown_contact import UnknownContact, UnknownSurface

CONTACT = UnknownContact(direction=np.array([0.0, 0.6, 0.8]), angle=0.2, stiffness=800.0,
                        force=40.0, dissipation=3.0, friction=0.4)


@pytest.mark.parametrize("seed", range(5))
def test_tilted_curved_and_layered_walls_are_in_the_class(seed):
    """Also in that of an unknown contact."""
    rng = np.random.default_rng(seed)
    surface = SurfaceClass(random_direction(rng), 3000.0, 0.3) if seed else CONTACT.walls
    for wall in random_walls(surface, rng, 20):
        p, other = rng.uniform(-0.02, 0.02, (2, 500, 3))
        growth = surface.stiffness * np.maximum(surface.advance(other - p), 0.0)
        assert np.all(wall.static(other) <= wall.static(p) + growth + 1e-9)


def test_no_smaller_stiffness_or_angle_would_do():
    """A plane that is tilted by all of θ, moved straight on and along its steepest way."""
    R = rotated_from_x(random_direction(np.random.default_rng(5)))
    surface = SurfaceClass(R[:, 0], 3000.0, 0.3)
    tilted = np.cos(0.3) * R[:, 0] + np.sin(0.3) * R[:, 1]
    for motion in (R[:, 0], R[:, 1]):
        grows = surface.stiffness * tilted @ motion
        assert grows == pytest.approx(
            surface.stiffness * np.cos(0.3) * surface.advance(motion), rel=1e-12)


@pytest.mark.parametrize("friction", [0.0, 0.3, 1.5])
def test_the_normal_force_is_at_most_what_a_reading_allows(friction):
    """Any tilt, friction and noise; and it is that much if all of them are against us."""
    rng = np.random.default_rng(1)
    surface = SurfaceClass(random_direction(rng), angle=0.4, friction=friction)
    R, noise = rotated_from_x(surface.direction), 0.7
    around = rng.uniform(0.0, 2.0 * np.pi, (2, 4000))
    tilt = rng.uniform(0.0, 0.4, 4000)
    radial = np.cos(around[0])[:, None] * R[:, 1] + np.sin(around[0])[:, None] * R[:, 2]
    normal = np.cos(tilt)[:, None] * R[:, 0] + np.sin(tilt)[:, None] * radial
    first = np.cos(tilt)[:, None] * radial - np.sin(tilt)[:, None] * R[:, 0]
    tangent = (np.cos(around[1])[:, None] * first
               + np.sin(around[1])[:, None] * np.cross(normal, first))
    push = rng.uniform(0.0, 30.0, 4000)
    error = rng.normal(size=(4000, 3))
    error *= noise * rng.uniform(0.0, 1.0, (4000, 1)) / np.linalg.norm(error, axis=1)[:, None]
    reading = push[:, None] * (normal + friction * rng.uniform(0, 1, (4000, 1)) * tangent) + error
    assert np.all(surface.normal_force_bound(reading, noise) >= push - 1e-9)
    # Worst case of the part along n: the tilt is θ, friction pushes back, and so does the noise.
    worst = np.cos(0.4) * R[:, 0] + np.sin(0.4) * R[:, 1]
    back = np.cos(0.4) * R[:, 1] - np.sin(0.4) * R[:, 0]
    reading = 20.0 * (worst + friction * back) - noise * R[:, 0]
    by_part = 20.0 if friction < 1.0 / np.tan(0.4) else np.inf
    by_norm = np.linalg.norm(reading) + noise
    assert surface.normal_force_bound(reading, noise) == pytest.approx(min(by_part, by_norm))


def test_a_wall_does_not_pull():
    surface = SurfaceClass()
    assert surface.normal_force_bound(np.array([-3.0, 0.0, 0.0]), 1.0) == 0.0


@pytest.mark.parametrize("factor", [dissipation_factor, lambda z: np.maximum(1.0 + z, 0.0)])
def test_damping_hides_no_more_force_than_that(factor):
    surface, rng = SurfaceClass(dissipation=2.0), np.random.default_rng(0)
    speed, static = rng.uniform(-0.49, 0.49, 1000), rng.uniform(0.0, 30.0, 1000)
    for c in (0.0, 1.0, 2.0):
        reading = static * factor(c * speed)
        bound = surface.static_behind(reading, -speed)
        assert np.all(bound >= static * (1 - 1e-12))
    tight = surface.static_behind(np.array(10.0 * (1.0 - 2.0 * 0.2)), np.array(0.2))
    assert tight == pytest.approx(10.0)


def test_a_fast_retreat_says_nothing():
    surface = SurfaceClass(dissipation=2.0)
    assert surface.static_behind(np.array(0.1), np.array(0.5)) == np.inf


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


def wall(heading: float, tilt: float) -> np.ndarray:
    """Returns the direction into a wall that faces a heading, leaning by a tilt [rad]."""
    return np.array([np.cos(tilt) * np.cos(heading), np.cos(tilt) * np.sin(heading), np.sin(tilt)])


@pytest.mark.parametrize("tilt", np.deg2rad([-60.0, -20.0, 0.0, 20.0, 60.0]))
def test_a_place_on_a_wall_moves_continuously_with_the_wall(tilt):
    """Over 72 headings: t₁ is never up, t₂ always to port, and 1° of turn moves a place by 1°."""
    more = np.deg2rad(1.0)
    for heading in np.deg2rad(np.arange(0.0, 360.0, 5.0)):
        n, down, port = wall_axes(wall(heading, tilt))
        assert axis_names(n) == ("down", "to port")
        assert down[2] == pytest.approx(np.cos(tilt)) and port[2] == pytest.approx(0.0, abs=1e-15)
        np.testing.assert_allclose(port, [np.sin(heading), -np.cos(heading), 0.0], atol=1e-12)
        for turned in (wall(heading + more, tilt), wall(heading, tilt + more)):
            motion = 0.3 * (wall_axes(turned) - wall_axes(n))
            assert np.linalg.norm(motion[1:], axis=1).max() < 0.3 * 1.01 * more


def test_on_floors_and_ceilings_places_are_by_the_compass():
    down = np.array([0.0, 0.0, 1.0])
    np.testing.assert_array_equal(wall_axes(down), [down, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert axis_names(down) == ("north", "east") and axis_names(-down) == ("north", "west")
    for heading in np.deg2rad(np.arange(0.0, 360.0, 5.0)):
        n, north, second = wall_axes(wall(heading, np.deg2rad(75.0)))
        assert north[0] > 0.9 and second[1] > 0.9 and n @ second == pytest.approx(0.0, abs=1e-15)


@pytest.mark.parametrize(("angle", "friction"), [(0.1, 0.5), (0.45, 0.2), (0.45, 0.0)])
def test_the_shares_are_the_ends_of_what_tilt_and_friction_leave_along_the_direction(
        angle, friction):
    """Also where friction is less than the tilt: the largest is not at the edge of the cone."""
    walls = SurfaceClass(angle=angle, friction=friction)
    beta = np.linspace(0.0, angle, 10_001)
    most = np.max(np.cos(beta) + friction * np.sin(beta))
    assert walls.largest_share == pytest.approx(most, abs=1e-8)
    assert walls.share == pytest.approx(np.min(np.cos(beta) - friction * np.sin(beta)), abs=1e-12)
