"""Tests of `uvms_drake.tube.contact.sensor_gains_proof` and of the enclosures that it rests on."""

from pathlib import Path

import numpy as np
import pytest
from support.arms import write_arm

from uvms_drake.model.frames.euler import COMPLEX_STEP
from uvms_drake.model.uvms_model import UvmsModel, read_uvms
from uvms_drake.tube.contact import sensor_gains_proof
from uvms_drake.tube.contact.enclosure import (
    Enclosure,
    links_in_boxes,
    second_of_inertia,
    second_of_links,
    second_of_tip,
)
from uvms_drake.tube.contact.gain_expansions import expansions
from uvms_drake.tube.contact.sensor_gains import (
    norms_over_joints,
    tip_and_slopes,
    tip_jacobian_and_gain,
)
from uvms_drake.tube.contact.sensor_gains_proof import (
    PROVABLE,
    Claimed,
    bounds,
    claimed_suprema,
    corners_of_cone,
    proof_of,
)
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.joint_search import supremum_over_joints

ANGLE = 0.25
WORK = 10**6


@pytest.fixture(scope="module", params=["girona", "telescope"])
def robot(request, model, tmp_path_factory) -> UvmsModel:
    """A Girona 500, and a box with three joints of which the last slides."""
    if request.param == "girona":
        return model
    folder: Path = tmp_path_factory.mktemp("robots")
    return UvmsModel(read_uvms(str(write_arm(folder, 3, telescope=True))))


def box_of(robot: UvmsModel, half: float) -> tuple[np.ndarray, np.ndarray]:
    """Returns a box of joints [rad, m]."""
    centre = np.array([0.0, 0.95, 0.45, 0.0])[: robot.num_joints]
    return centre - half, centre + half


def set_of(lower: np.ndarray, upper: np.ndarray) -> ConstraintSet:
    return ConstraintSet(q_lower=lower, q_upper=upper, roll=0.15, pitch=0.15, tip_pitch=0.4,
                         nu1=0.15, nu2=0.1, qdot=0.3)


