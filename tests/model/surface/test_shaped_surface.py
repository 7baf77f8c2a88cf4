"""A surface put together from a shape, a law, damping and friction."""

import numpy as np
import pytest
from support.shapes import LAWS, SHAPES, SHIFT, R, in_ball_of, near, surfaces

import uvms_drake as uv
from uvms_drake.model.surface.contact_laws import Linear
from uvms_drake.model.surface.geometry import Plane

ALL = surfaces(dissipation=1.7, friction=0.3, creep=0.004)
every_surface = pytest.mark.parametrize("surface", ALL.values(), ids=ALL)


def states(surface, count, rng, speed=0.2):
    """Returns χ and χ̇ (count, 6) about the surface."""
    chi = np.concatenate([near(surface.geometry, count, rng), rng.uniform(-1, 1, (count, 3))], 1)
    return chi, rng.normal(scale=speed, size=(count, 6))


def parts(surface, chi, chi_dot):
    """Returns the force along the inward normal (m,) and across (m, 3), and the velocity so."""
    _, normal = surface.geometry.depth_and_gradient(chi[:, :3])
    normal = normal / np.linalg.norm(normal, axis=1)[:, None]
    force, velocity = surface.force(chi, chi_dot)[:, :3], chi_dot[:, :3]
    along, rate = np.sum(force * normal, axis=1), np.sum(velocity * normal, axis=1)
    return along, force - along[:, None] * normal, rate, velocity - rate[:, None] * normal


def work(surface, steps=20000):
    """Returns ∮ 𝔉ᵀχ̇ dt along a closed path through the surface and out of it."""
    t = np.linspace(0.0, 2.0 * np.pi, steps, endpoint=False)[:, None]
    frequency, phase = np.array([1, 2, 3]), np.arange(3.0)
    x = np.array([0.08, 0.06, 0.02]) * np.sin(frequency * t + phase)
    x_dot = np.array([0.08, 0.06, 0.02]) * frequency * np.cos(frequency * t + phase)
    axes = surface.geometry.axes
    chi = np.pad(surface.anchor + x @ axes, ((0, 0), (0, 3)))
    chi_dot = np.pad(x_dot @ axes, ((0, 0), (0, 3)))
    force = surface.force(chi, chi_dot)
    assert 0.2 < np.mean(np.any(force != 0.0, axis=1)) < 0.8
    return float(np.sum(force * chi_dot) * 2.0 * np.pi / steps)


def test_flat_linear_and_frictionless_it_is_the_unilateral_plane():
    rng, normal = np.random.default_rng(0), R @ [-1.0, 0.0, 0.0]
    plane = uv.UnilateralPlane(SHIFT, normal, 830.0, 1.7, 0.003)
    surface = uv.ShapedSurface(Plane(SHIFT, normal), Linear(830.0, 0.003), 1.7, 0.0)
    chi, chi_dot = states(surface, 500, rng)
    np.testing.assert_allclose(surface.force(chi, chi_dot), plane.force(chi, chi_dot), atol=1e-11)
    np.testing.assert_allclose(surface.penetration(chi), plane.penetration(chi), atol=1e-15)
    np.testing.assert_array_equal(surface.normal, plane.normal)
    assert surface.penetration_for(12.0) == pytest.approx(plane.penetration_for(12.0))
    pose, push = chi[0], np.concatenate([-12.0 * normal, np.zeros(3)])
    np.testing.assert_allclose(
        surface.pose_for(push, pose), plane.pose_for(push, pose), atol=1e-12)


@every_surface
def test_a_complex_step_gives_the_derivative(surface):
    """At rest too, where friction is zero, and outside."""
    rng, h = np.random.default_rng(2), 1e-7
    chi, chi_dot = states(surface, 200, rng, 0.003)
    chi_dot[:40] = 0.0
    by_pose, by_rate = rng.normal(size=(2, 200, 6))
    exact = surface.force(chi + 1e-30j * by_pose, chi_dot + 1e-30j * by_rate).imag / 1e-30
    finite = (surface.force(chi + h * by_pose, chi_dot + h * by_rate)
              - surface.force(chi - h * by_pose, chi_dot - h * by_rate)) / (2.0 * h)
    np.testing.assert_allclose(exact, finite, atol=0.02)
    assert np.max(np.abs(exact)) > 500.0


