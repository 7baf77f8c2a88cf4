"""Linear model of an ancillary law and of its observer about a point, by complex steps.

The law's own command is differentiated by measured and nominal motion, force, wrench, estimate and
preview, so that any law whose command is analytic has its linear model here. At the point δ̂ is
that of the outputs' disturbance δ = −(Gτ + c), which keeps the robot at rest, with τ by the
controller's model of the actuation.
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.control.feedback.disturbance_observer import add_linear_observer, prediction
from uvms_drake.control.laws.law import AncillaryLaw, Command, pair_of
from uvms_drake.model.frames.euler import complex_step_jacobian
from uvms_drake.model.signals.linear import LinearLoop, OperatingPoint, Signal, stacked


class PlanSignals(NamedTuple):
    """Deviations of a plan from the point."""

    state: Signal
    """(𝔮̄, ζ̄) (2(6+n),)."""
    acceleration: Signal
    """ζ̄̇ (6+n,)."""
    preview: Signal
    """τ̄(t + ℓ) − τ̄(t) (6+n,)."""


class Measured(NamedTuple):
    """Deviations of the signals that a law reads."""

    state: Signal
    """(𝔮, ζ) measured (2(6+n),)."""
    force: Signal | None
    """𝔉_s (6,); None: the model's surface."""
    wrench: Signal | None
    """Present wrench τ_v (6,) of the thrusters; None: the commanded one."""
    applied: Signal
    """τ behind the actuators (6+n,)."""


def add_linear_feedback(loop: LinearLoop, law: AncillaryLaw, at: OperatingPoint,
                        measured: Measured, plan: PlanSignals) -> Signal:
    """Adds the linear model of a law and its observer, and returns the command τ (6+n,).

    Args:
        loop: The loop.
        law: The law.
        at: The point, at which plan and robot are the same.
        measured: The signals that the law reads.
        plan: The plan.
    """
    # The estimate at the point.
    model, size = at.model, at.model.size
    observed, at_rest = law.observed(model), np.zeros(size)
    contact = None if measured.force is None else at.contact
    estimate = at_rest
    if observed is not None:
        _, c, G = prediction(
            model, observed, pair_of(model, at.state, at.state)._replace(contact=contact))
        estimate = np.where(observed.rates > 0.0, -(G @ at.modelled + c), 0.0)

    def command(x: np.ndarray) -> np.ndarray:
        """Returns τ by the measured and nominal state, ζ̄̇, 𝔉_s, τ_v, δ̂ and preview."""
        state, nominal, acceleration, force, wrench, delta, preview = np.split(x, ends)
        now = pair_of(model, state, nominal)._replace(
            contact=None if measured.force is None else force,
            wrench=None if measured.wrench is None else wrench,
            estimate=None if observed is None else delta,
            preview=preview if law.takes_wrench else None)
        found = law.command(model, now, lambda: acceleration, lambda: at_rest)
        if isinstance(found, Command):
            return found.tau
        return model.mass_matrix(now.kinematics.at(0)) @ found

    # The command by all that it depends on.
    parts = at.state, at.state, at_rest, at.contact, at.modelled[:6], estimate, at_rest
    ends = np.cumsum([len(part) for part in parts])[:-1]
    by_each = complex_step_jacobian(command, np.concatenate(parts) + 0j)
    delta = loop.state("estimate", size)
    loop.start(delta, -estimate)  # An observer starts from zero.
    none = Signal(6, {})
    tau = by_each @ stacked([
        measured.state, plan.state, plan.acceleration, measured.force or none,
        measured.wrench or none, delta, plan.preview])
    if observed is None:
        return tau

    def predicted(x: np.ndarray) -> np.ndarray:
        """Returns ẏ and Gτ + c at the τ of the point by state and force."""
        state, force = np.split(x, [2 * size])
        rate, c, G = prediction(model, observed, pair_of(model, state, at.state)._replace(
            contact=None if measured.force is None else force))
        return np.concatenate([rate, G @ at.modelled + c])

    by_motion = complex_step_jacobian(predicted, np.concatenate([at.state, at.contact]) + 0j)
    motion = by_motion @ stacked([measured.state, measured.force or none])
    add_linear_observer(loop, model, observed, motion[size:], motion[:size], G,
                        measured.applied, delta)
    return tau
