"""Tolerances of model errors: of the robot, its joints, and the motion of the water.

Each is declared alone, at a size, in place of the declared d: with the weights and the bound of
`declared_unknowns.fitting_disturbance`, and with the allowance of the readings that their tube
needs, as `certify` advises. Effects, tube and conditions are those of the certificate, up to the
margins of all limits.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
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
)
from uvms_drake.control.limits import TubeRadii
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.plant.joint_friction import JointFriction
from uvms_drake.plant.model_error import ModelError
from uvms_drake.plant.payload import Payload
from uvms_drake.plant.waves import Wave
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.motions.motions import motion_of
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.studies.margins.margin import Margin, bracket, tube_of, worst_of
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.law_tube import Basis
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
        self._radii = motion_of(scenario).tubes[type(scenario.ancillary)].tube(
            scenario.ancillary, self._basis).radii

    def effects(self, scenario: Scenario, sources: Sources) -> tuple[UnknownEffect, ...]:
        """Returns the effects of unknowns under the declared tube of the study."""
        return unknown_effects(scenario, self._basis, self._radii, sources=sources, checked=False)

    def fitted(self, scenario: Scenario, sources: Sources, searches: SearchMemo
               ) -> tuple[Scenario, Condition | None]:
        """Returns a scenario with the disturbance that its unknowns ask for; the failed condition.

        Args:
            scenario: Scenario with unknowns.
            sources: Its unknowns.
            searches: Memo of the searches of a tube.
        """
        basis, radii, failed = self._basis, self._radii, None
        for _ in range(ROUNDS):
            scenario = replace(
                scenario, disturbance=fitting_disturbance(scenario, basis, radii, sources),
                model_error=replace(scenario.model_error, share=RESERVED))
            scenario, basis, radii, conditions = self._allowed(scenario, searches)
            failed = worst_of(conditions)
            if failed is not None:
                return scenario, failed
            effects = unknown_effects(scenario, basis, radii, sources=sources, checked=False)
            carried = payload_acceleration(scenario, basis, radii, effects)
            failed = worst_of([*unknowns_condition(scenario, effects),
                               *payload_condition(scenario, carried)])
            if failed is None:
                break
            if carried is not None:
                error = scenario.model_error
                scenario = replace(scenario, model_error=replace(error, payload=replace(
                    error.payload, acceleration=rounded_up(SPARE * carried.claim, 2))))
        return scenario, failed

    def _allowed(self, scenario: Scenario, searches: SearchMemo
                 ) -> tuple[Scenario, Basis, TubeRadii, list[Condition]]:
        """Returns a scenario with the error of readings that its tube needs, and that tube."""
        basis = basis_of(scenario, self.model)
        with memoising(searches):
            searches.again()
            radii, conditions = tube_of(scenario, self.model, basis)
            short = next((each for each in conditions if not each.holds
                          and each.topic == "contact.force_error"), None)
            if short is not None and math.isfinite(short.right):
                scenario = replace(scenario, contact=replace(
                    sensed_contact(scenario), force_error=rounded_up(short.right)))
                searches.again()
                radii, conditions = tube_of(scenario, self.model, basis)
        return scenario, basis, radii, conditions


@dataclass(frozen=True)
class Unknown:
    """Model error of the robot, or motion of the water."""

    name: str
    unit: str
    asked: float
    declared: Callable[[Scenario, float], Scenario]
    """Function from a scenario without unknowns and a size to one that declares it."""
    sources: Callable[[float], Sources] = lambda size: declared_sources
    """Function from a size to its sources, where no key of a scenario declares it."""
    most: float = math.inf
    """Largest meaningful size."""

    def margin(self, study: Study) -> Margin:
        """Returns the largest size that fits the conditions, with the disturbance it asks for."""
        searches, of_d, certified = SearchMemo(), SearchMemo(), study.scenario

        def at(size: float) -> tuple[Scenario, Sources]:
            return self.declared(study.scenario, size), self.sources(size)

        def failing(size: float) -> Condition | None:
            nonlocal certified
            if size > self.most:
                return Condition(f"meaningful size, {self.most:g}", size, "<=", self.most,
                                 theorem="tube/theory.md#model-error-as-a-disturbance")
            of_d.again()
            with memoising(of_d):
                scenario, failed = study.fitted(*at(size), searches)
            if failed is None:
                certified = scenario
            return failed

        (asked,) = study.effects(*at(self.asked))
        size = self.asked
        while (failed := failing(size)) is not None and size > SMALLEST * self.asked:
            size /= 4.0
        if failed is not None:
            return Margin(self.name, self.unit, 0.0, 0.0, failed.name, asked.each, self.asked)
        size, failed = bracket(failing, size)
        return Margin(self.name, self.unit, 0.0, size, failed.name if failed else "", asked.each,
                      self.asked, settings_of(certified))


def settings_of(scenario: Scenario) -> str:
    """Returns the settings of a fitted scenario besides its unknowns, for the command line."""
    disturbance = scenario.disturbance
    given = setting(model_error__share=scenario.model_error.share,
                    disturbance__bound=disturbance.bound, disturbance__weights=disturbance.weights)
    if scenario.contact.is_modelled:
        return given
    given += " " + setting(contact__force_error=sensed_contact(scenario).force_error)
    payload = scenario.model_error.payload
    return f"{given} {setting(model_error__payload__acceleration=payload.acceleration)}" if (
        payload.present) else given


def unknowns() -> list[Unknown]:
    """Returns the model errors and motions of the water."""
    # Changes of a scenario, and the one unknown without a key of it.
    def error(**changed: Callable[[float], Any]) -> Callable[[Scenario, float], Scenario]:
        return lambda scenario, size: replace(scenario, model_error=replace(
            scenario.model_error, **{key: value(size) for key, value in changed.items()}))

    def factor(size: float) -> float:
        return 1.0 + size

    def wave(scenario: Scenario, size: float) -> Scenario:
        amplitude = size / max(Wave(amplitude=1.0, period=WAVE).speeds)
        return replace(scenario, waves=[Wave(amplitude=amplitude, period=WAVE)])

    def wrench(size: float) -> Sources:
        def sources(scenario: Scenario, bounds: UnmodelledBounds, before: list[UnknownEffect]
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
        Unknown("current", "m/s", 0.25, lambda scenario, size: replace(
            scenario, current=np.array([size, 0.0, 0.0]))),
        Unknown(f"waves of {WAVE:g} s, speed of the water", "m/s", 0.2, wave),
        Unknown("vehicle's wrench", "of it", 0.1, lambda scenario, size: scenario, wrench)]
