"""Tests of `control.limits.limit` and of `control.plan.points`, with all kinds."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
from support.thrusters import eight_thrusters

import uvms_drake as uv
from uvms_drake.control.limits.input_in_contact import ForceCone, UnderContact
from uvms_drake.control.limits.inputs import Accelerations, Forces, ThrusterForces
from uvms_drake.control.limits.pose import ToolAngle
from uvms_drake.control.limits.speeds import ContactSpeed, SafeDepth, SafeDepthBetweenKnots
from uvms_drake.control.limits.static_force import StaticForce
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.surface_class import SurfaceClass

PLANE = check_surface(uv.UnilateralPlane())


@dataclass
class Power(uv.Limit):
    """|τᵢζᵢ| of every channel ≤ bound [W]: a limit of one's own, that says nothing else."""

    name = "power"
    about: ClassVar = "input"

    bound: float

    def values(self, at: uv.Points) -> np.ndarray:
        return at.tau * at.zeta

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.full(10, -self.bound), np.full(10, self.bound)


@pytest.fixture(scope="module")
def model() -> uv.ContactModel:
    return uv.ContactModel.load("girona500_arm5e", PLANE)


def points(model: uv.ContactModel, y: np.ndarray, zeta: np.ndarray, u: np.ndarray) -> uv.Points:
    config = np.array([model.configuration(row) for row in y])
    return uv.Points(model, config, y, zeta, u)


@pytest.fixture(scope="module")
def at(model) -> uv.Points:
    rng = np.random.default_rng(0)
    config, zeta, u = rng.uniform(-0.5, 0.5, size=(3, 5, 10))
    config[:, 6:] += [0.0, 0.6, 0.0, 0.0]
    return points(model, model.task_pose(config), zeta, u)


LIMITS = uv.limits.make_limits(uv.limits.Limits(
    static_force=40.0, u=np.linspace(1.0, 2.0, 10), tau=np.linspace(10.0, 90.0, 10)),
    np.full(4, -1.0), np.full(4, 2.0), PLANE)
ALL = LIMITS | {"power": Power(5.0)}
DIRECTION = np.array([0.6, 0.0, 0.8])
AXES, FACETS = SurfaceClass(DIRECTION).axes, SurfaceClass(DIRECTION, angle=0.2).facets
SPEEDS, TOOL = ContactSpeed(AXES, 0.1, 0.2), ToolAngle(DIRECTION, 0.3)
H = 0.2
THRUSTERS = ThrusterForces.of(eight_thrusters(bias=3.0), np.zeros(0), 10)
OTHERS = [uv.limits.TipVelocity(np.ones(3)), TOOL, SPEEDS, SafeDepth(FACETS, np.zeros(4)),
          SafeDepthBetweenKnots(FACETS, np.zeros(4), H), THRUSTERS, *(
              UnderContact(limit, ForceCone(DIRECTION, 25.0, 0.4))
              for limit in (Accelerations(np.ones(10)), Forces(np.ones(10)), THRUSTERS))]


@pytest.mark.parametrize("limit", OTHERS + [
    limit for name, limit in ALL.items() if name not in ("nu1", "nu2", "qdot")],
    ids=lambda limit: f"{type(limit).__name__}_{limit.name}")
def test_rows_change_as_the_slopes_say(model, at, limit):
    """By central differences, in y with the 𝔮 that belongs to it, in ζ and in u."""
    h = 1e-6
    values, slopes = limit.row_values(at), limit.row_slopes(at)
    for argument in ("y", "zeta", "u"):
        slope = getattr(slopes, argument)
        for j, step in enumerate(h * np.eye(10)):
            forward, backward = (limit.row_values(points(model, *(
                getattr(at, each) + sign * step * (each == argument)
                for each in ("y", "zeta", "u")))) for sign in (1.0, -1.0))
            found = 0.0 if slope is None else slope[..., j]
            np.testing.assert_allclose(
                np.broadcast_to(found, values.shape), (forward - backward) / (2.0 * h),
                rtol=1e-6, atol=1e-6 * (1.0 + np.max(np.abs(values))))


