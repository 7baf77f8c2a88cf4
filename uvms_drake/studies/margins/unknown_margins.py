"""Tolerances of model errors: of the robot, its joints, and the motion of the water.

Each induces a d, which takes the place of the declared one. Over the declared set it is in an
ellipsoid of the declared shape, or of the shape of its components on vehicle, attitude and joints;
the tube may admit either.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from uvms_drake.certificate.certify import basis_of
from uvms_drake.certificate.declared_unknowns import UnmodelledBounds
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.plant.payload import Payload
from uvms_drake.station.motions.motions import motion_of
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.studies.margins.margin import Margin, bracket, tube_conditions, worst_of
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.constants.constants import Constant
from uvms_drake.tube.law_tube import WEIGHTED
from uvms_drake.tube.search.joint_search import supremum_over_joints
from uvms_drake.tube.search.search_memo import SearchMemo, memoising
from uvms_drake.tube.unmodelled_dynamics import (
    UnmodelledTerm,
    by_forces,
    by_robot,
    by_water,
    by_wrench,
)

WAVE = 6.0
"""Period of the waves [s]."""
SMALLEST = 1e-3
"""Fraction of the typical value below which an error counts as zero."""
LEAST = 1e-3
"""Smallest semi-axis over the longest."""
ROWS = {"Jx_max": slice(None), "J_position_max": slice(0, 3), "J_attitude_max": slice(3, 6)}
"""Rows of J_x by the constant of their norm."""


class Setting:
    """Domain of the suprema of d, and the conditions on a d.

    A command of the law accelerates by no more than a plan may, and the feedback within its tube.

    Args:
        scenario: Scenario of the study.
        model: The controller's model.
        limit: Largest d̃ that certifies with the declared Ŵ [m/s², rad/s²].
    """

    def __init__(self, scenario: Scenario, model: ContactModel, limit: float):
        self._scenario, self.model, self._basis = scenario, model, basis_of(scenario, model)
        found = motion_of(scenario).tubes[type(scenario.ancillary)](
            scenario.ancillary, self._basis)
        self.bounds = UnmodelledBounds(scenario, self._basis, found.radii)
        self._limit = limit

    def largest(self, terms: Sequence[UnmodelledTerm]) -> tuple[np.ndarray, np.ndarray]:
        """Returns the largest |dᵢ|, and the semi-axes of an ellipsoid of all d (6+n,), estimated.

        Its shape is that of Ŵ, if it certifies; else that of the largest component of vehicle,
        attitude and joints.
        """
        basis, size = self._basis, self.model.size
        each, norm = self.bounds.largest(terms, basis.weights)
        if norm <= self._limit:
            return each, norm * basis.weights
        blocks = np.array([np.max(part, initial=0.0) for part in np.split(each, [3, 6])])
        blocks = np.maximum(blocks, LEAST * np.max(blocks))
        shape = np.repeat(blocks, [3, 3, size - 6])
        return each, self.bounds.largest(terms, shape)[1] * shape

    def failed(self, axes: np.ndarray) -> Condition | None:
        """Returns the condition that fails with d in an ellipsoid of these semi-axes, or None."""
        weights = axes / np.max(axes)
        if np.allclose(weights, self._basis.weights) and np.max(axes) <= self._limit:
            return None
        at = replace(self._scenario, disturbance=replace(
            self._scenario.disturbance, bound=float(np.max(axes)), weights=weights))
        basis = replace(self._basis, d_bound=float(np.max(axes)), weights=weights,
                        constants=self._basis.constants | self._row_norms(weights))
        return worst_of(tube_conditions(at, self.model, basis))

    def _row_norms(self, weights: np.ndarray) -> dict[str, Constant]:
        """Returns the norms of J_xŴ and of its rows of the tip, as proven in a certificate."""
        declared, n = self._basis.declared, self.model.num_joints

        def norms(points: np.ndarray) -> np.ndarray:
            config = np.zeros((len(points), 6 + n))
            config[:, 6:], config[:, 3:5] = points[:, :n], points[:, n:]
            J = self.model.task_jacobian(config) * weights
            inside = np.abs(self.model.task_pose(config)[:, 4]) <= declared.tip_pitch
            return inside[:, None] * np.stack([np.linalg.norm(
                J[:, rows], 2, axis=(1, 2)) for rows in ROWS.values()], axis=1)

        found = supremum_over_joints(
            norms, np.append(declared.q_lower, [-declared.roll, -declared.pitch]),
            np.append(declared.q_upper, [declared.roll, declared.pitch]), self._scenario.seed)
        factor = self._basis.settings.safety_factor
        return {WEIGHTED[name]: Constant(
            WEIGHTED[name], factor * float(value), "estimated", 0, {}, factor, float(value))
            for name, value in zip(ROWS, found, strict=True)}


@dataclass(frozen=True)
class Unknown:
    """Model error of the robot, or motion of the water."""

    name: str
    unit: str
    asked: float
    terms: Callable[[Setting, float], list[UnmodelledTerm]]
    """Function from a size to the unmodelled terms; several if it may have either sign."""
    most: float = math.inf
    """Largest meaningful size."""

    def margin(self, setting: Setting, searches: SearchMemo) -> Margin:
        """Returns the largest size for which all d are in an ellipsoid that certifies."""
        with memoising() as of_d:
            asked, _ = setting.largest(self.terms(setting, self.asked))

            def axes(size: float) -> np.ndarray:
                of_d.again()
                return setting.largest(self.terms(setting, size))[1]

            def failing(size: float) -> Condition | None:
                if size > self.most:
                    return Condition(f"meaningful size, {self.most:g}", size, "<=", self.most,
                                     theorem="tube/theory.md#model-error-as-a-disturbance")
                ellipsoid = axes(size)
                with memoising(searches):
                    searches.again()
                    return setting.failed(ellipsoid)

            size = self.asked
            while (failed := failing(size)) is not None and size > SMALLEST * self.asked:
                size /= 4.0
            if failed is not None:
                return Margin(self.name, self.unit, 0.0, 0.0, failed.name, tuple(
                    map(float, asked)), self.asked)
            size, failed = bracket(failing, size)
            return Margin(self.name, self.unit, 0.0, size, failed.name if failed else "", tuple(
                map(float, asked)), self.asked, tuple(map(float, axes(size))))


def unknowns(scenario: Scenario) -> list[Unknown]:
    """Returns the model errors and motions of the water."""
    def factor(name: str) -> Callable[[Setting, float], list[UnmodelledTerm]]:
        return lambda setting, size: [by_robot(
            setting.model, setting.bounds.true(**{name: 1.0 + sign * size}), setting.bounds.rate)
            for sign in (-1.0, 1.0)]

    def friction(setting: Setting, size: float) -> list[UnmodelledTerm]:
        forces = np.repeat([0.0, size], [6, setting.model.num_joints])
        return [by_forces(setting.model, forces)]

    return [
        Unknown("mass of all bodies, trimmed", "of it", 0.2, factor("mass"), 0.8),
        Unknown("added mass", "of it", 0.2, factor("added_mass"), 0.8),
        Unknown("drag", "of it", 0.2, factor("drag"), 0.8),
        Unknown("trim: displaced volume", "of it", 0.02, factor("buoyancy"), 0.8),
        Unknown("payload in the hand", "kg", 0.5, lambda setting, size: [by_robot(
            setting.model, setting.bounds.true(payload=Payload(mass=size)),
            setting.bounds.rate)]),
        Unknown("joint friction", "N m", 0.5, friction),
        Unknown("current", "m/s", 0.25, lambda setting, size: [
            by_water(setting.model, (size, 0.0))]),
        Unknown(f"waves of {WAVE:g} s, speed of the water", "m/s", 0.2, lambda setting, size: [
            by_water(setting.model, (0.0, 0.0), [(size, size, 2.0 * np.pi / WAVE)])]),
        Unknown("vehicle's wrench", "of it", 0.1, lambda setting, size: [
            by_wrench(setting.model, size, setting.bounds.rate, setting.bounds.force)])]
