"""Tests of `uvms_drake.tube.covering`."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from support.tiny_robots import drill, drill_attitude_norm, oblique, telescope, turret

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.surface.law import check_surface
from uvms_drake.tube.constants import norms as norms_of
from uvms_drake.tube.covering import BATCH, BLOCKS, PROVABLE, JacobianBoxes, cover, prove_constants
from uvms_drake.tube.search.constraint_set import ConstraintSet

BOUNDS = ConstraintSet(
    q_lower=np.array([-0.4, 0.6, -0.1, -0.8]), q_upper=np.array([0.4, 1.3, 0.72, 0.8]), roll=0.3,
    pitch=0.15, tip_pitch=0.4, nu1=0.25, nu2=0.2, qdot=0.3)
WEIGHTS = np.array([0.1, 0.05, 0.2, 0.3, 0.1, 0.15, 1.0, 0.8, 0.6, 0.9])
"""A scale for each channel: the joints' are larger than the hull's, and no two are alike."""
SKEW = ConstraintSet(-np.ones(2), np.ones(2), 0.4, 0.3, 0.9, 0.1, 0.1, 0.1)
ROWS = {"position": slice(0, 3), "attitude": slice(3, 6), "task": slice(0, 6)}
NAMED_ROWS = {name: ROWS[block] for name, block in PROVABLE.items()} | {"Jx_max": slice(None)}


@pytest.fixture(scope="module")
def proven(model):
    return prove_constants(model, BOUNDS, tuple(PROVABLE))


@pytest.fixture(scope="module")
def weighted(model):
    return prove_constants(model, BOUNDS, tuple(PROVABLE), weights=WEIGHTS)


def norms(model, rows: slice, config: np.ndarray, weights=1.0) -> np.ndarray:
    J = model.task_jacobian(config)[:, rows] @ np.diag(weights * np.ones(model.size))
    return np.linalg.norm(J, ord=2, axis=(1, 2))


def coordinates(model, bounds: ConstraintSet, boxes: JacobianBoxes, count: int
                ) -> tuple[np.ndarray, np.ndarray]:
    """Returns states 𝔮 of the set and their coordinates (q, −φ, θ), as `boxes` wants them."""
    config, _ = bounds.sample(model, count, np.random.default_rng(8))
    chi = model.kinematics(config).chi
    x = np.concatenate([config[:, 6:], -chi[:, 3:4], chi[:, 4:5]], axis=1)
    still = boxes.lower == boxes.upper
    if still[-1]:  # the position rows do not ask for attitude
        x[:, -2:] = 0.0
    elif still[-3]:  # the last joint turns the tool: its angle goes to −φ
        x[:, -2] += x[:, -3] - boxes.lower[-3]
        x[:, -2] = (x[:, -2] + np.pi) % (2.0 * np.pi) - np.pi
    x[:, still] = boxes.lower[still]
    return config, x


def arm_and_bounds(robot: str, model) -> tuple[ContactModel, ConstraintSet]:
    """Returns a robot and a set for it."""
    return {
        "girona": lambda: (model, BOUNDS),
        "oblique": lambda: (oblique(), SKEW),
        **{f"slide {i + 1}": lambda i=i: (telescope(i), replace(
            SKEW, q_lower=-np.ones(3), q_upper=np.ones(3))) for i in range(3)},
        "turret": lambda: (turret(0.8), replace(SKEW, q_lower=-np.ones(1), q_upper=np.ones(1))),
        "drill": lambda: (drill(), replace(SKEW, q_lower=-np.ones(1), q_upper=np.ones(1))),
    }[robot]()


def check_boxes_about_states(arm, bounds: ConstraintSet, block: str, seed: int,
                             weights=1.0) -> None:
    """Checks boxes of all sizes about feasible states, each at 120 points of it."""
    boxes = JacobianBoxes(arm, bounds, block, weights)
    _, x = coordinates(arm, bounds, boxes, 500)
    rng = np.random.default_rng(seed)
    for _ in range(40):
        half = 10.0 ** rng.uniform(-2.0, 0.0) * rng.uniform(0.2, 1.0, x.shape[1])
        half[boxes.lower == boxes.upper] = 0.0
        half[-1] = min(half[-1], 0.6)
        centre = x[rng.integers(len(x))] + rng.uniform(-1.0, 1.0, x.shape[1]) * half
        centre[-1] = np.clip(centre[-1], -1.2 + half[-1], 1.2 - half[-1])
        shift = rng.choice([-1.0, 1.0], (120, x.shape[1]))
        shift[40:] *= rng.uniform(size=(80, x.shape[1]))
        assert_bounded(boxes, centre, half, shift)


def assert_bounded(boxes: JacobianBoxes, centre: np.ndarray, half: np.ndarray,
                   shift: np.ndarray) -> int:
    """Checks a box at centre + shift · half and returns how many of these points are feasible."""
    found = boxes.bounds(centre[None], half[None])
    points = boxes.bounds(centre + shift * half, np.zeros_like(shift)).reached
    assert max(np.max(points), found.reached[0]) <= found.upper[0] + 1e-9
    return int(np.sum(points > 0.0))


@pytest.mark.parametrize("block", BLOCKS)
@pytest.mark.parametrize("robot", ["girona", "oblique", "turret", "drill", *(
    pytest.param(f"slide {i}", marks=[pytest.mark.slow, pytest.mark.long]) for i in (1, 2, 3))])
def test_the_bound_of_a_box_holds_at_the_states_in_it(model, block, robot):
    check_boxes_about_states(*arm_and_bounds(robot, model), block, seed=9)


@pytest.mark.parametrize("frame", [(0.0, -0.3, 0.0), (0.2, -0.8, 0.4), (0.0, -0.5 * np.pi, 0.0)])
def test_every_state_is_in_the_half_spaces_of_a_task_with_a_frame_of_its_own(uvms, plane, frame):
    arm, widest = ContactModel(uvms, check_surface(plane), np.array(frame)), BOUNDS
    if frame[1] < -1.0:  # The forearm down.
        widest = replace(BOUNDS, q_lower=np.array([-0.4, -0.1, -0.5, -0.8]),
                         q_upper=np.array([0.4, 0.4, 0.2, 0.8]))
    boxes = JacobianBoxes(arm, widest, "task")
    config, x = coordinates(arm, widest, boxes, 200)
    at_states = boxes.bounds(x, np.zeros_like(x)).reached  # −∞ where it is not in a half-space
    np.testing.assert_allclose(at_states, norms(arm, ROWS["task"], config), rtol=1e-6)
    bound = cover(boxes, np.max(at_states), 300).upper
    assert np.max(at_states) <= bound < 1.5 * np.max(at_states)
    anywhere = np.random.default_rng(3).uniform(boxes.lower, boxes.upper, (200, len(boxes.lower)))
    excluded = np.mean(np.isinf(boxes.bounds(anywhere, np.zeros_like(anywhere)).reached))
    assert (excluded > 0.1) == (frame[1] > -1.0)  # Of a floor they say nothing.


@pytest.mark.parametrize("block", ["attitude", "task"])
@pytest.mark.parametrize("robot", ["oblique", "turret"])
def test_the_weighted_bound_of_a_box_holds_at_the_states_in_it(model, block, robot):
    arm, bounds = arm_and_bounds(robot, model)
    check_boxes_about_states(arm, bounds, block, seed=9, weights=WEIGHTS[: arm.size])


@pytest.mark.parametrize("robot", ["girona", "oblique"])
def test_large_multipliers_give_a_bound_where_only_curvature_makes_a_state_feasible(
        model, robot, monkeypatch):
    """Boxes wide in one coordinate, about centres where one g_k is positive and hardly slopes."""
    arm, bounds = arm_and_bounds(robot, model)
    boxes = JacobianBoxes(arm, bounds, "task")
    rng = np.random.default_rng(18)
    centres = rng.uniform(boxes.lower, boxes.upper, (60_000, len(boxes.lower)))
    axes, _, _, C = boxes._geometry(centres)
    g = boxes._constraints(axes, C, np.tile(centres[:, -1], (2, 1)), 0.0 * centres[:, :-1])
    steps = np.tile(np.linspace(-1.0, 1.0, 41)[:, None], (1, centres.shape[1]))
    checked = 0
    for k in range(5):
        value, flat = g.value[0, :, k], np.abs(g.slope[0, :, k]) < 0.05
        others = np.all(np.delete(g.value[0], k, axis=1) < 0.0, axis=1)
        monkeypatch.setattr("uvms_drake.tube.covering._multipliers", only(k))
        for i in boxes._free:
            half = np.zeros(centres.shape[1])
            half[i] = 0.3
            for centre in centres[others & (value > 0.0) & (value < 0.02) & flat[:, i]][:20]:
                checked += assert_bounded(boxes, centre, half, steps) > 0
    assert checked > 20


def test_a_constraint_is_above_its_chord_in_tan_theta_less_an_eighth_of_the_square(model):
    boxes = JacobianBoxes(model, BOUNDS, "task")
    rng = np.random.default_rng(19)
    centres = rng.uniform(boxes.lower, boxes.upper, (20_000, 6))
    axes, _, _, C = boxes._geometry(centres)
    t = np.sort(np.tan(rng.uniform(-1.4, 1.4, (2, 20_000))), axis=0)
    share = rng.uniform(size=20_000)
    between = share * t[0] + (1.0 - share) * t[1]
    h = 0.0 * centres[:, :-1]
    ends = boxes._constraints(axes, C, np.arctan(t), h).value
    inner = boxes._constraints(axes, C, np.arctan(np.stack([between, between])), h).value[0]
    chord = share[:, None] * ends[0] + (1.0 - share)[:, None] * ends[1]
    assert np.all(inner >= chord - (t[1] - t[0])[:, None] ** 2 / 8.0)
    assert np.any(inner < chord - 0.9 * (t[1] - t[0])[:, None] ** 2 / 8.0)


def only(k: int) -> Callable:
    """Returns multipliers that are zero but for a very large one of the k-th constraint."""
    def multipliers(K, g, h, chord):
        mu = np.zeros(g.value.shape[1:])
        mu[:, k] = 1000.0
        return mu, np.zeros(g.slope.shape[:2] + g.slope.shape[3:])
    return multipliers


@pytest.mark.parametrize("weights", [np.ones(10), WEIGHTS], ids=["ball", "weighted"])
@pytest.mark.parametrize("robot", ["girona", "oblique", "turret", "drill", *(
    pytest.param(f"slide {i}", marks=[pytest.mark.slow, pytest.mark.long]) for i in (1, 2, 3))])
@pytest.mark.parametrize("block", ["attitude", "task"])
def test_the_remainder_of_the_taylor_series_is_bounded(model, robot, block, weights):
    """Of position rows, attitude rows and constraints, at states about a centre."""
    arm, bounds = arm_and_bounds(robot, model)
    weights = weights[: arm.size]
    boxes = JacobianBoxes(arm, bounds, block, weights)
    n, rng = arm.num_joints, np.random.default_rng(17)
    nearest = np.zeros(3)
    for _ in range(300):
        centre = rng.uniform(boxes.lower, boxes.upper)
        h = 10.0 ** rng.uniform(-1.5, 0.0) * (rng.uniform(size=n + 1) < 0.6)
        delta = h * rng.choice([-1.0, 1.0], size=(16, n + 1))
        moved = np.tile(centre, (17, 1))
        moved[1:, :-1] += delta
        axes, columns, p, C = boxes._geometry(moved)
        P = boxes._position_rows(axes, columns, p)
        Q = boxes._attitude_rows(axes, C)
        second = boxes._second_derivatives(columns[:1], h[None])
        g = boxes._constraints(axes, C, np.tile(centre[-1], (2, 17)), np.tile(h, (17, 1)))
        slack = g.value[0, 0] + delta @ g.slope[0, 0].T - g.value[0, 1:]
        for i, (actual, bound) in enumerate((
                (remainder(P * weights, delta), 0.5 * np.sqrt(second[0][0])),
                (remainder(Q * weights, delta), 0.5 * np.sqrt(second[1][0])),
                (np.max(slack / (g.remainder[0, 0] + 1e-12)), 1.0))):
            if i == 0 and block == "attitude":
                continue
            assert actual <= bound * (1.0 + 1e-6) + 1e-9
            if bound > 1e-6:
                nearest[i] = max(nearest[i], actual / bound)
    if block == "task" and robot == "turret":
        assert nearest[0] > 0.9
    if weights[5] < 1.0:
        assert nearest[1] > 0.2  # One factor has to do for the three columns of ν₂.
    elif (block, robot) != ("attitude", "drill"):  # There the rows do not change at all.
        assert nearest[1] > 0.5
    assert nearest[2] > 0.5


def remainder(rows: np.ndarray, delta: np.ndarray) -> float:
    """Returns the largest norm of K(x + δ) − K − Σ δᵢ∂ᵢK over the shifts δ (m, n+1)."""
    linear = rows[0, 0] + np.einsum("mi,irc->mrc", delta, rows[0, 1:])
    return float(np.max(np.linalg.norm(rows[1:, 0] - linear, ord=2, axis=(1, 2))))


@pytest.mark.parametrize("weights", [1.0, WEIGHTS], ids=["ball", "weighted"])
@pytest.mark.parametrize("block", BLOCKS)
def test_the_bound_of_a_point_is_its_norm(model, block, weights):
    boxes = JacobianBoxes(model, BOUNDS, block, weights)
    config, x = coordinates(model, BOUNDS, boxes, 200)
    found = boxes.bounds(x, np.zeros_like(x))
    np.testing.assert_allclose(found.upper, norms(model, ROWS[block], config, weights), rtol=1e-8)
    np.testing.assert_allclose(found.reached, found.upper, rtol=1e-8)


@pytest.mark.parametrize("block", BLOCKS)
def test_the_error_of_a_bound_is_of_second_order(model, block):
    """The bound less the largest value at 4000 states of the box, which is away from all limits."""
    boxes = JacobianBoxes(model, replace(BOUNDS, roll=1.5, pitch=1.5, tip_pitch=1.5), block)
    rng = np.random.default_rng(14)
    centre = np.array([0.1, 0.9, 0.3, 0.0, 0.3, 0.2])
    error = []
    for size in (0.1, 0.01):
        half = size * (boxes.upper > boxes.lower)
        x = centre + half * rng.choice([-1.0, 0.0, 1.0], (4000, 6))
        values = boxes.bounds(x, np.zeros_like(x)).upper
        error.append(boxes.bounds(centre[None], half[None]).upper[0] - np.max(values))
    assert 0.0 < error[1] < 0.02 * error[0]


def test_proven_is_above_every_sample_and_within_the_gap(model, proven):
    rng = np.random.default_rng(11)
    largest = dict.fromkeys(PROVABLE, 0.0)
    for _ in range(8):
        config, zeta = BOUNDS.sample(model, 5000, rng)
        for name in PROVABLE:
            largest[name] = max(largest[name], float(np.max(norms_of(name, model, config, zeta))))
    for name, constant in proven.items():
        assert constant.how == "proven" and constant.name == name
        assert 0.98 * constant.value / 1.03 < largest[name] <= constant.sampled_value * (1 + 1e-9)
        assert constant.sampled_value < constant.value <= 1.03 * constant.sampled_value * (1 + 1e-8)


def test_no_point_of_the_ellipsoid_is_taken_further_than_the_weighted_constant(model, weighted):
    """‖J_b d‖ of points d with ‖Ŵ⁻¹d‖ = 1, by multiplying; the worst one is of that length."""
    rng = np.random.default_rng(21)
    config, _ = BOUNDS.sample(model, 20_000, rng)
    points = rng.normal(size=(20_000, 10))
    points *= WEIGHTS / np.linalg.norm(points, axis=1)[:, None]
    for name, constant in weighted.items():
        rows = NAMED_ROWS[name]
        lengths = np.linalg.norm((model.task_jacobian(config) @ points[..., None])[:, rows, 0],
                                 axis=1)
        assert np.max(lengths) < constant.value <= 1.03 * constant.sampled_value * (1.0 + 1e-8)
        assert np.max(lengths) > 0.6 * constant.value


@pytest.mark.parametrize("length", [0.3, 1.5])
def test_the_turret_has_the_bound_that_is_written_down(length, monkeypatch):
    monkeypatch.setattr("uvms_drake.tube.covering.GAP", 1e-4)
    bounds = ConstraintSet(np.array([-1.0]), np.array([1.0]), 0.1, 0.1, 0.5, 0.1, 0.1, 0.1)
    found = prove_constants(turret(length), bounds, ("J_position_max",))
    exact = np.sqrt(1.0 + 2.0 * length**2)
    assert exact <= found["J_position_max"].value <= exact * 1.0002


@pytest.mark.parametrize(("pitch", "tip_pitch"), [(0.6, 0.4), (0.4, 0.6), (0.0, 0.6)])
def test_the_drill_has_the_bound_that_is_written_down(pitch, tip_pitch, monkeypatch):
    """Its tip pitches as the vehicle does, so the smaller of the two limits decides."""
    monkeypatch.setattr("uvms_drake.tube.covering.GAP", 0.003)
    bounds = ConstraintSet(np.array([-1.0]), np.array([1.0]), 0.2, pitch, tip_pitch, 0.1, 0.1, 0.1)
    found = prove_constants(drill(), bounds, ("J_attitude_max",))
    exact = drill_attitude_norm(min(pitch, tip_pitch))
    assert exact * (1.0 - 1e-9) <= found["J_attitude_max"].value <= exact * 1.0035


def test_an_arm_without_special_geometry_is_covered_too(monkeypatch):
    monkeypatch.setattr("uvms_drake.tube.covering.GAP", 0.1)
    model = oblique()
    config, zeta = SKEW.sample(model, 20_000, np.random.default_rng(13))
    for name, constant in prove_constants(model, SKEW, tuple(PROVABLE)).items():
        values = norms_of(name, model, config, zeta)
        assert np.max(values) <= constant.value <= 1.1001 * constant.sampled_value


def test_an_arm_of_many_joints_has_a_budget_of_fewer_boxes(model, monkeypatch):
    # So many boxes: of q1, q2, q3 and φ, 16 vertices, of 3 rows.
    monkeypatch.setattr("uvms_drake.tube.covering.MOST_WORK", 300 * 16 * 3)
    found = prove_constants(model, BOUNDS, ("J_attitude_max",))["J_attitude_max"]
    assert 300 <= found.samples < 300 + 2 * BATCH


def test_an_empty_set_is_reported(model):
    """The arm hangs down by more than vehicle and end-effector may pitch."""
    empty = replace(BOUNDS, q_lower=np.array([-0.1, -0.1, -1.2, 0.0]),
                    q_upper=np.array([0.1, 0.0, -1.1, 0.1]), roll=0.05, pitch=0.05, tip_pitch=0.1)
    with pytest.raises(InvalidParameter, match="tip_pitch"):
        cover(JacobianBoxes(model, empty, "attitude"), 0.0, 20_000)
