"""Tests of `uvms_drake.control.convex.dual_active_set`: conditions of an optimum, and Clarabel."""

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from uvms_drake.control.convex.dual_active_set import BROKEN, NO_ROWS, Multipliers, multipliers


def least_norm_point(G: np.ndarray, b: np.ndarray, equalities: int = 0,
                     active: np.ndarray = NO_ROWS) -> tuple[np.ndarray, Multipliers] | None:
    """Returns the least-norm r (n,) and its multipliers; see `multipliers`.

    Args:
        G: Rows (m, n), none of which is zero.
        b: Their values (m,).
        equalities: Number of equalities, which come first.
        active: Guess of the active rows but for the equalities.
    """
    size = np.linalg.norm(G, axis=1)
    G, b = G / size[:, None], b / size
    found = multipliers(G @ G.T, b, equalities, BROKEN / size, active)
    return None if found is None else (
        -(found.value @ G), found._replace(value=found.value / size))


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
        found = least_norm_point(np.vstack([E, G]), np.append(e, b), len(e))
        kinds.append(found is None)
        assert is_empty(E, e, G, b) == (found is None)
        if found is None:
            continue
        r, multipliers = found[0], found[1].value
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
        G, b, active = np.vstack([E, G]), np.append(e, b), NO_ROWS
        for count in range(6, 31, 6):
            found = least_norm_point(
                G[: len(e) + count], b[: len(e) + count], len(e), active)
            active = found[1].active
        r, _ = least_norm_point(G, b, len(e))
        assert np.linalg.norm(r) > 0.01
        np.testing.assert_allclose(found[0], r, atol=1e-7)


def test_of_equal_rows_the_first_is_active():
    rows = np.array([[1.0, 0.0], [2.0, 0.0], [1.0, 0.0]])
    _, (multipliers, active) = least_norm_point(rows, np.array([-1.0, -2.0, -1.0]))
    np.testing.assert_allclose(multipliers, [1.0, 0.0, 0.0], atol=1e-12)
    assert list(active) == [0]


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
        found = least_norm_point(G, b)
        if found is not None:
            answers += 1
            assert np.min(found[1].value) >= -1e-8 * np.max(found[1].value)
            assert np.max(G @ found[0] - b) < 1e-6
    assert answers > 80
