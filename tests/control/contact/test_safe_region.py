"""Tests of `control.contact.safe_region`: cones that are safe on every wall of a class."""

import numpy as np
import pytest
from support.shapes import in_ball_of, near, surfaces
from support.walls import random_direction, random_walls

from uvms_drake.control.contact.safe_region import (
    apex,
    between_readings,
    bounds,
    dominates,
    safe_depth,
    tip_advance,
)
from uvms_drake.model.surface.surface_class import SurfaceClass

FORCE_MAX, NOISE = 45.0, 1.0


def free_distance(surface: SurfaceClass, at: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Returns the distance along n from 𝔭 (..., 3) to the end of an apex's cone (...) [m].

    It is −⟨𝔭 − 𝔞⟩, below zero outside; −inf for an apex that is NaN.
    """
    distance = -surface.advance(point - at)
    return np.where(np.isnan(distance), -np.inf, distance)


def at_rest(points):
    return np.zeros_like(points)


def straight(stiffness=2000.0, **options):
    return SurfaceClass(np.array([1.0, 0.0, 0.0]), stiffness, **options)


@pytest.mark.parametrize("seed", range(6))
def test_nowhere_in_the_cone_is_the_force_too_large(seed):
    """Any wall, any place of the reading, any error; the reading averages the way of the tip."""
    rng = np.random.default_rng(seed)
    surface = SurfaceClass(random_direction(rng), 4000.0, 0.3, dissipation=2.0)
    closest = 0.0
    for wall in random_walls(surface, rng, 60):
        points = rng.uniform(-0.01, 0.01, 3) + np.cumsum(rng.normal(0.0, 3e-4, (5, 3)), axis=0)
        velocities = rng.normal(0.0, 0.03, (5, 3))
        weights = rng.dirichlet(np.ones(5))
        factor = 1.0 + rng.uniform(0.0, 2.0) * velocities @ wall.normal
        if not np.isinf(wall.radius):
            factor = np.ones(5)  # Its normal differs from place to place.
        load = weights @ (wall.static(points) * factor)
        reading = load * wall.normal + rng.choice([-1.0, 1.0]) * NOISE * surface.direction
        tip = apex(surface, points, velocities, reading, FORCE_MAX, NOISE)
        p = tip + rng.uniform(-0.02, 0.02, (3000, 3))
        p -= np.maximum(surface.advance(p - tip), 0.0)[:, None] * surface.direction
        left = free_distance(surface, tip, p)
        assert np.isnan(tip[0]) or np.min(left) > -1e-12
        if not np.isnan(tip[0]):
            closest = max(closest, np.max(wall.static(p)) / FORCE_MAX)
    assert 0.6 < closest <= 1.0 + 1e-9


def test_the_region_ends_where_the_stiffest_wall_has_the_largest_force():
    surface = straight(stiffness=5000.0)
    p = np.array([0.3, 1.0, -2.0])
    force = np.array([12.0 - NOISE, 0.0, 0.0])  # The noise hides some of the 12 N.
    tip = apex(surface, p[None], at_rest(p[None]), force, FORCE_MAX, NOISE)
    assert 12.0 + 5000.0 * (tip[0] - p[0]) == pytest.approx(FORCE_MAX)
    np.testing.assert_array_equal(tip[1:], p[1:])
    assert free_distance(surface, tip, p) == pytest.approx(33.0 / 5000.0)


def test_a_reading_above_the_limit_says_nothing_alone():
    """A soft wall has 46 N here, and more than 45 N where (F_max − φ⁺)/κ₊ would put x_safe."""
    surface, p = straight(), np.zeros((1, 3))
    tip = apex(surface, p, p, np.array([46.0, 0.0, 0.0]), FORCE_MAX, 0.0)
    assert np.all(np.isnan(tip))
    assert free_distance(surface, tip, p[0]) == -np.inf
    assert safe_depth(surface, tip, p[0], 0.0) == -np.inf
    formula = (FORCE_MAX - 46.0) / surface.stiffness
    assert 46.0 + 0.1 * surface.stiffness * formula > FORCE_MAX


@pytest.mark.parametrize("weights", [[1, 0, 0, 0], [0.25, 0.25, 0.25, 0.25], [0, 0.1, 0.2, 0.7]])
def test_the_age_of_a_reading_is_paid_for(weights):
    """On the stiffest wall, at a run into it; a region of the latest place alone is too far."""
    surface = straight()
    x = np.array([0.0, 1e-3, 2e-3, 3e-3])
    points = x[:, None] * np.eye(3)[0]
    reading = np.array([np.dot(weights, surface.stiffness * x), 0.0, 0.0])
    tip = apex(surface, points, at_rest(points), reading, FORCE_MAX, 0.0)
    assert surface.stiffness * tip[0] <= FORCE_MAX + 1e-9
    careless = apex(surface, points[-1:], at_rest(points[-1:]), reading, FORCE_MAX, 0.0)
    assert surface.stiffness * careless[0] > FORCE_MAX


@pytest.mark.parametrize("turn", [0.0, 0.02, 0.05, 0.08, 0.1])
@pytest.mark.parametrize("angle", [0.0, 0.4])
def test_a_tip_that_turns_round_between_two_readings_was_elsewhere(turn, angle):
    """Out and in again within a period of 0.1 s, on the stiffest wall; the reading is the least."""
    surface, period, a = straight(angle=angle), 0.1, 2.0
    t = np.linspace(0.0, period, 1001)
    x = 0.02 + 0.5 * a * (t - turn) ** 2
    ends = [0, -1]
    points, velocities = (each[ends, None] * np.eye(3)[0] for each in (x, a * (t - turn)))
    reading = surface.share * surface.stiffness * np.min(x) * np.eye(3)[0]
    tip = apex(surface, points, velocities, reading, FORCE_MAX, 0.0, period)
    assert surface.stiffness * tip[0] <= FORCE_MAX + 1e-9
    careless = apex(surface, points, velocities, reading, FORCE_MAX, 0.0)
    turns = 0.0 < turn < period
    assert (surface.stiffness * careless[0] > FORCE_MAX + 1e-9) == turns
    assert (tip[0] < careless[0]) == turns


def test_between_two_readings_no_tip_of_constant_acceleration_is_further_back():
    rng, period = np.random.default_rng(3), 0.1
    surface, t = straight(angle=0.5), np.linspace(0.0, period, 201)
    for first, last in rng.normal(0.0, 0.05, (300, 2, 3)):
        p = np.outer(t, first) + np.outer(0.5 * t**2 / period, last - first)
        distance_moved = surface.advance(p[-1] - p)
        advance = tip_advance(surface, p[[0, -1]], np.array([first, last]))
        most = advance.since.max() + between_readings(advance, period)
        assert np.max(distance_moved) <= most + 1e-12


def lateral(surface, tip, place):
    """Depth of the pyramid of an apex at a lateral place, by its facets."""
    along = surface.facets @ surface.direction
    depths = (tip - place) @ surface.facets.T / along
    return surface.depth(place) + np.min(depths, axis=-1)


def test_the_pyramid_is_inside_of_the_cone_and_meets_it_across_its_axes():
    rng = np.random.default_rng(2)
    surface = SurfaceClass(random_direction(rng), angle=0.4)
    assert surface.axes @ surface.axes.T == pytest.approx(np.eye(3))
    assert np.linalg.det(surface.axes) == pytest.approx(1.0)
    motion = rng.normal(size=(500, 3))
    most = np.max(motion @ surface.facets.T, axis=1)
    assert np.all(most >= surface.advance(motion) - 1e-12)
    assert most == pytest.approx(surface.depth(motion) + surface.tilt * surface.around(motion))
    for axis in surface.axes[1:]:
        assert np.max(surface.facets @ axis) == pytest.approx(surface.advance(axis))
    assert len(straight().facets) == 1


@pytest.mark.parametrize("size", [0.0, 0.02, 0.2])
def test_an_apex_is_replaced_iff_nothing_is_lost_in_a_box_of_places(size):
    """The box is anywhere off both, and sampled densely: at its ends, too."""
    rng = np.random.default_rng(3)
    surface = SurfaceClass(random_direction(rng), angle=0.4)
    R, taken = surface.axes.T, 0
    for _ in range(200):
        new, old = rng.normal(0.0, 0.03, (2, 3))
        old += surface.direction * (surface.depth(new - old) + rng.normal(0.0, 0.03))
        box = surface.across(new) + np.sort(size * rng.uniform(-1.0, 1.0, (2, 2)), axis=0)
        places = np.stack(np.meshgrid(*np.linspace(*box, 41).T), axis=-1).reshape(-1, 2)
        places = places @ R[:, 1:].T
        gain = np.min(lateral(surface, new, places) - lateral(surface, old, places))
        assert bool(dominates(surface, new, old, box)) == (gain >= -1e-12), gain
        taken += gain >= 0.0
    assert 20 < taken < 180


def test_any_apex_is_better_than_none_and_none_replaces_any():
    surface, none = straight(), np.full(3, np.nan)
    assert dominates(surface, np.zeros(3), none, np.zeros((2, 2)))
    assert not dominates(surface, none, np.zeros(3), np.zeros((2, 2)))


def test_behind_the_bounds_a_tip_that_is_off_by_the_margin_is_in_the_cone():
    rng = np.random.default_rng(4)
    surface = SurfaceClass(random_direction(rng), angle=0.5)
    R, tip, off_along, off_across = surface.axes.T, np.ones(3), 0.002, 0.003
    margin = off_along + np.sqrt(2.0) * surface.tilt * off_across
    for _ in range(200):
        place = tip + R[:, 1:] @ rng.uniform(-0.1, 0.1, 2)
        x = safe_depth(surface, tip, place, margin)
        planned = place + (x - surface.depth(place)) * surface.direction
        excess = surface.facets @ planned - bounds(surface, tip, margin)
        assert np.max(excess) == pytest.approx(0.0, abs=1e-12)
        a = rng.uniform(0.0, 2.0 * np.pi, 100)
        real = planned + off_along * surface.direction + off_across * (
            np.cos(a)[:, None] * R[:, 1] + np.sin(a)[:, None] * R[:, 2])
        assert np.min(free_distance(surface, tip, real)) >= -1e-12
    assert safe_depth(straight(), tip, tip, margin) == pytest.approx(1.0 - margin)


def test_a_tip_that_slides_on_a_tilted_wall_keeps_contact_and_is_safe():
    """Along a wall that comes towards it, by apexes that are left behind."""
    surface = straight(angle=0.2)
    normal = np.array([np.cos(0.15), np.sin(0.15), 0.0])
    extent, old, p = 0.02, np.full(3, np.nan), np.array([0.005, 0.0, 0.0])
    worst = 0.0
    for _ in range(400):
        force = surface.stiffness * max(p @ normal, 0.0)
        new = apex(surface, p[None], at_rest(p[None]), force * normal, FORCE_MAX, NOISE)
        box = surface.across(p) + np.sort(np.outer([0.0, extent], surface.across(
            np.array([0.0, 1.0, 0.0]))), axis=0)
        old = new if dominates(surface, new, old, box) else old
        assert free_distance(surface, old, p) > 0.0
        worst = max(worst, surface.stiffness * (normal @ (
            p + free_distance(surface, old, p) * surface.direction)))
        p = p + np.array([0.0, 1e-3, 0.0])
        p[0] = 0.005 - p[1] * np.tan(0.15)
    assert 0.7 * FORCE_MAX < worst <= FORCE_MAX


# Safe region on hulls, pipes and bumpy walls with friction, for walls of their class --------------


SHAPES = surfaces(dissipation=1.7, friction=0.3, creep=0.004)
REACH, LARGEST, FELT = 0.03, 15.0, 0.5  # m, N, N


@pytest.mark.parametrize("surface", SHAPES.values(), ids=SHAPES)
def test_what_a_reading_makes_safe_is_safe(surface):
    """Readings of tips that move, slide and feel noise, and every point of their cones in reach."""
    rng, readings, deepest = np.random.default_rng(0), 0, 0.0
    for _ in range(6):
        center = near(surface.geometry, 1, rng, depths=(0.0, 0.005))[0]
        _, direction = surface.geometry.depth_and_gradient(center)
        direction = direction / np.linalg.norm(direction) + 0.05 * rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        bounds = surface.membership(direction, center, REACH)
        walls = SurfaceClass(
            direction, bounds.stiffness, bounds.angle, bounds.dissipation, bounds.friction)
        points = in_ball_of(center, REACH, 200, rng)
        velocities = rng.normal(scale=0.05, size=(200, 3))
        force = surface.force(*(np.pad(x, ((0, 0), (0, 3))) for x in (points, velocities)))[:, :3]
        force = force + in_ball_of(np.zeros(3), FELT, 200, rng)
        at = apex(walls, points[:, None], velocities[:, None], force, LARGEST, FELT)
        others = in_ball_of(center, REACH, 2000, rng)
        static = surface.static_force(np.pad(others, ((0, 0), (0, 3))))
        safe = free_distance(walls, at[:, None], others) >= 0.0
        assert np.all((static <= LARGEST) | ~safe)
        readings += np.count_nonzero(np.any(safe, axis=1))
        deepest = max(deepest, float(np.max(np.where(safe, static, 0.0))))
    assert readings > 100
    assert deepest > 3.0
