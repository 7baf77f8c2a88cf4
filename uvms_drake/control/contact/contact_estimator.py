"""Estimator of the contact state: safe region, stiffness and inclination of an unknown wall."""

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from pydrake.systems.framework import CacheEntry, Context, DiscreteValues, EventStatus

from uvms_drake.common.errors import require
from uvms_drake.common.finite import is_finite
from uvms_drake.common.wiring import WiredSystem, cached, output_of
from uvms_drake.control.contact.contact_state import (
    ContactState,
    EstimatorSettings,
    initial_contact_state,
    updated_contact_state,
    without_reading,
)
from uvms_drake.control.contact.safe_region import bounds, safe_depth
from uvms_drake.control.contact.stiffness_estimate import (
    StiffnessEstimate,
    stiffness_std,
    stiffness_used,
    surface_depth,
    tilt,
)
from uvms_drake.model.surface.surface_class import SurfaceClass
from uvms_drake.model.uvms_model import UvmsModel


def _output(of: Callable[[ContactState], np.ndarray], now: CacheEntry, context: Context
            ) -> np.ndarray:
    """Returns an output (size,), a function of the contact state now."""
    return np.atleast_1d(of(now.Eval(context)))


class ContactEstimator(WiredSystem):
    """Estimator of safe region, stiffness and inclination at every reading of a force sensor.

    .. pydrake_system::

        name: ContactEstimator
        input_ports:
        - state
        - force_measured
        - extent (optional)
        output_ports:
        - safe_depth
        - facet_depths
        - apex
        - touched
        - reading
        - mean_reading
        - stiffness_estimate
        - stiffness_std
        - stiffness_used
        - tilt
        - contact_depth
        - force_lost

    - `state`: (𝔮, ζ) (2(6+n)) measured, in the paper's order.
    - `force_measured`: 𝔉 (6) on the wall as the sensor gives it; its force in Σ_I is read [N].
    - `extent` (4): least, then largest place across n of the remaining plan, see `dominates` [m];
      the tip's own place if unconnected.
    - `safe_depth` (1): x_safe [m] at the tip's place; −inf while no place is proven safe.
    - `facet_depths` (4, or 1 for α = 0): bounds of the facets [m], for plans; see
      `safe_region.bounds`.
    - `apex` (3): 𝔞 [m], for plans that slide: ⟨𝔭̄ − 𝔞⟩ ≤ −E; NaN with −inf.
    - `touched` (1): 1 if the last reading was a touch, else 0: no contact, or lost again.
    - `reading` (4): place of the tip at the last reading (3) [m], and its force n·𝐅 [N].
    - `mean_reading` (4): the same of the mean of the readings at that place, see
      `ContactState.mean_reading`.
    - `stiffness_estimate`, `stiffness_std` (1): mean and standard deviation of the estimated
      stiffness [N/m]; NaN before the first touch.
    - `stiffness_used` (1): κ̂ [N/m], see `stiffness_used`.
    - `tilt` (3): inclination 𝔱 of the wall across n, see `tilt`; zero before the first touch.
    - `contact_depth` (1): estimated depth of the undeformed wall [m]; NaN before the first touch.
    - `force_lost` (1): 1 if the last readings, as many as the sensor's `patience`, are missing.

    The discrete state is `ContactState`. Until the first update, outputs are those of the present
    inputs, so that a plan can be made at initialization. A reading that is not finite updates the
    tip's motion only; after a state that is not finite the safe region is not extended until the
    window W has no gap.

    Args:
        model: The controller's model, for the tip's motion.
        surface: The class of walls.
        sensing: The sensor.
        margin: E, of the planned tip [m]; see `safe_depth`.
    """

    def __init__(self, model: UvmsModel, surface: SurfaceClass, sensing: EstimatorSettings, *,
                 margin: float):
        super().__init__()
        require(0.0 <= margin < np.inf, "margin", margin, "zero or positive")
        self._model, self._surface, self._sensing = model, surface, sensing
        self._state_port = self.DeclareVectorInputPort("state", 2 * model.size)
        self._force_port = self.DeclareVectorInputPort("force_measured", 6)
        self._extent_port = self.DeclareVectorInputPort("extent", 4)
        for part in initial_contact_state(sensing):
            self.DeclareDiscreteState(part)
        self.DeclarePeriodicDiscreteUpdateEvent(sensing.period, 0.0, self._read)
        # The inputs count until there is a reading.
        now = cached(self, "the contact state now", self._now,
                     {self.xd_ticket(), self.all_input_ports_ticket()})
        known = {now.ticket()}
        for name, size, calc in (
            ("safe_depth", 1, lambda now: safe_depth(surface, now.apex, now.past[-6:-3], margin)),
            ("facet_depths", len(surface.facets), lambda now: bounds(surface, now.apex, margin)),
            ("apex", 3, lambda now: now.apex),
            ("touched", 1, lambda now: now.reading[4:]),
            ("reading", 4, lambda now: now.reading[:4]),
            ("mean_reading", 4, lambda now: now.mean_reading),
            ("stiffness_estimate", 1, lambda now: StiffnessEstimate.of(now.stiffness).mean[1]),
            ("stiffness_std", 1, lambda now: stiffness_std(StiffnessEstimate.of(now.stiffness))),
            ("stiffness_used", 1, lambda now: stiffness_used(
                StiffnessEstimate.of(now.stiffness), surface)),
            ("tilt", 3, lambda now: tilt(StiffnessEstimate.of(now.stiffness), surface)),
            ("contact_depth", 1, lambda now: surface_depth(
                StiffnessEstimate.of(now.stiffness), surface, now.past[-6:-3])),
            ("force_lost", 1, lambda now: now.missing >= sensing.patience),
        ):
            output_of(self, name, size, partial(_output, calc, now), known)

    @staticmethod
    def _remembered(context: Context) -> ContactState:
        parts = range(len(ContactState._fields))
        return ContactState(*(context.get_discrete_state(i).value() for i in parts))

    def _now(self, context: Context) -> ContactState:
        remembered = self._remembered(context)
        return self._after(context) if math.isnan(remembered.reading[0]) else remembered

    def _after(self, context: Context) -> ContactState:
        """Returns the contact state after a reading of the input ports."""
        before, state = self._remembered(context), self._state_port.Eval(context)
        if is_finite(state):
            config, zeta = state[: self._model.size], state[self._model.size:]
            kinematics = self._model.tip_kinematics(config)
            tip = np.append(kinematics.chi[:3], kinematics.J_chi[:3] @ zeta)
        else:
            tip = without_reading(before)
        force = self._force_port.Eval(context)[:3]
        if math.isfinite(before.apex[0]) and self._extent_port.HasValue(context):
            extent = self._extent_port.Eval(context).reshape(2, 2)
        else:
            extent = self._surface.across(tip[:3])[None]
        return updated_contact_state(self._surface, self._sensing, extent, before, tip, force)

    def _read(self, context: Context, state: DiscreteValues) -> EventStatus:
        for i, part in enumerate(self._after(context)):
            state.set_value(i, part)
        return EventStatus.Succeeded()