@pytest.mark.parametrize("name", ["nu1", "nu2", "qdot"])
def test_a_speed_is_the_norm_of_its_cone(at, name):
    limit = ALL[name]
    cone = limit.cone(at)
    np.testing.assert_array_equal(cone.value, at.zeta @ cone.slopes.zeta.T)
    np.testing.assert_allclose(np.linalg.norm(cone.value, axis=1), limit.values(at)[:, 0])
    assert cone.bound == limit.upper[0]


@pytest.mark.parametrize("name", [name for name in ALL if name not in (
    "roll", "pitch", "u", "tau", "power")])
def test_what_has_a_closed_form_changes_by_no_more_than_it_says(model, at, name):
    forms = ALL[name].closed_form(10)
    rng = np.random.default_rng(1)
    dy, dzeta = 1e-3 * rng.normal(size=(2, 5, 10))
    before, after = (ALL[name].values(each) for each in (
        at, points(model, at.y + dy, at.zeta + dzeta, at.u)))
    for i, form in enumerate(forms):
        change = sum(step @ slope.T for step, slope in ((dy, form.y), (dzeta, form.zeta))
                     if slope is not None)
        assert np.all(np.abs(after - before)[:, i] <= np.linalg.norm(change, axis=1) + 1e-12)


def test_the_mass_matrix_of_some_of_the_points_is_theirs(model, at):
    some = at.subset(slice(2, None), at.u[2:])
    alone = uv.Points(model, some.config, some.y, some.zeta, some.u)
    np.testing.assert_allclose(some.tau, alone.tau, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(some.mass_matrix_rates, alone.mass_matrix_rates, atol=1e-12)


def test_what_turns_with_the_vehicle_has_the_rates_of_complex_steps(model, at):
    """Along all of 𝔮, of which `uv.Points` takes the joints only."""
    step = 1e-30
    moved = model.kinematics(at.config[:, None] + 1j * step * np.eye(model.size))
    for rates, J in ((at.tip_jacobian_rates, moved.J_chi[..., :3, :]),
                     (at.mass_matrix_rates, model.mass_matrix(moved))):
        np.testing.assert_allclose(rates, np.moveaxis(J.imag / step, 1, -1), atol=1e-10)


# A limit of one's own ----------------------------------------------------------------------------


def test_without_a_word_about_the_tube_a_plan_keeps_the_whole_limit():
    tube = uv.limits.TubeRadii(e=0.01, z=0.01, roll=0.01, pitch=0.01, u=np.full(10, 0.1),
                     tau=np.full(10, 0.1))
    nominal = uv.limits.tighten(ALL | {"static_force": LIMITS["static_force"]}, tube)
    np.testing.assert_array_equal(nominal["power"].upper, ALL["power"].upper)
    assert nominal["roll"].upper[0] == pytest.approx(0.29)
    assert ALL["roll"].upper[0] == 0.3, "the limit itself stays"


def test_an_interval_is_used_up_at_both_of_its_ends(at):
    limit = LIMITS["q"]
    for value, used in ((-1.0, 1.0), (0.5, 0.0), (2.0, 1.0), (1.25, 0.5), (2.15, 1.1)):
        y = at.y.copy()
        y[:, 6:] = value
        there = uv.Points(at.model, at.config, y)
        np.testing.assert_allclose(limit.used(there), used)
        assert np.all(limit.excess(there) > 0.0) == (used > 1.0)


# Tests of the limits of a sensed contact: speeds, tool's angle, safe depth ------------------------


def test_speeds_and_depths_half_an_interval_later_are_by_differences_of_places(model, at):
    step = 1e-6
    forward, backward = (model.task_pose(at.config + sign * step * uv.configuration_rate(
        at.config, at.zeta))[:, :3] for sign in (1.0, -1.0))
    velocity = (forward - backward) / (2.0 * step)
    np.testing.assert_allclose(SPEEDS.values(at), velocity @ AXES.T, atol=1e-8)
    depth, between = (limit.values(at) for limit in OTHERS[3:5])
    np.testing.assert_allclose(depth, at.y[:, :3] @ FACETS.T, atol=1e-15)
    np.testing.assert_allclose(between, depth + 0.5 * H * velocity @ FACETS.T, atol=1e-8)


def test_the_cosine_is_that_of_the_tools_axis(at):
    axis = rotation_matrix(at.y[:, 3:6])[:, :, 0]
    np.testing.assert_allclose(TOOL.values(at)[:, 0], axis @ DIRECTION, atol=1e-12)


def test_the_cosine_changes_by_no_more_than_the_tube_takes_of_it(model):
    """Attitudes at the bound, and Euler angles that are off by the radius, to first order."""
    radius, rng = uv.limits.TubeRadii(orientation=0.02), np.random.default_rng(0)
    y = np.zeros((20_000, 10))
    y[:, 3:6] = rng.uniform([-0.5, -1.3, -0.4], [0.5, 0.2, 0.4], (20_000, 3))
    off = rng.normal(size=(20_000, 3))
    off *= radius.orientation / np.linalg.norm(off, axis=1, keepdims=True)
    moved = y + np.pad(off, ((0, 0), (3, 4)))
    values, others = (TOOL.values(uv.Points(model, each, each))[:, 0] for each in (y, moved))
    inside = np.minimum(values, others) >= np.cos(TOOL.bound)
    change = np.max(np.abs(values - others)[inside])
    taken = float(TOOL.tube_takes(uv.limits.resolved_radii(radius))[0])
    assert 0.5 * taken < change <= taken


def test_the_bar_of_the_tool_shows_its_angle_not_the_cosine(at):
    turned = np.zeros(10)
    turned[4] = 0.15 - np.arccos(DIRECTION[0])  # the axis of the tool, 0.15 rad off n
    there = uv.Points(at.model, turned, turned, turned)
    assert TOOL.bar_lengths(there) == pytest.approx([0.5])


# Static force -------------------------------------------------------------------------------------


SPRING = check_surface(uv.BilateralSpring(
    stiffness=np.diag([900.0, 400.0, 300.0, 9.0, 8.0, 7.0]) + np.array(
        [[0, 50, 0, 20, 0, 5], [50, 0, 0, 0, 10, 0], [0, 0, 0, 0, 0, 0],
         [20, 0, 0, 0, 0, 0], [0, 10, 0, 0, 0, 0], [5, 0, 0, 0, 0, 0]]),
    equilibrium=np.array([0.3, -0.2, 1.1, 0.1, -0.2, 0.4])))
TILTED = check_surface(uv.UnilateralPlane(
    point=np.array([0.3, -0.2, 1.1]), normal=np.array([-0.6, 0.0, 0.8]), stiffness=830.0))
SMALL_TUBE = uv.limits.TubeRadii(position=0.002, orientation=0.01)


@pytest.mark.parametrize("surface", [SPRING, TILTED], ids=["spring", "plane"])
def test_what_the_tube_leaves_of_the_force_keeps_its_limit_and_no_less_would_do(surface):
    """At 4000 poses of just the nominal force, each off by a deviation of the tube."""
    limit = 40.0
    bound = StaticForce(limit, surface).tightened(SMALL_TUBE).upper[0]
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
        (SMALL_TUBE.position, rng.normal(size=(4000, 3))),
        (SMALL_TUBE.orientation, rng.normal(size=(4000, 3))))]
    worst = np.max(surface.static_force(nominal + np.concatenate(off, axis=1)))
    assert bound + 0.8 * (limit - bound) < worst <= limit + 1e-9


@pytest.mark.parametrize("surface", [SPRING, TILTED], ids=["spring", "plane"])
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
