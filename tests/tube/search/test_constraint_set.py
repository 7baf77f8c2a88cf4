"""Tests of `uvms_drake.tube.search.constraint_set`."""

from dataclasses import replace

import numpy as np
import pytest
from support import dh
from support.tiny_robots import drill, tiny_robot
from support.tube_bounds import contains

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.spring import BilateralSpring
from uvms_drake.tube.search.constraint_set import ConstraintSet, pulled

BOUNDS = ConstraintSet(
    q_lower=np.array([-0.4, 0.2, -0.5, -1.0]), q_upper=np.array([0.5, 1.2, 0.6, 0.8]), roll=0.3,
    pitch=0.2, tip_pitch=0.5, nu1=0.25, nu2=0.2, qdot=0.3, force_max=40.0, yaw=1.0)
DEEPEST = 0.041  # m, where the wall of 1000 N/m with its transition of 2 mm carries 40 N


@pytest.fixture(scope="module")
def drawn(model) -> tuple[np.ndarray, np.ndarray]:
    return BOUNDS.sample(model, 4000, np.random.default_rng(0))


@pytest.fixture(scope="module")
def in_spring(uvms) -> ContactModel:
    stiffness = np.diag([500.0, 300.0, 400.0, 5.0, 4.0, 3.0])
    stiffness[0, 4] = stiffness[4, 0] = 20.0
    return ContactModel(uvms, check_surface(BilateralSpring(stiffness, np.full(6, 0.3))))


def test_samples_keep_every_bound_by_an_independent_kinematics(drawn):
    config, zeta = drawn
    chi = np.array([dh.chi(row) for row in config])
    assert np.all(np.abs(config[:, 3:6]) <= [0.3, 0.2, 1.0])
    assert np.all((config[:, 6:] >= BOUNDS.q_lower) & (config[:, 6:] <= BOUNDS.q_upper))
    assert np.max(np.abs(chi[:, 4])) <= 0.5 + 1e-9
    assert np.min(chi[:, 0]) >= -0.01 - 1e-9  # The wall is at x = 0.
    assert np.max(chi[:, 0]) <= DEEPEST + 1e-9
    for block, bound in ((slice(0, 3), 0.25), (slice(3, 6), 0.2), (slice(6, 10), 0.3)):
        assert np.max(np.linalg.norm(zeta[:, block], axis=1)) <= bound + 1e-12


def test_samples_reach_faces_and_corners(model, drawn):
    config, zeta = drawn
    chi = model.kinematics(config).chi
    lower, upper = BOUNDS.box
    at_bound = (config[:, 3:] == lower) | (config[:, 3:] == upper)
    assert np.all(np.mean(at_bound, axis=0) > 0.1)
    assert np.max(np.sum(at_bound, axis=1)) >= 5
    assert np.mean(np.abs(chi[:, 4]) > 0.5 - 1e-3) > 0.2
    assert np.mean(np.abs(np.linalg.norm(zeta[:, :3], axis=1) - 0.25) < 1e-12) > 0.4
    for depth in (-0.01, DEEPEST):
        assert np.mean(np.abs(chi[:, 0] - depth) < 1e-12) > 0.05
    inside = ~np.any(at_bound, axis=1) & (np.abs(chi[:, 4]) < 0.45)
    assert np.mean(inside) > 0.02


def test_the_force_of_a_spring_is_bounded_and_the_bound_is_reached(in_spring):
    config, zeta = BOUNDS.sample(in_spring, 1000, np.random.default_rng(1))
    chi = in_spring.kinematics(config).chi
    force = np.linalg.norm(in_spring.surface.force(chi, np.zeros_like(chi))[:, :3], axis=1)
    assert np.max(force) == pytest.approx(40.0)
    assert np.min(force) < 10.0
    assert np.all(contains(BOUNDS, in_spring, config, zeta))


@pytest.mark.parametrize("shift", range(3, 20))
def test_a_state_outside_one_bound_is_not_contained(model, drawn, shift):
    state = np.concatenate([drawn[0][0], drawn[1][0]])
    assert contains(BOUNDS, model, state[None, :10], state[None, 10:])[0]
    state[shift] += 5.0
    assert not contains(BOUNDS, model, state[None, :10], state[None, 10:])[0]


def test_depth_and_tip_pitch_count(model):
    y = np.zeros((3, 10))
    y[:, 6:] = [0.0, 0.9, 0.2, 0.0]
    y[1, 0], y[2, 4] = DEEPEST + 0.001, 0.51
    loose = replace(BOUNDS, roll=1.5, pitch=1.5, yaw=np.pi)
    inside = contains(loose, model, model.configuration(y), np.zeros((3, 10)))
    assert list(inside) == [True, False, False]


@pytest.mark.parametrize("angle", [0.1, 0.3])
def test_the_tool_keeps_its_angle_at_the_best_heading(model, angle):
    """The direction points down by 0.2 rad; a sample is turned to the best heading."""
    bounds = replace(BOUNDS, yaw=np.pi, tool=(0.2, angle))
    config, _ = bounds.sample(model, 500, np.random.default_rng(3))
    x_E = model.kinematics(config).A_E[:, :3, 0]
    heading = np.arctan2(x_E[:, 1], x_E[:, 0])
    n = np.stack([np.cos(0.2) * np.cos(heading), np.cos(0.2) * np.sin(heading),
                  np.full(500, np.sin(0.2))], axis=1)
    off = np.arccos(np.clip(np.sum(n * x_E, axis=1), -1.0, 1.0))
    assert np.max(off) <= angle + 1e-6
    assert np.mean(off > 0.98 * angle) > 0.1
    chi = model.kinematics(bounds.centre(model)[None] @ np.eye(7, 10, 3)).chi
    assert np.max(np.abs(bounds.normalised_tip(model, chi)[:, :2])) < 0.9


def test_points_outside_are_moved_just_inside_and_others_stay():
    x = np.array([[0.5, 0.0], [3.0, 0.0], [0.0, -2.0]])
    out = pulled(lambda x: np.linalg.norm(x, axis=1) <= 1.0, x, np.zeros(2), 20)
    np.testing.assert_allclose(out, [[0.5, 0.0], [1.0, 0.0], [0.0, -1.0]], atol=1e-5)
    assert np.all(np.linalg.norm(out, axis=1) <= 1.0)


def test_a_tip_pitch_that_nothing_can_keep_is_reported():
    tilted = tiny_robot([[1.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]], (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    bounds = ConstraintSet(np.zeros(1), np.zeros(1), 0.0, 0.3, 0.6, 0.1, 0.1, 0.1)
    with pytest.raises(InvalidParameter, match="tip_pitch"):
        bounds.sample(tilted, 10, np.random.default_rng(0))
    assert len(bounds.sample(drill(), 10, np.random.default_rng(0))[0]) == 10


@pytest.mark.parametrize("change", [
    {"roll": -0.1}, {"pitch": 1.6}, {"tip_pitch": 0.0}, {"nu1": 0.0}, {"qdot": np.inf},
    {"yaw": 4.0}, {"q_upper": np.full(4, -1.0)}, {"force_max": -1.0}])
def test_a_bound_without_meaning_is_reported_by_its_name(change):
    with pytest.raises(InvalidParameter, match=next(iter(change))):
        replace(BOUNDS, **change)
