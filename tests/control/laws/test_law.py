"""Tests of `uvms_drake.control.laws.law`: properties of all laws."""

import numpy as np
import pytest
from support import dh
from support.laws import SIGMA, K, pairs, resolved_input, tip_first_input, transpose_input

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.plane import UnilateralPlane


@pytest.mark.parametrize("where", ["free", "deep"])
def test_without_an_error_the_nominal_input_is_passed_on(model, states, where):
    acceleration = np.linspace(-0.3, 0.3, 10)
    for state in states[where]:
        nominal_input = acceleration - model.drift(state[:10], state[10:])
        for law in (resolved_input, tip_first_input):
            np.testing.assert_allclose(
                law(model, state, state, acceleration, K, SIGMA), nominal_input,
                rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            transpose_input(model, state, state, nominal_input, K, SIGMA), nominal_input,
            atol=1e-12)


def turned(state: np.ndarray, angle: float) -> np.ndarray:
    """Returns the state seen after a turn of the whole world about the vertical, ψ in (−π, π]."""
    out = state.copy()
    out[:3] = dh.rotation("z", angle)[:3, :3] @ state[:3]
    out[5] = np.arctan2(np.sin(state[5] + angle), np.cos(state[5] + angle))
    return out


@pytest.mark.parametrize("law", [resolved_input, transpose_input, tip_first_input])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_errors_across_the_jump_of_the_yaw_angle_are_small(uvms, states, law, sign):
    """Real yaw π − ε against nominal −π + ε gives the input of −ε against ε, across π."""
    floor = UnilateralPlane(point=np.array([0.0, 0.0, 50.0]), normal=np.array([0.0, 0.0, -1.0]))
    model = ContactModel(uvms, check_surface(floor))  # The same seen from north and from south.
    for real, ideal, nominal, _ in pairs(model, states, "free"):
        real, ideal = real.copy(), ideal.copy()
        real[5] += -0.02 * sign - dh.chi(real[:10])[5]
        ideal[5] += 0.02 * sign - dh.chi(ideal[:10])[5]
        wrapped = turned(real, np.pi), turned(ideal, np.pi)
        assert abs(dh.chi(wrapped[0][:10])[5] - dh.chi(wrapped[1][:10])[5]) > 6.0
        np.testing.assert_allclose(law(model, *wrapped, nominal, K, SIGMA),
                                   law(model, real, ideal, nominal, K, SIGMA), atol=1e-9)
