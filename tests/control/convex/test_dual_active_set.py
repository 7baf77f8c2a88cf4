"""Tests of `uvms_drake.control.convex.dual_active_set`: conditions of an optimum, and Clarabel."""

import numpy as np
import pytest
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from uvms_drake.control.convex.dual_active_set import DualActiveSet


def random_polyhedron(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Returns E, e, G, b in eight dimensions; some are empty, some have rows twice or nearly so."""
    rng = np.random.default_rng(seed)
    E, G = rng.normal(size=(seed % 3, 8)), rng.normal(size=(30, 8))
    G[10:14] = 3.0 * G[:4]
    G[14:18] = G[:4] + 1e-9 * rng.normal(size=(4, 8))
    G[18:20] = G[:2] + G[2:4]
    b = rng.uniform(-1.0, 1.0, size=30) + (0.5, 0.9, 1.5)[seed // 3 % 3]
    b[10:14], b[14:18], b[18:20] = 3.0 * b[:4], b[:4], b[:2] + b[2:4]
    return E, rng.normal(size=len(E)), G * np.exp(rng.normal(size=(30, 1))), b


def is_empty(E: np.ndarray, e: np.ndarray, G: np.ndarray, b: np.ndarray) -> bool:
    """Returns whether no r keeps the rows by more than rounding, by another solver."""
    prog = MathematicalProgram()
    r, slack = prog.NewContinuousVariables(E.shape[1]), prog.NewContinuousVariables(1)
    if len(E):
        prog.AddLinearEqualityConstraint(E, e, r)
    prog.AddLinearConstraint(np.hstack([G, np.ones((len(G), 1))]), np.full(len(b), -np.inf), b,
                             np.append(r, slack))
    prog.AddBoundingBoxConstraint(-1.0, 1.0, slack)
    prog.AddLinearCost(-slack[0])
    result = ClarabelSolver().Solve(prog)
    return bool(not result.is_success() or result.GetSolution(slack)[0] < -1e-6)


def test_random_polyhedra_have_an_optimum_or_are_empty():
    """The conditions of an optimum are enough for one, and it is the only one."""
    kinds = []
    for seed in range(90):
        E, e, G, b = random_polyhedron(seed)
        polyhedron = DualActiveSet(E, e)
        polyhedron.add(G, b)
        found = polyhedron.least_norm()
        kinds.append(found is None)
        assert is_empty(E, e, G, b) == (found is None)
        if found is None:
            continue
        r, multipliers = found
        of_rows = multipliers[len(e):]
        np.testing.assert_allclose(r, -np.concatenate([E, G]).T @ multipliers, atol=1e-7)
        np.testing.assert_allclose(E @ r, e, atol=1e-7)
        assert np.max(G @ r - b) < 1e-7
        assert np.min(of_rows) > -1e-9
        assert np.max(of_rows * (b - G @ r)) < 1e-6 * max(1.0, np.max(of_rows))
    assert min(np.count_nonzero(kinds), np.count_nonzero(np.invert(kinds))) > 15


def test_rows_added_later_lead_to_the_same():
    """With the rows that hold already as a start."""
    for seed in (7, 8, 16):
        E, e, G, b = random_polyhedron(seed)
        whole, bit_by_bit = DualActiveSet(E, e), DualActiveSet(E, e)
        whole.add(G, b)
        for rows in np.split(np.arange(30), 5):
            bit_by_bit.add(G[rows], b[rows])
            found = bit_by_bit.least_norm()
        r, _ = whole.least_norm()
        assert np.linalg.norm(r) > 0.01
        np.testing.assert_allclose(found[0], r, atol=1e-7)


@pytest.mark.parametrize("distance", [1.0, 1e-3])
def test_the_corner_of_two_walls(distance):
    """The closed form: r to the corner, and no row that does not matter has a price."""
    polyhedron = DualActiveSet(np.zeros((0, 3)), np.zeros(0))
    polyhedron.add(np.array([[-2.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]),
                   distance * np.array([-2.0, -3.0, 1.0]))
    r, multipliers = polyhedron.least_norm()
    np.testing.assert_allclose(r, distance * np.array([1.0, 3.0, 0.0]), rtol=1e-12)
    np.testing.assert_allclose(multipliers, distance * np.array([0.5, 3.0, 0.0]), rtol=1e-12)


def test_dependent_equalities_have_no_answer():
    polyhedron = DualActiveSet(np.array([[1.0, 0.0], [1.0, 0.0]]), np.array([1.0, 2.0]))
    assert polyhedron.least_norm() is None


def test_what_is_returned_is_an_optimum_even_of_rows_that_are_nearly_equal():
    """Rounding makes some multipliers negative there; then there is no answer."""
    answers = 0
    for seed in range(150):
        rng = np.random.default_rng(seed)
        pairs = rng.normal(size=(4, 12))
        tight = np.vstack([pairs, pairs + 3e-5 * rng.normal(size=pairs.shape)])
        r = -tight.T @ (100.0 * rng.uniform(0.1, 1.0, size=8))
        free = rng.normal(size=(10, 12))
        G, b = np.vstack([tight, free]), np.append(tight @ r, free @ r + rng.uniform(size=10))
        polyhedron = DualActiveSet(np.zeros((0, 12)), np.zeros(0))
        polyhedron.add(G, b)
        found = polyhedron.least_norm()
        if found is not None:
            answers += 1
            assert np.min(found[1]) >= -1e-8 * np.max(found[1])
            assert np.max(G @ found[0] - b) < 1e-6
    assert answers > 80


@pytest.mark.parametrize(("row", "bound"), [([1.0, 0.0], np.nan), ([np.nan, 0.0], 1.0)])
def test_what_is_no_number_has_no_answer(row, bound):
    polyhedron = DualActiveSet(np.zeros((0, 2)), np.zeros(0))
    polyhedron.add(np.array([row, [0.0, 1.0]]), np.array([bound, -1.0]))
    with np.errstate(invalid="ignore"):
        assert polyhedron.least_norm() is None
