"""Declared unknowns: model errors, currents and waves of a scenario, as a part of d.

Each source is a difference of the robot or the water from the controller's model, of either sign
and up to its declared size. The acceleration that it causes over the declared set is bounded, and
the sum of these has to fit into the part of `disturbance.bound` that `model_error.share` reserves.
Theorem: tube/theory.md#declared-unknowns.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydrake.multibody.plant import MultibodyPlant

from uvms_drake.control.limits import TubeRadii, resolved_radii
from uvms_drake.model.uvms_model import UvmsModel, read_uvms
from uvms_drake.plant.disturbance import Disturbance
from uvms_drake.plant.model_error import FACTORS, ModelError, Unknowns, add_simulated_uvms
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.conditions import Condition, rounded_up, setting
from uvms_drake.tube.estimates import Estimate
from uvms_drake.tube.law_tube import Basis
from uvms_drake.tube.search.joint_search import second_over_joints, supremum_over_joints
from uvms_drake.tube.unmodelled_dynamics import (
    Motions,
    UnmodelledTerm,
    box,
    by_forces,
    by_robot,
    by_water,
    commanded_rate,
    drift_change,
    largest,
    motions,
    sizes,
    tip_acceleration,
)

READING = "sensing/theory.md#reading-of-a-payload"
THEOREM = "tube/theory.md#declared-unknowns"
HAND = "acceleration of the payload"
"""Name of an estimate."""
LEAST_FACTOR = 0.1
"""Smallest factor of a `ModelError`."""
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
    second: float
    """Largest ‖w⁻¹d‖₂ that a second search found; NaN without one."""


class UnmodelledBounds:
    """Bounds of the unmodelled accelerations of a robot that is controlled within its limits.

    Args:
        robot: Name or folder of the robot.
        basis: Basis of its tube.
        radii: Its tube, which bounds the feedback.
        seed: Seed of the searches.
    """

    def __init__(self, robot: str, basis: Basis, radii: TubeRadii, seed: int):
        self.robot, self.basis, self.model = robot, basis, basis.model
        self._seed = seed
        tube, n = resolved_radii(radii), basis.model.num_joints
        off = np.concatenate([
            np.full(n, tube.joints or 0.0), [tube.roll or 0.0, tube.pitch or 0.0],
            np.repeat([tube.nu1 or 0.0, tube.nu2 or 0.0, tube.qdot or 0.0], [3, 3, n])])
        self._factor = basis.settings.safety_factor
        change = self._factor * drift_change(self.model, basis.declared, off, seed)
        self.rate = commanded_rate(
            self.model, basis.u_limit, basis.largest_rate + np.asarray(radii.u) + change,
            force=basis.declared.force_max if basis.contact is None else 0.0)

    def true(self, **error: Any) -> UvmsModel:
        """Returns the robot with a model error."""
        plant = MultibodyPlant(time_step=0.0)
        uvms = add_simulated_uvms(plant, self.robot, ModelError(**error))
        plant.Finalize()
        return UvmsModel(uvms)

    def largest(self, terms: Sequence[UnmodelledTerm], weights: np.ndarray
                ) -> tuple[np.ndarray, float]:
        """Returns bounds of |dᵢ| (6+n,) and of ‖Ŵ⁻¹d‖₂, estimated, for the diagonal of Ŵ."""
        found = self._factor * largest(
            terms, self.model, self.basis.declared, weights, self._seed)
        return found[:-1], float(found[-1])

    def second(self, terms: Sequence[UnmodelledTerm], weights: np.ndarray) -> float:
        """Returns the largest ‖Ŵ⁻¹d‖₂ at random points."""
        model, declared = self.model, self.basis.declared

        def norms(points: np.ndarray) -> np.ndarray:
            at = motions(points, model, declared)
            return np.max([sizes(term(at), weights)[:, -1:] for term in terms], axis=0)

        return float(second_over_joints(norms, *box(model, declared), self._seed)[0])

    def hand(self, reach: float, unknown: np.ndarray) -> Estimate:
        """Returns the largest acceleration of points about the tip [m/s²], estimated.

        Args:
            reach: Their largest distance from the tip [m].
            unknown: Bounds of |dᵢ| (6+n,), in addition to the commanded rate.
        """
        model, declared, seed = self.model, self.basis.declared, self._seed

        def values(points: np.ndarray) -> np.ndarray:
            at = motions(points, model, declared)
            return tip_acceleration(model, at, self.rate(at) + unknown, reach)[:, None]

        limits = box(model, declared)
        return Estimate(HAND, self._factor * float(supremum_over_joints(values, *limits, seed)[0]),
                        float(second_over_joints(values, *limits, seed)[0]))


def declared_effects(scenario: Scenario, basis: Basis, radii: TubeRadii
                     ) -> tuple[tuple[UnknownEffect, ...], tuple[Estimate, ...], list[Condition]]:
    """Returns the effects of the declared unknowns, their estimates, and the conditions on them.

    Args:
        scenario: Scenario with unknowns.
        basis: Basis of its tube.
        radii: Its tube.
    """
    bounds = UnmodelledBounds(scenario.model, basis, radii, scenario.seed)
    effects = unknown_effects(scenario.unknowns, bounds, weights_of(scenario.disturbance, basis))
    conditions = [unknowns_condition(scenario.disturbance, scenario.unknowns, bounds, effects)]
    estimates = [Estimate(f"d by {each.name}", each.takes, each.second) for each in effects]
    carried = payload_acceleration(scenario, bounds, effects)
    if carried is not None:
        estimates.append(carried)
        conditions.append(payload_condition(scenario.model_error.payload.acceleration, carried))
    return effects, tuple(estimates), conditions


def unknown_effects(unknowns: Unknowns, bounds: UnmodelledBounds, weights: np.ndarray, *,
                    checked: bool = True) -> tuple[UnknownEffect, ...]:
    """Returns the effect of each unknown, on top of those before it.

    The robot changes by one source after the other, and the rate that the next one meets includes
    the effects of those before: so their sum bounds the effect of all.

    Args:
        unknowns: The declared unknowns.
        bounds: Bounds of the accelerations.
        weights: w (6+n,), see `weights_of`.
        checked: Whether a second search is made.
    """
    effects = list[UnknownEffect]()
    for name, terms in declared_sources(unknowns, bounds, effects):
        each, takes = bounds.largest(terms, weights)
        effects.append(UnknownEffect(
            name, tuple(map(float, each)), takes,
            bounds.second(terms, weights) if checked else math.nan))
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
    effects = unknown_effects(unknowns, bounds, weights_of(disturbance, bounds.basis),
                              checked=False)
    each = np.sum([effect.each for effect in effects], axis=0)
    weights = np.array([float(f"{size:.2g}") for size in np.maximum(
        each / np.max(each), LEAST_WEIGHT)])
    fitted = unknown_effects(unknowns, bounds, weights, checked=False)
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
                         effects: Sequence[UnknownEffect]) -> Estimate | None:
    """Returns the largest acceleration of a payload that a wrist sensor reads; None without one."""
    error = scenario.model_error
    if not error.payload.present or bounds.basis.contact is None:
        return None
    left = (1.0 - error.share) * scenario.disturbance.axes(bounds.model.size)
    density = read_uvms(bounds.robot).hydrodynamics.fluid_density
    reach = float(np.linalg.norm(error.payload.centre)) + error.payload.radius(density)
    return bounds.hand(reach, left + np.sum([each.each for each in effects], axis=0))


def payload_condition(declared: float, found: Estimate) -> Condition:
    """Returns the condition that a payload accelerates no more than its reading allows for."""
    return Condition(
        "model_error.payload.acceleration, not less than that of the payload [m/s²]",
        declared, ">=", found.claim,
        setting(model_error__payload__acceleration=rounded_up(1.02 * found.claim, 2)),
        theorem=READING, topic="model_error")


def declared_sources(unknowns: Unknowns, bounds: UnmodelledBounds, before: list[UnknownEffect]
                     ) -> Iterator[tuple[str, list[UnmodelledTerm]]]:
    """Yields the declared unknowns and their terms, for each sign of the robot's errors so far.

    Args:
        unknowns: The declared unknowns.
        bounds: Bounds of the accelerations.
        before: Effects of the unknowns so far, to which the caller adds each.
    """
    error = unknowns.error
    robots: list[tuple[dict[str, Any], UvmsModel]] = [({}, bounds.model)]

    def rate(at: Motions) -> np.ndarray:
        found: np.ndarray = bounds.rate(at) + sum(np.array(each.each) for each in before)
        return found

    # The robot, by one error after the other.
    for name, changes in _robot_errors(error):
        pairs = [(base, settings | change) for settings, base in robots for change in changes]
        robots = [(settings, bounds.true(**settings)) for _, settings in pairs]
        yield name, [by_robot(base, true, rate)
                     for (base, _), (_, true) in zip(pairs, robots, strict=True)]
    # Friction and water act on the robot as it is.
    if error.joint_friction.largest > 0.0:
        n = bounds.model.num_joints
        forces = np.concatenate([np.zeros(6), error.joint_friction.torques(n)[1]])
        yield (f"joint friction of {np.max(forces):g} N m",
               [by_forces(true, forces) for _, true in robots])
    current, waves = unknowns.current, unknowns.waves
    if np.any(current) or waves:
        along, down = float(np.hypot(*current[:2])), abs(float(current[2]))
        parts = [f"a current of {np.linalg.norm(current):.3g} m/s"] * bool(np.any(current)) + [
            f"a wave of {wave.amplitude:g} m in {wave.period:g} s" for wave in waves]
        orbits = [(wave.speed, wave.speed, wave.frequency) for wave in waves]
        yield " and ".join(parts), [
            by_water(true, (along, sign * down), orbits)
            for _, true in robots for sign in ((1.0, -1.0) if down else (1.0,))]


def _robot_errors(error: ModelError) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yields each error of the robot, and its changes of a `ModelError`."""
    for name in FACTORS:
        size = abs(getattr(error, name) - 1.0)
        if size > 0.0:
            yield (f"{name.replace('_', ' ')} off by {size:.3g}",
                   [{name: 1.0 + size}, {name: max(1.0 - size, LEAST_FACTOR)}])
    shift = np.asarray(error.buoyancy_shift, dtype=float)
    if np.any(shift):
        yield (f"centre of buoyancy off by {1e3 * np.linalg.norm(shift):.3g} mm",
               [{"buoyancy_shift": shift}, {"buoyancy_shift": -shift}])
    if error.payload.present:
        yield f"payload of {error.payload.mass:g} kg", [{"payload": error.payload}]
