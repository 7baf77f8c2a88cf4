"""Gains for the law `resolved`: the smallest certified force error that the limits allow.

The ultimate force error falls with kσ; both are poles of the error dynamics, so the bandwidth of
actuators and state estimate limits them, and larger ones need more input. The candidates are a
geometric grid below the bandwidth, tried in the order of the force error they certify.
"""

from dataclasses import replace
from itertools import product

import numpy as np

from uvms_drake.certificate.certify import basis_of, tightening_margins
from uvms_drake.common.errors import RunFailed, require
from uvms_drake.control.laws import Resolved
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.surface.law import TipErrors
from uvms_drake.station.problem import limits_of
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.laws.resolved import resolved_law_tube
from uvms_drake.tube.resolved.image import input_gain

FRACTIONS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.125)
"""Candidate gains, as fractions of the bandwidth."""


def propose_gains(scenario: Scenario, model: ContactModel, bandwidth: float
                  ) -> tuple[Resolved, float]:
    """Returns gains k, σ ≤ `bandwidth` [1/s], and the bound of the force error [N] they certify.

    They leave a margin of every limit; `certify` checks terminal set and first plan. The model is
    the controller's.

    Raises:
        InvalidParameter: The bandwidth is not positive.
        RunFailed: No candidate leaves a margin of every limit.
    """
    require(0.0 < bandwidth < float("inf"), "bandwidth", bandwidth, "positive")
    surface = model.surface
    wrench = np.asarray(scenario.task.force, dtype=float)
    chi_des = surface.pose_for(wrench, scenario.task.pose)
    basis = basis_of(replace(scenario, ancillary=Resolved()), model)
    limits = limits_of(scenario, model)

    def force_error(law: Resolved) -> float:
        """Returns the bound of the force error with other gains [N]."""
        position, orientation = (
            basis.row_norm(block) * basis.d_bound / (law.k * law.sigma)
            for block in ("position", "orientation"))
        speed = 2.0 * law.sigma * position
        return surface.force_error(
            chi_des, wrench, TipErrors(position, position, orientation, speed, speed))

    candidates = [Resolved(k=bandwidth * a, sigma=bandwidth * b)
                  for a, b in product(FRACTIONS, FRACTIONS) if b <= a]
    largest = basis.d_bound * basis.weights
    for law in sorted(candidates, key=force_error):
        if np.any(input_gain(law.k, law.sigma) * largest >= basis.u_limit):
            continue  # The linear part alone uses up an input.
        tube = resolved_law_tube(law, basis)
        margins = tightening_margins(tube.radii, limits)
        if all(item.holds for item in (*tube.conditions, *margins)):
            return law, force_error(law)
    raise RunFailed(f"no gains up to {bandwidth:g} 1/s leave a margin of every limit; "
                    "what would help: a smaller disturbance.bound or wider limits")
