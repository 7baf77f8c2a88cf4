"""The adversary `predictive`: no other direction of the same size takes the error further."""

import numpy as np
import pytest

from uvms_drake.plant.adversary import PREVIEW_TIME, ROWS, AdversarialDisturbance, Adversary

BOUND = 0.1


@pytest.mark.parametrize("rows", ["all", "position", "joints"])
@pytest.mark.parametrize("size", [0.0, 1e-4, 1e-2])
def test_no_other_direction_takes_the_error_further(model, states, rows, size):
    adversary = Adversary(model, AdversarialDisturbance(BOUND, "predictive", rows))
    context, rng = adversary.CreateDefaultContext(), np.random.default_rng(5)
    for state in states["deep"]:
        e_y, r = size * rng.normal(size=(2, 10))
        for name, value in (("state", state), ("e_y", e_y), ("r", r)):
            adversary.GetInputPort(name).FixValue(context, value)
        d = adversary.get_output_port().Eval(context)
        assert np.linalg.norm(d) == pytest.approx(BOUND, rel=1e-9)
        J = model.task_jacobian(state[:10])[ROWS[rows]]
        drift = e_y[ROWS[rows]] + PREVIEW_TIME * J @ r

        def reached(others, J=J, drift=drift):
            return np.linalg.norm(drift + 0.5 * PREVIEW_TIME**2 * others @ J.T, axis=-1)

        others = rng.normal(size=(2000, 10))
        others *= BOUND / np.linalg.norm(others, axis=1)[:, None]
        near = d + 0.05 * others
        near *= BOUND / np.linalg.norm(near, axis=1)[:, None]
        assert reached(d) >= 0.99 * max(np.max(reached(others)), np.max(reached(near)))
