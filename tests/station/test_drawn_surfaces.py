"""Tests of `station.contact.drawn_surfaces`: no wall that is drawn is outside of the class."""

import numpy as np
import pytest
from support.shapes import in_ball_of

from uvms_drake.common.schema import checked
from uvms_drake.model.surface.contact_laws import Bilinear, Hardening, Linear
from uvms_drake.model.surface.geometry import Bumpy, Cylinder, Plane
from uvms_drake.model.surface.unknown_contact import UnknownContact
from uvms_drake.station.contact.drawn_surfaces import (
    BELOW,
    SOFTEST,
    ball_about,
    draw_law,
    draw_wall,
)

DIRECTION = np.array([2.0, -1.0, 2.0]) / 3.0
CONTACT = UnknownContact(direction=DIRECTION, angle=0.08, stiffness=900.0, friction=0.4)
START, GOAL = np.array([0.4, -0.3, 1.1]), np.array([0.5, -0.1, 1.2])
DRAWS = 150


def drawn(rng):
    """Returns walls, each with some points of the ball in which it is in the class."""
    for _ in range(DRAWS):
        wall = draw_wall(CONTACT, START, GOAL, rng)
        if wall is not None:
            ball = ball_about(wall.anchor, CONTACT, wall.law, START, GOAL)
            yield wall, in_ball_of(*ball, 200, rng)


@pytest.mark.long
def test_the_inequality_of_the_class_holds_between_any_two_points():
    """φ(p') ≤ φ(p) + κ⟨p' − p⟩, with φ the static force of the surface itself."""
    rng, walls = np.random.default_rng(1), CONTACT.walls
    largest = 0.0
    for wall, points in drawn(rng):
        chi = np.concatenate([points, np.zeros_like(points)], axis=1)
        force = wall.static_force(chi)
        gain = force[:, None] - force
        allowed = walls.stiffness * np.maximum(walls.advance(points[:, None] - points), 0.0)
        assert np.all(gain <= allowed + 1e-9)
        largest = max(largest, np.max(gain[allowed > 1.0] / allowed[allowed > 1.0]))
    assert 0.99 < largest <= 1.0


@pytest.mark.long
def test_normals_damping_and_friction_are_those_of_the_class():
    """The damping is seen as force in motion over that at rest, friction as force across it."""
    rng, angles = np.random.default_rng(2), []
    for wall, points in drawn(rng):
        _, into = wall.geometry.depth_and_gradient(points)
        into /= np.linalg.norm(into, axis=1)[:, None]
        angles.append(np.max(np.arccos(np.clip(into @ DIRECTION, -1.0, 1.0))))
        speed = 0.05
        chi = np.concatenate([points, np.zeros_like(points)], axis=1)
        for way in (into, np.cross(into, DIRECTION + 0.1)):
            rate = np.concatenate([speed * way, np.zeros_like(way)], axis=1)
            force = wall.force(chi, rate)[:, :3]
            normal = np.sum(force * into, axis=1)
            across = np.linalg.norm(force - normal[:, None] * into, axis=1)
            static = wall.static_force(chi)
            assert np.all(normal <= static * (1.0 + CONTACT.dissipation * speed) + 1e-9)
            assert np.all(across <= CONTACT.friction * normal + 1e-9)
    assert np.max(angles) <= CONTACT.angle + 1e-7
    assert np.max(angles) > 0.95 * CONTACT.angle


@pytest.mark.long
def test_all_shapes_and_laws_are_drawn():
    found = [wall for wall, _ in drawn(np.random.default_rng(3))]
    assert len(found) > 0.7 * DRAWS
    for kinds, part in (((Plane, Cylinder, Bumpy), "geometry"),
                        ((Linear, Bilinear, Hardening), "law")):
        for kind in kinds:
            assert sum(type(getattr(wall, part)) is kind for wall in found) > 0.1 * len(found), kind
    assert {wall.geometry.inside for wall in found if isinstance(wall.geometry, Cylinder)} == {
        False, True}
    at_the_bound = [wall.law.slopes[1] >= 0.999 * CONTACT.stiffness for wall in found]
    assert 0.1 < np.mean(at_the_bound) < 0.5


def test_slopes_are_within_their_range():
    rng = np.random.default_rng(4)
    for _ in range(200):
        law = checked(draw_law(SOFTEST * 500.0, 500.0, rng))
        depth = np.linspace(0.0, 0.2, 4001)
        slope = np.diff(law.force(depth)) / np.diff(depth)
        assert np.max(slope) <= 500.0
        assert np.min(slope[depth[1:] > 0.01]) >= 50.0 * (1.0 - 1e-9)


@pytest.mark.long
def test_the_tip_is_in_the_ball_where_it_presses_no_harder_than_it_may():
    """Between start and goal across n, and up to the largest static force."""
    rng = np.random.default_rng(5)
    n = DIRECTION
    for wall, _ in drawn(rng):
        way = rng.uniform(size=(200, 1))
        line = START + way * (GOAL - START - n * (n @ (GOAL - START)))
        points = line + rng.uniform(0.0, 1.0, (200, 1)) * n
        force = wall.static_force(np.concatenate([points, np.zeros_like(points)], axis=1))
        touching = (force > 0.0) & (force <= CONTACT.force)
        center, reach = ball_about(wall.anchor, CONTACT, wall.law, START, GOAL)
        assert np.all(np.linalg.norm(points[touching] - center, axis=1) <= reach)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_draw_is_a_function_of_its_generator(seed):
    walls = [draw_wall(CONTACT, START, GOAL, np.random.default_rng(seed)) for _ in range(2)]
    assert repr(walls[0]) == repr(walls[1])
    assert BELOW < 1.0
