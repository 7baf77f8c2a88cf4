"""Declared unknowns: model errors, currents and waves of a scenario, as a part of d.

Each source is a difference of the robot or the water from the controller's model, of either sign
and up to its declared size. The acceleration that it causes over the declared set is bounded, and
the sum of these has to fit into the part of `disturbance.bound` that `model_error.share` reserves.
Theorem: tube/theory.md#declared-unknowns.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.control.limits import TubeRadii, resolved_radii
from uvms_drake.model.surface.spring import BilateralSpring
from uvms_drake.model.uvms_model import UvmsModel, read_uvms
from uvms_drake.plant.disturbance import Disturbance
from uvms_drake.plant.model_error import (
    BODIES,
    COEFFICIENTS,
    FACTORS,
    LEAST_FACTOR,
    AxisFactors,
    ModelError,
    Unknowns,
    simulated_uvms,
)
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.conditions import Condition, rounded_up, setting
from uvms_drake.tube.estimates import Check, together
from uvms_drake.tube.law_tube import Basis
from uvms_drake.tube.search.joint_search import Function, claimed_over_joints
from uvms_drake.tube.unmodelled_dynamics import (
    NO_CHANGE,
    ForceChange,
    Motions,
    MotionSet,
    UnmodelledTerm,
    by_forces,
    by_robot,
    by_water,
    commanded_rate,
    drift_change,
    family,
    sizes_of,
    tip_acceleration,
)

READING = "sensing/theory.md#reading-of-a-payload"
THEOREM = "tube/theory.md#declared-unknowns"
DRIFT, HAND = "change of the drift", "acceleration of the payload"
"""Names of estimates."""
RESERVED = 0.95
"""Advised `model_error.share`."""
LEAST_WEIGHT = 0.01
"""Smallest advised weight over the largest."""


@dataclass(frozen=True)
class UnknownEffect:
    """Acceleration that a declared unknown causes, estimated."""

    name: str
    """Source, with its size."""
    each: tuple[float, ...]
    """Bounds of |dᵢ| (6+n,) [m/s², rad/s²]."""
    takes: float
    """Bound of ‖w⁻¹d‖₂, w the `disturbance.weights`: the part of `disturbance.bound` that it takes
    [m/s², rad/s²]."""


class UnmodelledBounds:
    """Bounds of the unmodelled accelerations of a robot that is controlled within its limits.

    Args:
        robot: Name or folder of the robot.
        basis: Basis of its tube.
        radii: Its tube, which bounds the feedback.

    Attributes:
        checks: Second searches for all that was claimed.
    """

    def __init__(self, robot: str, basis: Basis, radii: TubeRadii):
        self.robot, self.basis, self.model = robot, basis, basis.model
        self._motions = MotionSet(basis.model, basis.declared)
        self.checks = list[Check]()
        tube, n = resolved_radii(radii), basis.model.num_joints
        off = np.concatenate([
            np.full(n, tube.joints or 0.0), [tube.roll or 0.0, tube.pitch or 0.0],
            np.repeat([tube.nu1 or 0.0, tube.nu2 or 0.0, tube.qdot or 0.0], [3, 3, n])])
        change, box = drift_change(self._motions, off)
        fixed = basis.largest_rate + np.asarray(radii.u) + self._claimed(DRIFT, change, box)
        surface, sensed = basis.model.surface, basis.contact
        force = basis.declared.force_max * float(np.hypot(1.0, getattr(surface, "friction", 0.0)))
        self.rate = commanded_rate(
            self.model, basis.u_limit, fixed, force=force if sensed is None else 0.0,
            damping=getattr(surface, "dissipation", 0.0),
            missed=NO_CHANGE if sensed is None else ForceChange(
                sensed.rate * sensed.age + sensed.ripple
                + max(0.0, sensed.ripple - sensed.rate * sensed.lag),
                sensed.tangential_rate * sensed.age + 2.0 * sensed.tangential_ripple,
                sensed.tool_angle))

    def true(self, **error: Any) -> UvmsModel:
        """Returns the robot with a model error."""
        return UvmsModel(simulated_uvms(self.robot, ModelError(**error)))

    def largest(self, source: "Source", weights: np.ndarray) -> UnknownEffect:
        """Returns bounds of |dᵢ| and of ‖Ŵ⁻¹d‖₂, estimated, for the diagonal of Ŵ."""
        name, terms, errors = source
        motions = MotionSet(self.model, self.basis.declared, errors)
        *each, norm = self._claimed(
            f"d by {name}", sizes_of(terms, motions, weights), motions.box)
        return UnknownEffect(name, tuple(map(float, each)), float(norm))

    def _claimed(self, name: str, function: Function, box: tuple[np.ndarray, np.ndarray]
                 ) -> np.ndarray:
        """Returns claims of the largest values of a function of points."""
        settings = self.basis.settings
        claims, check = claimed_over_joints(
            name, function, *box, settings.safety_factor, settings.seed)
        self.checks.append(check)
        return claims

    def hand(self, reach: float, unknown: np.ndarray) -> float:
        """Returns the largest acceleration of points about the tip [m/s²], estimated.

        Args:
            reach: Their largest distance from the tip [m].
            unknown: Bounds of |dᵢ| (6+n,), in addition to the commanded rate.
        """
        def values(points: np.ndarray) -> np.ndarray:
            at = self._motions.at(points)
            return tip_acceleration(self.model, at, self.rate(at) + unknown, reach)[:, None]

        return float(self._claimed(HAND, values, self._motions.box)[0])


def declared_effects(scenario: Scenario, basis: Basis, radii: TubeRadii
                     ) -> tuple[tuple[UnknownEffect, ...], Check, list[Condition]]:
    """Returns the effects of the declared unknowns, their check, and the conditions on them.

    Args:
        scenario: Scenario with unknowns.
        basis: Basis of its tube.
        radii: Its tube.

    Raises:
        InvalidParameter: The surface is a spring, whose torques no bound counts.
    """
    require(not isinstance(basis.model.surface, BilateralSpring),
            "surface", "BilateralSpring", "one without torques, for a certificate with declared "
            "unknowns (model_error, current, waves)")
    bounds = UnmodelledBounds(scenario.model, basis, radii)
    effects = unknown_effects(scenario.unknowns, bounds, weights_of(scenario.disturbance, basis))
    carried = payload_acceleration(scenario, bounds, effects)
    check = together(*bounds.checks)
    conditions = [unknowns_condition(scenario.disturbance, scenario.unknowns, bounds, effects)]
    if carried is not None:
        conditions.append(payload_condition(scenario.model_error.payload.acceleration, carried))
    return effects, check, conditions


def unknown_effects(unknowns: Unknowns, bounds: UnmodelledBounds, weights: np.ndarray
                    ) -> tuple[UnknownEffect, ...]:
    """Returns the effect of each unknown, on top of those before it.

    The robot changes by one source after the other, and the rate that the next one meets includes
    the effects of those before: so their sum bounds the effect of all.

    Args:
        unknowns: The declared unknowns.
        bounds: Bounds of the accelerations.
        weights: w (6+n,), see `weights_of`.
    """
    effects = list[UnknownEffect]()
    for source in declared_sources(unknowns, bounds, effects):
        effects.append(bounds.largest(source, weights))
    return tuple(effects)


def weights_of(disturbance: Disturbance, basis: Basis) -> np.ndarray:
    """Returns the `disturbance.weights` w (6+n,), with ones for an empty list."""
    return basis.weights * (np.max(disturbance.weights) if np.size(disturbance.weights) else 1.0)


def fitting_disturbance(disturbance: Disturbance, unknowns: Unknowns, bounds: UnmodelledBounds
                        ) -> Disturbance:
    """Returns the disturbance with the weights and the bound that unknowns ask for.

    The weights are in proportion to the accelerations that the unknowns cause, the largest 1, and
    these take the fraction `RESERVED` of the bound. The tube changes with both, and with it
    the feedback that a model error scales: another tube may ask for a little more.

    Args:
        disturbance: The declared one.
        unknowns: As of `unknown_effects`.
        bounds: As of `unknown_effects`, of a tube with any disturbance.
    """
    effects = unknown_effects(unknowns, bounds, weights_of(disturbance, bounds.basis))
    each = np.sum([effect.each for effect in effects], axis=0)
    weights = np.array([float(f"{size:.2g}") for size in np.maximum(
        each / np.max(each), LEAST_WEIGHT)])
    fitted = unknown_effects(unknowns, bounds, weights)
    return replace(disturbance, weights=weights, bound=rounded_up(
        sum(effect.takes for effect in fitted) / RESERVED))


def unknowns_condition(disturbance: Disturbance, unknowns: Unknowns, bounds: UnmodelledBounds,
                       effects: Sequence[UnknownEffect]) -> Condition:
    """Returns the condition that they fit into their part of the bound, with an advice if not.

    Args:
        disturbance: The declared one.
        unknowns: The declared unknowns.
        bounds: Bounds of the accelerations.
        effects: Effects of the unknowns.
    """
    bound, total = disturbance.bound, sum(each.takes for each in effects)
    parts = ", ".join(f"{each.name}: {each.takes:.3g}" for each in effects)
    found = Condition(
        f"declared unknowns, in model_error.share of disturbance.bound ({parts})", total, "<=",
        unknowns.error.share * bound, theorem=THEOREM, topic="declared unknowns")
    if found.holds:
        return found
    if total <= RESERVED * bound:
        return replace(found, advice=setting(
            model_error__share=math.ceil(100.0 * total / bound) / 100.0))
    fitted = fitting_disturbance(disturbance, unknowns, bounds)
    return replace(found, advice=setting(
        disturbance__bound=fitted.bound, disturbance__weights=fitted.weights,
        model_error__share=RESERVED))


def payload_acceleration(scenario: Scenario, bounds: UnmodelledBounds,
                         effects: Sequence[UnknownEffect]) -> float | None:
    """Returns the largest acceleration of a payload that a wrist sensor reads; None without one."""
    error = scenario.model_error
    if not error.payload.present or bounds.basis.contact is None:
        return None
    left = (1.0 - error.share) * scenario.disturbance.axes(bounds.model.size)
    density = read_uvms(bounds.robot).hydrodynamics.fluid_density
    reach = float(np.linalg.norm(error.payload.centre)) + error.payload.radius(density)
    return bounds.hand(reach, left + np.sum([each.each for each in effects], axis=0))


def payload_condition(declared: float, found: float) -> Condition:
    """Returns the condition that a payload accelerates no more than its reading allows for."""
    return Condition(
        "model_error.payload.acceleration, not less than that of the payload [m/s²]",
        declared, ">=", found,
        setting(model_error__payload__acceleration=rounded_up(1.02 * found, 2)),
        theorem=READING, topic="model_error")


class Source(NamedTuple):
    """A declared unknown, or several of one kind."""

    name: str
    """Its name, with its size."""
    terms: list[UnmodelledTerm]
    """Its accelerations, for each sign of the errors before it."""
    errors: list[float]
    """Smallest errors by axis over their sizes, as of `MotionSet`."""


def declared_sources(unknowns: Unknowns, bounds: UnmodelledBounds, before: list[UnknownEffect]
                     ) -> Iterator[Source]:
    """Yields the declared unknowns and their terms, for each sign of the robot's errors so far.

    Args:
        unknowns: The declared unknowns.
        bounds: Bounds of the accelerations.
        before: Effects of the unknowns so far, to which the caller adds each.
    """
    error = unknowns.error
    corners: list[tuple[dict[str, Any], UvmsModel]] = [({}, bounds.model)]

    def rate() -> Callable[[Motions], np.ndarray]:
        """Returns the rate of a motion with the effects so far; later ones do not change it."""
        so_far = np.sum([each.each for each in before], axis=0)
        return lambda at: bounds.rate(at) + so_far

    # The robot, by one error after the other; an error of each axis of its own.
    for name, changes in _robot_errors(error):
        pairs = [(base, settings | change) for settings, base in corners for change in changes]
        corners = [(settings, bounds.true(**settings)) for _, settings in pairs]
        yield Source(name, [by_robot(family(base, []), family(true, []), rate())
                            for (base, _), (_, true) in zip(pairs, corners, strict=True)], [])
    ends, errors = [list[UvmsModel]() for _ in corners], list[float]()
    robots = [family(model, []) for _, model in corners]
    for name, axes in _errors_by_axis(error):
        for i, (settings, _) in enumerate(corners):
            ends[i] = [*ends[i], *(bounds.true(**settings, **change) for change, _ in axes)]
        errors = [*errors, *(least for _, least in axes)]
        known, robots = robots, [family(model, end) for (_, model), end in zip(
            corners, ends, strict=True)]
        yield Source(name, [by_robot(base, true, rate())
                            for base, true in zip(known, robots, strict=True)], errors)
    # Friction and water act on the robot as it is.
    if error.joint_friction.largest > 0.0:
        n = bounds.model.num_joints
        forces = np.concatenate([np.zeros(6), error.joint_friction.torques(n)[1]])
        yield Source(f"joint friction of {np.max(forces):g} N m",
                     [by_forces(true, forces) for true in robots], errors)
    current, waves = unknowns.current, unknowns.waves
    if np.any(current) or waves:
        along, down = float(np.hypot(*current[:2])), abs(float(current[2]))
        parts = [f"a current of {np.linalg.norm(current):.3g} m/s"] * bool(np.any(current)) + [
            f"a wave of {wave.amplitude:g} m in {wave.period:g} s" for wave in waves]
        yield Source(" and ".join(parts), [
            by_water(true, (along, sign * down), *((wave.speed, wave.frequency) for wave in waves))
            for true in robots for sign in ((1.0, -1.0) if down else (1.0,))], errors)


def _robot_errors(error: ModelError) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yields each error of the robot, and its changes of a `ModelError`."""
    for name in FACTORS:
        size = abs(getattr(error, name) - 1.0)
        if size > 0.0:
            yield (f"{name.replace('_', ' ')} off by {size:.3g}",
                   [{name: 1.0 + size}, {name: max(1.0 - size, LEAST_FACTOR)}])
    if error.payload.present:
        yield f"payload of {error.payload.mass:g} kg", [{"payload": error.payload}, {}]


def _errors_by_axis(error: ModelError) -> Iterator[tuple[str, list[tuple[dict[str, Any], float]]]]:
    """Yields each kind of error by axis, its changes at their sizes, and smallest ones over these.

    A change is one of a `ModelError`.
    """
    shift = np.asarray(error.buoyancy_shift, dtype=float)
    if np.any(shift):
        yield (f"centre of buoyancy off by {1e3 * np.linalg.norm(shift):.3g} mm",
               [({"buoyancy_shift": part}, -1.0) for part in np.diag(np.abs(shift)) if part.any()])
    for body, name in itertools.product(BODIES, COEFFICIENTS):
        sizes = np.abs(error.by_axis(body, name) - 1.0)
        if np.any(sizes):
            yield (f"{name.replace('_', ' ')} of the {body} off by {np.max(sizes):.3g} by axis", [
                ({body: AxisFactors(**{name: 1.0 + part})},
                 max(-1.0, (LEAST_FACTOR - 1.0) / float(np.max(part))))
                for part in np.diag(sizes) if part.any()])
