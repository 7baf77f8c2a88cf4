"""Tests of `uvms_drake.control.laws.transpose`: the paper's law, typed again."""

import numpy as np
import pytest
from support import dh
from support.laws import SIGMA, K, pairs, transpose_input


@pytest.mark.parametrize("where", ["free", "deep"])
def test_the_law_transpose_is_the_papers_as_its_proof_needs_it(model, states, where):
    """That is, u = ū − k(ζ − ζ̄) − kσJ(𝔮̄)ᵀ(χ − χ̄)."""
    for state, nominal, nominal_input, _ in pairs(model, states, where):
        error = dh.chi(state[:10]) - dh.chi(nominal[:10])
        J = model.task_jacobian(nominal[:10])[:6]
        expected = nominal_input - K * (state[10:] - nominal[10:]) - K * SIGMA * (J.T @ error)
        u = transpose_input(model, state, nominal, nominal_input, K, SIGMA)
        np.testing.assert_allclose(u, expected, atol=1e-12)


@pytest.mark.parametrize("where", ["free", "deep"])
def test_with_joints_the_law_transpose_feeds_back_the_extended_task(model, states, where):
    """That is, u = ū − k(ζ − ζ̄) − kσJ_x(𝔮̄)ᵀ(y − ȳ), y = (χ, q)."""
    for state, nominal, nominal_input, _ in pairs(model, states, where):
        y, y_nominal = (np.concatenate([dh.chi(x[:10]), x[6:10]]) for x in (state, nominal))
        J_x = model.task_jacobian(nominal[:10])
        expected = nominal_input - K * (state[10:] - nominal[10:]) - K * SIGMA * (
            J_x.T @ (y - y_nominal))
        u = transpose_input(model, state, nominal, nominal_input, K, SIGMA, joints=True)
        np.testing.assert_allclose(u, expected, atol=1e-12)
