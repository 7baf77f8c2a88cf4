"""Tests of `tube.actuation.row_feedforward`: what the law commands is what its rows carry."""

import numpy as np
from support.laws import not_asked, pairs

from uvms_drake.control.laws import TipFirst
from uvms_drake.control.laws.law import pair_of
from uvms_drake.control.laws.outputs import outputs_of
from uvms_drake.control.laws.tip_rows import tip_rows
from uvms_drake.tube.actuation.row_feedforward import row_feedforward

WRENCH = np.array([30.0, -20.0, 5.0, 2.0, -8.0, 10.0])


def test_the_law_commands_what_its_rows_ask_for_and_carry(model, states):
    """τ_c = A⁻¹(v_η + h_v) of (L) and τ_q = B⁻¹(v_s + h_s) of (A), for a stack of states."""
    law, rows, found = TipFirst(), tip_rows(model), []
    k, sigma = law.gains("k", 4), law.gains("sigma", 4)
    for state, nominal, acceleration, _ in pairs(model, states, "deep"):
        now = pair_of(model, state, nominal)._replace(wrench=WRENCH)
        out = outputs_of(now, rows)
        v = out.J[1] @ acceleration + out.bias[1] - (k + sigma) * (
            out.rate[0] - out.rate[1]) - k * sigma * out.error
        tau = law.command(model, now, lambda a=acceleration: a, not_asked).tau
        found.append(np.concatenate([state, v, tau]))
    config, zeta, v, tau = np.split(np.array(found), [10, 20, 30], axis=1)
    loads = row_feedforward(model, config, zeta, rows, tip_acceleration=v[:, 6:],
                      wrench=np.tile(WRENCH, (len(v), 1)))
    np.testing.assert_allclose(
        np.einsum("tij,tj->ti", loads.vehicle_map, tau[:, :6]) - loads.vehicle, v[:, :6],
        rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(
        np.einsum("tij,tj->ti", loads.tip_map, tau[:, 6:]) - loads.tip, v[:, 6:],
        rtol=1e-7, atol=1e-9)
