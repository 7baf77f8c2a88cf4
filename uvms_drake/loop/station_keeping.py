"""Station keeping without plan, observer or force, of a loop that has stopped."""

from dataclasses import replace

import numpy as np

from uvms_drake.control.feedback.ancillary import limited_input
from uvms_drake.control.laws.law import pair_of
from uvms_drake.control.laws.tip_first import BlockGains
from uvms_drake.control.supervisor.retreat import law_of_retreat
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.station.scenario.scenario import Scenario

STATION = BlockGains(2.0, 1.0)
"""Largest gains of the vehicle; stiffer ones overshoot from afar, at a limit of u."""


def station_command(scenario: Scenario, model: UvmsModel, place: np.ndarray, state: np.ndarray
                    ) -> np.ndarray:
    """Returns τ (6+n,) [N, N m] that keeps vehicle and joints at a place, within the limits.

    It is the law of a retreat with slower gains of the vehicle, as if nothing were touched.

    Args:
        scenario: Its law and its limits.
        model: The controller's model.
        place: 𝔮 to keep (6+n,) [m, rad].
        state: Measured (𝔮, ζ) (2(6+n),).

    Raises:
        RunFailed: The posture is singular.
    """
    law, still = law_of_retreat(scenario.ancillary, model.num_joints), np.zeros(model.size)
    slower = BlockGains(min(law.vehicle.k, STATION.k), min(law.vehicle.sigma, STATION.sigma))
    pair = pair_of(model, state, np.append(place, still)).given(contact=np.zeros(6))
    wanted = replace(law, vehicle=slower).command(model, pair, lambda: still, lambda: still)
    u, tau = scenario.limits.u, scenario.limits.tau
    return limited_input(wanted.u, wanted.tau, wanted.M, np.asarray(u),
                         None if tau is None else np.asarray(tau))[1]