@pytest.mark.parametrize("name", ALL)
def test_a_surface_that_is_moved_exerts_the_same_force(name):
    still = uv.ShapedSurface(SHAPES[name.split()[0]], LAWS[name.split()[1]], 1.7, 0.3, 0.004)
    chi, chi_dot = states(still, 100, np.random.default_rng(3))
    force = still.force(chi, chi_dot).reshape(-1, 2, 3) @ R.T
    chi, chi_dot = (each.reshape(-1, 2, 3) @ R.T for each in (chi, chi_dot))
    chi[:, 0] += SHIFT
    moved = ALL[name].force(chi.reshape(-1, 6), chi_dot.reshape(-1, 6))
    np.testing.assert_allclose(moved, force.reshape(-1, 6), atol=1e-9)
    np.testing.assert_array_equal(still.moved(R, SHIFT).anchor, ALL[name].anchor)


@every_surface
def test_it_never_pulls_and_friction_is_against_the_sliding_and_within_its_cone(surface):
    chi, chi_dot = states(surface, 2000, np.random.default_rng(4), 2.0)
    along, across, _, velocity = parts(surface, chi, chi_dot)
    assert np.all(along >= 0.0)
    np.testing.assert_array_equal(along > 0.0, surface.geometry.depth(chi[:, :3]) > 0.0)
    speed = np.linalg.norm(velocity, axis=1)
    np.testing.assert_allclose(across, (0.3 * along / speed)[:, None] * velocity, atol=1e-9)
    np.testing.assert_array_equal(surface.force(chi, chi_dot)[:, 3:], 0.0)


@every_surface
def test_a_closed_path_costs_no_energy_at_rest_and_some_in_motion(surface):
    """Static forces are a gradient; damping and friction each take energy."""
    still, damped, rubbing = (uv.ShapedSurface(surface.geometry, surface.law, c, mu)
                              for c, mu in ((0.0, 0.0), (1.7, 0.0), (0.0, 0.3)))
    assert work(still) == pytest.approx(0.0, abs=1e-8)
    assert work(damped) > 1e-3
    assert work(rubbing) > 1e-2


@every_surface
def test_neither_damping_nor_friction_ever_gives_power(surface):
    chi, chi_dot = states(surface, 2000, np.random.default_rng(5), 1.0)
    static = surface.force(chi, np.zeros_like(chi))
    assert np.all(np.sum((surface.force(chi, chi_dot) - static) * chi_dot, axis=1) >= 0.0)


@every_surface
@pytest.mark.parametrize("reach", [0.01, 0.06])
def test_pairs_of_points_keep_the_inequality_of_the_class(surface, reach):
    rng = np.random.default_rng(7)
    for _ in range(4):
        center = near(surface.geometry, 1, rng, depths=(0.0, 0.0))[0]
        direction = surface.geometry.depth_and_gradient(center)[1] + 0.2 * rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        known = surface.membership(direction, center, reach)
        p, q = (in_ball_of(center, reach, 4000, rng) for _ in range(2))
        q[::2] = p[::2] + 1e-5 * rng.normal(size=(2000, 3))
        before, after = (surface.static_force(np.pad(x, ((0, 0), (0, 3)))) for x in (p, q))
        ahead = (q - p) @ direction
        aside = np.linalg.norm(q - p - ahead[:, None] * direction, axis=1)
        room = known.stiffness * np.maximum(ahead + np.tan(known.angle) * aside, 0.0)
        inside = np.linalg.norm(q - center, axis=1) <= reach
        assert np.all((after - before <= room + 1e-9)[inside])
        assert np.count_nonzero(after > before) > 100


@every_surface
def test_past_the_transition_the_force_grows_as_fast_as_the_class_says(surface):
    """Along the direction, between the smallest and the largest slope."""
    rng, h = np.random.default_rng(8), 1e-6
    center = near(surface.geometry, 1, rng, depths=(0.0, 0.0))[0]
    direction = surface.geometry.depth_and_gradient(center)[1]
    direction = direction / np.linalg.norm(direction)
    known = surface.membership(direction, center, 0.03)
    points = in_ball_of(center, 0.03, 4000, rng)
    points = points[surface.geometry.depth(points) > surface.law.transition + h]
    ends = [np.pad(points + sign * h * direction, ((0, 0), (0, 3))) for sign in (1.0, -1.0)]
    slope = (surface.static_force(ends[0]) - surface.static_force(ends[1])) / (2.0 * h)
    assert np.all(slope >= known.least_stiffness - 1e-4)
    assert np.all(slope <= known.stiffness + 1e-4)
    if surface.geometry.is_distance:
        assert np.min(slope) < 1.1 * known.least_stiffness


