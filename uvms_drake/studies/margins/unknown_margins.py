"""Tolerances of model errors: of the robot, its joints, and the motion of the water.

Each is declared alone, at a size, in place of the declared d: with the weights and the bound of
`declared_unknowns.fitting_disturbance`, and with the allowance of the readings that their tube
needs, as `certify` advises. Effects, tube and conditions are those of the certificate, up to the
margins of all limits.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from uvms_drake.certificate.advice import rounded_up, setting
from uvms_drake.certificate.certify import basis_of
from uvms_drake.certificate.declared_unknowns import (
    RESERVED,
    Sources,
    UnknownEffect,
    UnmodelledBounds,
    declared_sources,
    fitting_disturbance,
    payload_acceleration,
    payload_condition,
    unknown_effects,
    unknowns_condition,
    weights_of,
)
from uvms_drake.control.limits import TubeRadii
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.plant.disturbance import Disturbance
from uvms_drake.plant.joint_friction import JointFriction
from uvms_drake.plant.model_error import ModelError
from uvms_drake.plant.payload import Payload
from uvms_drake.plant.unknowns import Unknowns
from uvms_drake.plant.waves import Wave
from uvms_drake.station.contact import Contact
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.studies.margins.margin import Margin, bracket, tube_of, worst_of
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.law_tube import Basis
from uvms_drake.tube.laws import TUBES
from uvms_drake.tube.search.search_memo import SearchMemo, memoising
from uvms_drake.tube.unmodelled_dynamics import UnmodelledTerm, by_wrench

WAVE = 6.0
"""Period of the waves [s]."""
SMALLEST = 1e-3
"""Fraction of the typical value below which an error counts as zero."""
SPARE = 1.02
"""Allowed acceleration of a payload over that under the last tube."""
ROUNDS = 5
"""Number of tubes after which a disturbance that does not yet fit never does."""


class Study:
    """Scenario without unknowns, and the conditions on those of a scenario like it.

    Args:
        scenario: Scenario of the study.
        model: The controller's model.
    """

    def __init__(self, scenario: Scenario, model: ContactModel):
        self.scenario = replace(scenario, current=np.zeros(3), waves=[], model_error=ModelError())
        self.model, self._basis = model, basis_of(scenario, model)
        self._radii = TUBES[type(scenario.ancillary)].tube(
            scenario.ancillary, self._basis).radii

    def effects(self, sources: Sources) -> tuple[UnknownEffect, ...]:
        """Returns the effects of unknowns under the declared tube of the study."""
        weights = weights_of(self.scenario.disturbance, self._basis)
        return unknown_effects(sources, self._bounds(self._basis, self._radii), weights,
                               checked=False)

    def fitted(self, unknowns: Unknowns, sources: Sources, searches: SearchMemo
               ) -> tuple[Scenario, Condition | None]:
        """Returns the scenario with the disturbance that unknowns ask for; the failed condition.

        Args:
            unknowns: The declared unknowns.
            sources: Names and terms of the unknowns.
            searches: Memo of the searches of a tube.
        """
        scenario = replace(self.scenario, model_error=replace(unknowns.error, share=RESERVED),
                           current=unknowns.current, waves=list(unknowns.waves))
        bounds, failed = self._bounds(self._basis, self._radii), None
        for _ in range(ROUNDS):
            disturbance = fitting_disturbance(scenario.disturbance, sources, bounds)
            scenario, basis, radii, conditions = self._allowed(
                replace(scenario, disturbance=disturbance), searches)
            failed = worst_of(conditions)
            if failed is not None:
                return scenario, failed
            bounds, error = self._bounds(basis, radii), scenario.model_error
            effects = unknown_effects(sources, bounds, weights_of(disturbance, basis),
                                      checked=False)
            carried = payload_acceleration(error, disturbance, bounds, effects)
            failed = worst_of([*unknowns_condition(disturbance.bound, error.share, effects),
                               *payload_condition(error.payload, carried)])
            if failed is None:
                break
            if carried is not None:
                scenario = replace(scenario, model_error=replace(error, payload=replace(
                    error.payload, acceleration=rounded_up(SPARE * carried.claim, 2))))
        return scenario, failed

    def _bounds(self, basis: Basis, radii: TubeRadii) -> UnmodelledBounds:
        return UnmodelledBounds(self.scenario.model, basis, radii, self.scenario.seed)

    def _allowed(self, scenario: Scenario, searches: SearchMemo
                 ) -> tuple[Scenario, Basis, TubeRadii, list[Condition]]:
        """Returns a scenario with the allowance that its tube needs, and that tube."""
        basis = basis_of(scenario, self.model)
        with memoising(searches):
            searches.again()
            radii, conditions = tube_of(scenario, self.model, basis)
            allowances = scenario.contact.allowances(scenario.model_error)
            short = next((each for each in conditions if not each.holds
                          and each.topic in allowances), None)
            if short is not None and math.isfinite(short.right):
                contact: Any = scenario.contact
                scenario = replace(scenario, contact=replace(contact, **{
                    short.topic.removeprefix("contact."): rounded_up(short.right)}))
                searches.again()
                radii, conditions = tube_of(scenario, self.model, basis)
        return scenario, basis, radii, conditions


@dataclass(frozen=True)
class Unknown:
    """Model error of the robot, or motion of the water."""

    name: str
    unit: str
    asked: float
    declared: Callable[[float], Unknowns]
    """Function from a size to the unknowns that a scenario declares."""
    undeclared: Callable[[float], Sources] | None = None
    """Function from a size to its sources, where no key of a scenario declares it."""
    most: float = math.inf
    """Largest meaningful size."""

    def sources(self, size: float) -> Sources:
        """Returns names and terms at a size."""
        return (partial(declared_sources, self.declared(size)) if self.undeclared is None
                else self.undeclared(size))

    def margin(self, study: Study) -> Margin:
        """Returns the largest size that fits the conditions, with the disturbance it asks for."""
        searches, of_d, certified = SearchMemo(), SearchMemo(), study.scenario

        def failing(size: float) -> Condition | None:
            nonlocal certified
            if size > self.most:
                return Condition(f"meaningful size, {self.most:g}", size, "<=", self.most,
                                 theorem="tube/theory.md#model-error-as-a-disturbance")
            of_d.again()
            with memoising(of_d):
                scenario, failed = study.fitted(
                    self.declared(size), self.sources(size), searches)
            if failed is None:
                certified = scenario
            return failed

        (asked,) = study.effects(self.sources(self.asked))
        size = self.asked
        while (failed := failing(size)) is not None and size > SMALLEST * self.asked:
            size /= 4.0
        if failed is not None:
            return Margin(self.name, self.unit, 0.0, 0.0, failed.name, asked.each, self.asked)
        size, failed = bracket(failing, size)
        return Margin(self.name, self.unit, 0.0, size, failed.name if failed else "", asked.each,
                      self.asked, settings_of(
                          certified.model_error, certified.disturbance, certified.contact))


def settings_of(error: ModelError, disturbance: Disturbance, contact: Contact) -> str:
    """Returns the settings of a fitted scenario besides its unknowns, for the command line."""
    return setting(
        model_error__share=error.share, disturbance__bound=disturbance.bound,
        disturbance__weights=disturbance.weights, **contact.allowances(error))


def unknowns() -> list[Unknown]:
    """Returns the model errors and motions of the water."""
    # Declared unknowns by their size, and the one that no key of a scenario declares.
    def error(**changed: Callable[[float], Any]) -> Callable[[float], Unknowns]:
        return lambda size: Unknowns(ModelError(
            **{key: value(size) for key, value in changed.items()}))

    def factor(size: float) -> float:
        return 1.0 + size

    def wave(size: float) -> Unknowns:
        amplitude = size / max(Wave(amplitude=1.0, period=WAVE).speeds)
        return Unknowns(waves=[Wave(amplitude=amplitude, period=WAVE)])

    def wrench(size: float) -> Sources:
        def sources(bounds: UnmodelledBounds, before: list[UnknownEffect]
                    ) -> Iterator[tuple[str, list[UnmodelledTerm]]]:
            yield f"wrench off by {size:g}", [
                by_wrench(bounds.model, size, bounds.rate, bounds.force)]

        return sources

    return [
        Unknown("mass of all bodies, trimmed", "of it", 0.2, error(mass=factor), most=0.8),
        Unknown("added mass", "of it", 0.2, error(added_mass=factor), most=0.8),
        Unknown("drag", "of it", 0.2, error(drag=factor), most=0.8),
        Unknown("trim: displaced volume", "of it", 0.02, error(buoyancy=factor), most=0.8),
        Unknown("payload in the hand", "kg", 0.5, error(payload=lambda size: Payload(mass=size))),
        Unknown("joint friction", "N m", 0.5, error(
            joint_friction=lambda size: JointFriction(coulomb=np.array([size])))),
        Unknown("current", "m/s", 0.25,
                lambda size: Unknowns(current=np.array([size, 0.0, 0.0]))),
        Unknown(f"waves of {WAVE:g} s, speed of the water", "m/s", 0.2, wave),
        Unknown("vehicle's wrench", "of it", 0.1, lambda size: Unknowns(), wrench)]