def boxes_in(robot: UvmsModel, count: int, rng: np.random.Generator
             ) -> tuple[np.ndarray, np.ndarray]:
    """Returns centres and half widths (count, n) of boxes of several sizes."""
    lower, upper = box_of(robot, 0.5)
    half = np.repeat([0.003, 0.03, 0.1, 0.6], count // 4)[:, None]
    return rng.uniform(lower, upper, (count, len(lower))), half * np.ones(len(lower))


def at(robot: UvmsModel, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the links' Jacobians and M at joints (m, n), maybe complex."""
    config = np.concatenate([np.zeros((len(q), 6)), q], axis=1)
    kinematics = robot.kinematics(config)
    return kinematics.J_links, robot.mass_matrix(kinematics)


def slopes(robot: UvmsModel, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the derivatives (m, n, ...) of both by complex steps."""
    each = [at(robot, q + 1j * COMPLEX_STEP * e) for e in np.eye(q.shape[1])]
    first, second = (np.stack([part.imag for part in parts], axis=1) / COMPLEX_STEP
                     for parts in zip(*each, strict=True))
    return first, second


def test_boxes_hold_jacobians_and_two_derivatives_of_all_joints_in_them(robot):
    """In any columns T; values and first derivatives of the model's own, second ones of those."""
    rng = np.random.default_rng(1)
    centre, half = boxes_in(robot, 24, rng)
    T = np.eye(robot.size) + 0.3 * rng.normal(size=(24, robot.size, robot.size))
    J_E, links = links_in_boxes(robot, centre, half, T)
    second = second_of_links(links)
    in_pairs, M_second = second_of_tip(J_E), second_of_inertia(robot, links, second)
    step, T_link = 1e-5, T[:, None]
    for _ in range(15):
        q = centre + half * np.clip(rng.uniform(-2.0, 2.0, half.shape), -1.0, 1.0)
        J_here, _ = at(robot, q)
        J_by, _ = slopes(robot, q)
        assert_held(J_here[:, -1], J_E)
        for k, link in enumerate(links, start=1):
            assert_held(J_here[:, k] @ T, link.J)
            assert_held(J_by[:, :k, k] @ T_link, link.first)
        for pair, (i, j) in enumerate(zip(*np.tril_indices(robot.num_joints), strict=True)):
            e = np.eye(robot.num_joints)[j]
            ahead, behind = (slopes(robot, q + sign * step * e) for sign in (1.0, -1.0))
            J_two, M_two = ((a[:, i] - b[:, i]) / (2.0 * step)
                            for a, b in zip(ahead, behind, strict=True))
            assert_held(J_two[:, -1], in_pairs[:, pair], 1e-7)
            assert_held(J_two[:, i + 1:] @ T_link, second[i][:, :, :, j], 1e-7)
            assert_held(T.swapaxes(1, 2) @ M_two @ T, M_second[:, pair], 1e-4)


def test_expansions_have_the_values_and_slopes_of_the_models_own(robot):
    """S over G and its derivatives by complex steps; no second one in a box is above the largest.

    Second ones of boxes: by differences, at random joints in them.
    """
    rng = np.random.default_rng(5)
    centre, half = boxes_in(robot, 24, rng)
    found = expansions(robot, centre, half)

    def S_over_G(q: np.ndarray) -> np.ndarray:
        J_E, G = tip_jacobian_and_gain(robot, q)
        return np.concatenate([J_E @ G, G], axis=-2)

    def slopes_at(q: np.ndarray) -> np.ndarray:
        moved = q[:, None] + 1j * COMPLEX_STEP * np.eye(robot.num_joints)
        return S_over_G(moved).imag / COMPLEX_STEP

    np.testing.assert_allclose(found.gains.value, S_over_G(centre), atol=1e-12)
    np.testing.assert_allclose(found.gains.first, slopes_at(centre), atol=1e-12)
    np.testing.assert_allclose(found.J_E.value, tip_jacobian_and_gain(robot, centre)[0],
                               atol=1e-12)
    np.testing.assert_allclose(found.J_E.first, slopes(robot, centre)[0][:, :, -1], atol=1e-12)
    J_E, G, J_by, G_by = tip_and_slopes(robot, centre)
    np.testing.assert_allclose(J_E, found.J_E.value, atol=1e-12)
    np.testing.assert_allclose(J_by, found.J_E.first, atol=1e-12)
    np.testing.assert_allclose(G, S_over_G(centre)[:, 6:], atol=1e-12)
    np.testing.assert_allclose(G_by, slopes_at(centre)[:, :, 6:], atol=1e-12)
    step = 1e-5
    for _ in range(15):
        q = centre + half * rng.uniform(-1.0, 1.0, half.shape)
        for pair, (i, j) in enumerate(zip(*np.tril_indices(robot.num_joints), strict=True)):
            e = step * np.eye(robot.num_joints)[j]
            two = (slopes_at(q + e)[:, i] - slopes_at(q - e)[:, i]) / (2.0 * step)
            assert np.all(np.isnan(found.gains.second[:, pair])
                          | (np.abs(two) <= found.gains.second[:, pair] + 1e-6))


def assert_held(values: np.ndarray, by: Enclosure, rounding: float = 1e-12) -> None:
    """Checks that values are members, and that the narrowest enclosures say something."""
    assert np.all(np.abs(values - by.mid) <= by.rad + rounding)
    assert np.max(by.rad[0]) <= 0.5 * np.max(np.abs(by.mid[0]), initial=1.0)


def test_no_joints_and_no_normal_in_a_box_have_more_than_its_bounds(robot):
    rng = np.random.default_rng(2)
    centre, half = boxes_in(robot, 24, rng)
    found = bounds(robot, centre, half, corners_of_cone(ANGLE), np.zeros(PROVABLE))
    sizes, _ = norms_over_joints(robot, set_of(*box_of(robot, 0.5)), ANGLE)
    n_is_x = np.zeros((24, 2))
    np.testing.assert_allclose(
        found.value, sizes(np.concatenate([centre, n_is_x], axis=1))[:, :PROVABLE],
        rtol=1e-6, atol=1e-9)
    for _ in range(200):
        q = centre + half * np.clip(rng.uniform(-2.0, 2.0, half.shape), -1.0, 1.0)
        n = rng.uniform([0.0, 0.0], [ANGLE, 2.0 * np.pi], (24, 2))
        value = sizes(np.concatenate([q, n], axis=1))[:, :PROVABLE]
        assert np.all(value <= found.upper * (1.0 + 1e-9) + 1e-12)
    # Those that need not be close are larger, but not above the claims.
    claims = 1.1 * np.max(found.value, axis=0)
    enough = bounds(robot, centre, half, corners_of_cone(ANGLE), claims).upper
    assert np.all(enough >= found.upper * (1.0 - 1e-12))
    assert np.all((enough <= claims) | (enough <= found.upper * (1.0 + 1e-12)))
    assert np.any(enough > found.upper * 1.001)
    # The smallest boxes have hardly more than their centres, but for n and derivatives.
    alone = [0, 1, 3, *range(9, PROVABLE, 4)]
    assert np.all(found.upper[:6, alone] <= 1.05 * found.value[:6, alone] + 1e-3)


def test_directions_of_a_cone_are_in_the_hull_of_its_corners():
    """None has more along any direction than the corners have: a separating plane would."""
    rng = np.random.default_rng(3)
    for angle in (0.0, 0.1, 0.9, 1.5):
        about = rng.uniform(0.0, 2.0 * np.pi, 3000)
        off = angle * rng.uniform(0.0, 1.0, 3000)
        n = np.stack([np.cos(off), np.sin(off) * np.cos(about), np.sin(off) * np.sin(about)], -1)
        along = rng.normal(size=(2000, 3))
        most = np.max(along @ corners_of_cone(angle).T, axis=1)
        assert np.all(np.max(along @ n.T, axis=1) <= most + 1e-12)


def test_what_is_true_is_proven_what_is_false_is_refuted_and_what_is_close_is_left(robot):
    lower, upper = box_of(robot, 0.08)
    sizes, box = norms_over_joints(robot, set_of(lower, upper), ANGLE)
    worst = supremum_over_joints(sizes, *box)[:PROVABLE]
    true = 1.1 * worst
    true[[2, 4]] *= sensor_gains_proof.SLOPES_OF_J
    true[8::4] *= sensor_gains_proof.SLOPES_OF_A
    proof = proof_of(robot, lower, upper, ANGLE, true, WORK)
    assert proof.proven
    assert proof.boxes > 1
    assert 0.85 < np.max(proof.largest) <= 1.0
    # Every column's claim has a part in it: twice the boxes that do for all do not for less of one.
    twice = 2 * proof.boxes * 4 ** robot.num_joints
    for column in np.flatnonzero(worst > 0.0):
        less = true.copy()
        less[column] = 0.97 * worst[column]
        assert not proof_of(robot, lower, upper, ANGLE, less, twice).proven, column
    small = 0.5 * true
    assert np.max(proof_of(robot, lower, upper, ANGLE, small, WORK).largest) > 1.0
    assert not proof_of(robot, lower, upper, ANGLE, true, 0).proven


def test_what_is_claimed_is_the_search_times_its_factors_and_says_what_is_estimated(
        model, monkeypatch):
    lower, upper = box_of(model, 0.06)
    sizes, box = norms_over_joints(model, set_of(lower, upper), ANGLE)
    worst = supremum_over_joints(sizes, *box)
    monkeypatch.setattr(sensor_gains_proof, "supremum_over_joints", lambda *_: worst)

    def claimed(factor: float) -> Claimed:
        return claimed_suprema(model, set_of(lower, upper), ANGLE, safety_factor=factor)

    found = claimed(1.2)
    assert found.proven
    assert found.suprema.turning == pytest.approx(1.2 * worst[0])
    assert found.suprema.position.force == pytest.approx(1.2 * worst[9])
    assert found.suprema.position.by_joints == pytest.approx(
        1.2 * sensor_gains_proof.SLOPES_OF_A * worst[12])
    least, most = found.check()  # Of the rows of ζ̇: 1 / 1.2, if both searches find all.
    assert 0.8 < least.ratio <= most.ratio < 0.85
    # What is false is refuted by the proof, or else by the second search.
    refuted = claimed(0.5)
    assert not refuted.proven
    assert refuted.check()[-1].ratio > 1.0
    monkeypatch.setattr(sensor_gains_proof, "MOST_WORK", 0)
    left = claimed(0.8)
    assert not left.proven
    assert left.check()[-1].ratio > 1.0


def test_jacobians_turn_no_faster_than_the_suprema_say(model):
    """‖J̇_v‖ in Σ_I, ‖ν₂‖‖J_v‖ + ‖q̇‖(Σ‖∂J_v/∂qᵢ‖²)^½, against the model's own rate."""
    rng = np.random.default_rng(4)
    lower, upper = box_of(model, 0.3)
    within = set_of(lower, upper)
    sizes, box = norms_over_joints(model, within, ANGLE)
    worst = supremum_over_joints(sizes, *box)
    config, zeta = within.sample(model, 3000, rng)
    rate = model.task_jacobian_rate(model.kinematics(config), zeta)[:, :3]
    bound = (np.linalg.norm(zeta[:, 3:6], axis=1) * worst[1]
             + np.linalg.norm(zeta[:, 6:], axis=1) * worst[2])
    share = np.linalg.norm(rate, 2, axis=(1, 2)) / bound
    assert 0.6 < np.max(share) <= 1.0