def test_the_class_of_a_plane_is_as_tight_as_can_be():
    surface = uv.ShapedSurface(Plane(), Linear(700.0, 0.002), 1.3, 0.4)
    tilt = np.array([np.cos(0.1), 0.0, np.sin(0.1)])
    known = surface.membership(tilt, np.zeros(3), 0.5)
    assert (known.stiffness, known.dissipation, known.friction) == (700.0, 1.3, 0.4)
    assert known.least_stiffness == pytest.approx(700.0 * np.cos(0.1))
    assert known.angle == pytest.approx(0.1)


@every_surface
def test_the_force_at_rest_is_bounded_by_that_in_motion_as_the_class_says(surface):
    rng = np.random.default_rng(9)
    chi, chi_dot = states(surface, 2000, rng, 0.3)
    known = surface.membership(-surface.geometry.normal, surface.anchor, 0.02)
    along, across, rate, _ = parts(surface, chi, chi_dot)
    static = surface.static_force(chi)
    assert np.all(along >= static * np.maximum(1.0 + known.dissipation * np.minimum(rate, 0.0), 0.0)
                  - 1e-9)
    assert np.all(along <= static * (1.0 + known.dissipation * np.maximum(rate, 0.0)) + 1e-9)
    assert np.all(np.linalg.norm(across, axis=1) <= known.friction * along + 1e-9)


def test_a_class_that_would_go_around_a_pole_is_refused():
    surface = ALL["pole linear"]
    with pytest.raises(uv.InvalidParameter, match=r"^reach = 0\.29: must be so short that"):
        surface.membership(-surface.geometry.normal, surface.anchor + [0.0, 0.0, 0.05], 0.29)


@every_surface
@pytest.mark.parametrize("force", [4.0, 20.0])
def test_at_the_pose_for_a_force_it_is_that_force(surface, force):
    """Wherever the surface has a normal along it, here where a tip some way off is above it."""
    rng = np.random.default_rng(10)
    place = near(surface.geometry, 1, rng, depths=(0.02, 0.02))[0]
    _, gradient = surface.geometry.depth_and_gradient(place)
    push = np.append(force * gradient / np.linalg.norm(gradient), np.zeros(3))
    pose = np.append(place - 0.005 * gradient, [0.1, 0.2, 0.3])
    chi = surface.pose_for(push, pose)
    np.testing.assert_allclose(surface.force(chi, np.zeros(6)), push, atol=1e-6)
    np.testing.assert_array_equal(chi[3:], pose[3:])
    assert np.linalg.norm(chi[:3] - place) < 0.05


@pytest.mark.parametrize(("name", "force", "message"), [
    ("plane linear", [0, 0, 20.0, 0, 0, 0], r"^force = .*: must be along a normal of the surface "
     r"near the pose, which is \[-?[\d.]+, -?[\d.]+, -?[\d.]+\] there$"),
    ("pole linear", [0.1, 0, 0, 0, 0, 0], r"^force = .*: must be a push of at least 1\.\d+ N wit"),
    ("pipe hardening", [20, 0, 0, 0, 0, 1.0], r"^force = .*: must be a push .* without a torque"),
])
def test_a_force_that_it_cannot_give_is_named(name, force, message):
    with pytest.raises(uv.InvalidParameter, match=message):
        ALL[name].pose_for(np.array(force, dtype=float), np.zeros(6))


def test_only_a_flat_one_has_a_normal_and_only_an_even_one_a_depth_for_a_force():
    assert ALL["pole linear"].normal is None
    assert ALL["bumpy linear"].penetration_for(20.0) is None
    assert ALL["pipe linear"].penetration_for(20.0) == pytest.approx(20.0 / 830.0 + 0.0015)
