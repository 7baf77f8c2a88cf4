"""Pareto front of certified force error and remaining input, over gains and d̃.

The tube shrinks like d̃/(kσ), and with it the input for a stiff surface and a turning task. So the
largest gains within the bandwidth of the actuators are the best, and the front shows the effect of
a smaller d̃ or bandwidth.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from uvms_drake.certificate.certify import basis_of, tightening_margins
from uvms_drake.common.errors import require
from uvms_drake.common.progress import Progress, silent
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.problem import limits_of
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.laws import TUBES
from uvms_drake.tube.ultimate_bounds import ultimate_bounds

DISTURBANCES = (0.5, 1.0, 1.5, 2.0)
"""Disturbance bounds, as multiples of the scenario's d̃."""
GAINS = (0.5, 1.0, 2.0)
"""Gains, as multiples of the scenario's k and σ."""


@dataclass(frozen=True)
class ParetoPoint:
    """Certified bounds for a choice of d̃ and gains."""

    d_bound: float
    """Bound d̃ of the disturbance [m/s², rad/s²]."""
    k: float
    """Gain of the velocity error [1/s]."""
    sigma: float
    """Gain σ of the task error [1/s]."""
    force: float
    """Ultimate bound of the force error [N]; inf if there is no tube."""
    input_left: float
    """Smallest fraction of an input limit that the tube leaves; negative if none."""
    emptied: str
    """First condition on the tube or on a limit that fails, or an empty string."""


def check_pareto_front(law: AncillaryLaw) -> None:
    """Raises `InvalidParameter` if there is no Pareto front with a law."""
    name = type(law).__name__
    require(type(law) in TUBES, "ancillary", name, "a law with a certificate, for a front")
    require(np.isfinite(law.k), "ancillary", name, "a law with one k and one σ, for a front")


def pareto_front(scenario: Scenario, model: ContactModel,
                 disturbances: Iterable[float] = DISTURBANCES, gains: Iterable[float] = GAINS,
                 progress: Progress = silent) -> list[ParetoPoint]:
    """Returns the points for all combinations of factors on d̃ and on (k, σ).

    The model is the controller's.
    """
    law = cast(Any, scenario.ancillary)
    check_pareto_front(law)
    tube_of, surface = TUBES[type(law)].tube, model.surface
    wrench = np.asarray(scenario.task.force, dtype=float)
    chi_des = surface.pose_for(wrench, scenario.task.pose)
    basis, limits = basis_of(scenario, model), limits_of(scenario, model)
    disturbances, gains = tuple(disturbances), tuple(gains)
    points: list[ParetoPoint] = []
    for d_factor in disturbances:
        for factor in gains:
            progress("tubes", len(points) / (len(disturbances) * len(gains)))
            scaled = replace(law, k=factor * law.k, sigma=factor * law.sigma)
            d_bound = replace(scenario.disturbance,
                              bound=d_factor * scenario.disturbance.bound).d_bound
            tube = tube_of(scaled, replace(basis, d_bound=d_bound))
            # The limits, tightened by its tube, if there is one.
            margins, bounds = [], {"force": np.inf}
            if all(item.holds for item in tube.conditions):
                margins = tightening_margins(tube.radii, limits)
                bounds = ultimate_bounds(tube.radii, surface, chi_des, wrench)
            points.append(ParetoPoint(
                d_bound=d_bound, k=scaled.k, sigma=scaled.sigma,
                force=bounds["force"],
                input_left=min((item.margin / item.right for item in margins
                                if item.topic == "limits.u"), default=-np.inf),
                emptied=next(
                    (item.name for item in (*tube.conditions, *margins) if not item.holds), "")))
    return points


def format_pareto_front(points: list[ParetoPoint]) -> str:
    """Returns the points as a table."""
    head = f"{'d̃':>8}{'k [1/s]':>10}{'σ [1/s]':>10}{'force [N]':>12}{'input left':>12}"
    return "\n".join([head, *(
        f"{p.d_bound:>8.3g}{p.k:>10.3g}{p.sigma:>10.3g}{p.force:>12.3g}{p.input_left:>12.1%}"
        + (f"  not certified: {p.emptied}" if p.emptied else "") for p in points)])
