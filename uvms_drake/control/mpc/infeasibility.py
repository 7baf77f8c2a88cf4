"""Diagnosis of a missing first plan: the violated limit, its first instant, and the cause."""

from typing import NamedTuple

import numpy as np

from uvms_drake.control.limits import Limit
from uvms_drake.control.limits.static_force import StaticForce
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.plan.plan import Plan
from uvms_drake.model.contact_model import ContactModel


class LimitViolation(NamedTuple):
    """Limit that a plan exceeds."""

    limit: Limit
    part: int
    """Index of the value that exceeds it most."""
    time: float
    """First instant at which it does [s]."""
    amount: float
    """Largest excess; of a force as a depth, see `StaticForce`."""

    @property
    def text(self) -> str:
        """Text with the limit, its tightening, the excess and its first instant."""
        margin = float(np.broadcast_to(self.limit.margin, self.limit.lower.shape)[self.part])
        tube = f" (tightened by {margin:.3g})" if margin > 0.0 else ""
        amount = self.amount * (self.limit.surface.stiffness_bound if isinstance(
            self.limit, StaticForce) else 1.0)
        unit = self.limit.units[self.part]
        return (f"limits.{self.limit.labels[self.part]}{tube} is exceeded by {amount:.3g}"
                f"{' ' * bool(unit)}{unit} from t = {self.time:.2f} s on")


def first_violation(ocp: Ocp, plan: Plan, allowed: float) -> LimitViolation | None:
    """Returns the limit that a plan exceeds first by more than `allowed`, or None."""
    found = []
    for limit, times, excess in ocp.excesses(plan):
        beyond = excess > allowed
        if beyond.any():
            first = int(np.argmax(beyond.any(axis=1)))
            index = int(np.argmax(excess[first]))
            found.append(LimitViolation(limit, index, float(times[first]),
                                        float(np.max(excess[:, index]))))
    return min(found, key=lambda excess: excess.time, default=None)


def infeasibility_reason(ocp: Ocp, guess: Plan, plan: Plan | None, allowed: float) -> str:
    """Returns the reason for which a first plan is infeasible, in one line.

    Args:
        ocp: The problem.
        guess: Plan that comes to rest from the start.
        plan: The solver's result from there, if there is one.
        allowed: Largest violation of a limit that a plan may have.
    """
    at_rest = first_violation(ocp, guess, allowed)
    if at_rest is not None:
        model, deep = ocp.model, 0.0
        if isinstance(model, ContactModel):
            deep = float(model.surface.penetration(model.task_pose(guess.config[0])[:6]))
        return f"at rest, {at_rest.text}" + (
            f"; the tip starts {deep:.3g} m deep in the surface" if deep > 0.0 else "")
    if plan is None:
        return "the solver finds no plan; weights, stiffness and time step may be badly scaled"
    away = first_violation(ocp, plan, allowed)
    reason = "the plan found ends outside of its terminal set" if away is None else away.text
    if away is not None and ocp.evaluate(plan).terminal_slack <= allowed:
        return f"{reason}, though the plan that was found ends in its terminal set"
    reach, slack = ocp.horizon * ocp.time_step, ocp.evaluate(guess).terminal_slack
    return (f"{reason}; to stay is within the limits, but the terminal set, ‖ξ‖_P = {slack:.3g} "
            f"away, is out of the reach of a plan of {reach:.3g} s")
