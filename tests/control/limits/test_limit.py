"""Tests of `control.limits.limit` and of `control.plan.points`, with all kinds."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from uvms_drake.control.limits import Limit, Limits, TubeRadii, make_limits, tighten
from uvms_drake.control.limits.pose import ToolAngle
from uvms_drake.control.limits.speeds import (
    ContactSpeed,
    SafeDepth,
    SafeDepthBetweenKnots,
    TipVelocity,
)
from uvms_drake.control.plan.points import Points
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.surface.surface_class import SurfaceClass

PLANE = check_surface(UnilateralPlane())


@dataclass
class Power(Limit):
    """|τᵢζᵢ| of every channel ≤ bound [W]: a limit of one's own, that says nothing else."""

    name = "power"
    about: ClassVar = "input"

    bound: float

    def values(self, at: Points) -> np.ndarray:
        return at.tau * at.zeta

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        return np.full(10, -self.bound), np.full(10, self.bound)


@pytest.fixture(scope="module")
def model() -> ContactModel:
    return ContactModel.load("girona500_arm5e", PLANE)


def points(model: ContactModel, y: np.ndarray, zeta: np.ndarray, u: np.ndarray) -> Points:
    config = np.array([model.configuration(row) for row in y])
    return Points(model, config, y, zeta, u)


@pytest.fixture(scope="module")
def at(model) -> Points:
    rng = np.random.default_rng(0)
    config, zeta, u = rng.uniform(-0.5, 0.5, size=(3, 5, 10))
    config[:, 6:] += [0.0, 0.6, 0.0, 0.0]
    return points(model, model.task_pose(config), zeta, u)


LIMITS = make_limits(
    Limits(static_force=40.0, u=np.linspace(1.0, 2.0, 10), tau=np.linspace(10.0, 90.0, 10)),
    np.full(4, -1.0), np.full(4, 2.0), PLANE)
ALL = LIMITS | {"power": Power(5.0)}
DIRECTION = np.array([0.6, 0.0, 0.8])
OF_CONTACT = {limit.name: limit for limit in (
    TipVelocity(np.ones(3)), ToolAngle(DIRECTION, 0.3),
    ContactSpeed(SurfaceClass(DIRECTION).axes, 0.1, 0.2),
    SafeDepth(SurfaceClass(DIRECTION, angle=0.2).facets, np.zeros(4)),
    SafeDepthBetweenKnots(SurfaceClass(DIRECTION, angle=0.2).facets, np.zeros(4), 0.2))}


@pytest.mark.parametrize("limit", [limit for name, limit in (ALL | OF_CONTACT).items()
                                   if name not in ("nu1", "nu2", "qdot")], ids=lambda x: x.name)
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
    alone = Points(model, some.config, some.y, some.zeta, some.u)
    np.testing.assert_allclose(some.tau, alone.tau, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(some.mass_matrix_rates, alone.mass_matrix_rates, atol=1e-12)


def test_what_turns_with_the_vehicle_has_the_rates_of_complex_steps(model, at):
    """Along all of 𝔮, of which `Points` takes the joints only."""
    step = 1e-30
    moved = model.kinematics(at.config[:, None] + 1j * step * np.eye(model.size))
    for rates, J in ((at.tip_jacobian_rates, moved.J_chi[..., :3, :]),
                     (at.mass_matrix_rates, model.mass_matrix(moved))):
        np.testing.assert_allclose(rates, np.moveaxis(J.imag / step, 1, -1), atol=1e-10)


# A limit of one's own ----------------------------------------------------------------------------


def test_without_a_word_about_the_tube_a_plan_keeps_the_whole_limit():
    tube = TubeRadii(e=0.01, z=0.01, roll=0.01, pitch=0.01, u=np.full(10, 0.1),
                     tau=np.full(10, 0.1))
    nominal = tighten(ALL | {"static_force": LIMITS["static_force"]}, tube)
    np.testing.assert_array_equal(nominal["power"].upper, ALL["power"].upper)
    assert nominal["roll"].upper[0] == pytest.approx(0.29)
    assert ALL["roll"].upper[0] == 0.3, "the limit itself stays"


def test_an_interval_is_used_up_at_both_of_its_ends(at):
    limit = LIMITS["q"]
    for value, used in ((-1.0, 1.0), (0.5, 0.0), (2.0, 1.0), (1.25, 0.5), (2.15, 1.1)):
        y = at.y.copy()
        y[:, 6:] = value
        there = Points(at.model, at.config, y)
        np.testing.assert_allclose(limit.used(there), used)
        assert np.all(limit.excess(there) > 0.0) == (used > 1.0)


def test_names_and_signals_follow_from_the_name(at):
    limit = ALL["power"]
    assert limit.labels == [f"power[{i}]" for i in range(10)]
    assert limit.bars[3] == "power[3]  ≤ 5"
    signals = limit.signals(at)
    values, bound = signals["power[3]_min"]
    np.testing.assert_array_equal(values, at.tau[:, 3] * at.zeta[:, 3])
    assert (bound, signals["power[3]_max"][1]) == (-5.0, 5.0)
