"""Ancillary laws where the velocity is the input: the command ζ and the bound along a run.

Under `transpose`, ζ = ζ̄ − σJ(𝔮̄)ᵀ𝔢; under `resolved`, ζ = J_x(𝔮)⁻¹[J_x(𝔮̄)ζ̄ − σ𝔢_y]. k is not read.
Proofs: papers/nikou2018/theory.md#kinematic-tubes.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.laws.law import AncillaryLaw, Pair, RunBound
from uvms_drake.control.laws.resolved import Resolved, reference_offset
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.papers.nikou2018.transpose import Transpose


class VelocityLaw(NamedTuple):
    """An ancillary law where the velocity is the input."""

    velocity: Callable[..., np.ndarray]
    """Function of the law, the model, 𝔮 measured (6+n,) and (𝔮̄, ζ̄) (2(6+n),) that returns the
    command ζ (6+n,) [m/s, rad/s]."""
    run_bound: Callable[..., RunBound]
    """Function of the law and w̃ that returns the bound along a run of χ̇ = J(𝔮)ζ + w."""


def resolved_velocity(law: Resolved, model: UvmsModel, configuration: np.ndarray,
                      nominal_state: np.ndarray) -> np.ndarray:
    """Returns ζ = J_x(𝔮)⁻¹ [J_x(𝔮̄) ζ̄ − σ 𝔢_y] (6+n,), which leaves 𝔢̇_y = −σ 𝔢_y + (w, 0)."""
    nominal_configuration, nominal_zeta = np.split(nominal_state, 2)
    error = pose_difference(
        model.task_pose(configuration), model.task_pose(nominal_configuration))
    velocity = model.task_jacobian(nominal_configuration) @ nominal_zeta
    return np.linalg.solve(model.task_jacobian(configuration), velocity - law.sigma * error)


def resolved_run_bound(law: Resolved, w_bound: float) -> RunBound:
    """Returns the bound along a run under the law `resolved`.

    𝔢̇_y = −σ𝔢_y + (w, 0) exactly, so Ė = −σE + w̃ for the task and its blocks, which a constant w
    takes to their bounds, and without w̃ for the joints. ‖𝔷‖ is compared with
    σ‖J_x(𝔮)⁻¹‖E + ‖J_x(𝔮)⁻¹(J_x(𝔮̄) − J_x(𝔮))ζ̄‖, and 𝔯 with zero, its value where ζ is the
    command. The states are the E of task, position, orientation and joints.
    """
    drive = np.array([w_bound, w_bound, w_bound, 0.0])

    def bounds(E: np.ndarray, now: Pair) -> np.ndarray:
        smallest, offset = np.linalg.svd(now.J_x[0], compute_uv=False)[-1], reference_offset(now)
        return np.array([*E, law.sigma / smallest * E[0] + float(np.sqrt(offset @ offset)), 0.0])

    return RunBound(4, lambda E, now: drive - law.sigma * E, bounds, from_deviation=True)


def transpose_velocity(law: Transpose, model: UvmsModel, configuration: np.ndarray,
                       nominal_state: np.ndarray) -> np.ndarray:
    """Returns ζ = ζ̄ − σJ(𝔮̄)ᵀ𝔢 (6+n,)."""
    nominal_configuration, nominal_zeta = np.split(nominal_state, 2)
    error = pose_difference(
        model.task_pose(configuration), model.task_pose(nominal_configuration))
    J_nominal = model.task_jacobian(nominal_configuration)[law.fed_back]
    return nominal_zeta - law.sigma * J_nominal.T @ error[law.fed_back]


def transpose_run_bound(law: Transpose, w_bound: float) -> RunBound:
    """Returns the bound along a run under the law `transpose`.

    With ζ = ζ̄ − σJ(𝔮̄)ᵀ𝔢, 𝔢̇ = J(𝔮)ζ − J(𝔮̄)ζ̄ + w = −σJ(𝔮̄)J(𝔮̄)ᵀ𝔢 + (J(𝔮) − J(𝔮̄))ζ + w, so that

        Ė = −σ λ(J(𝔮̄)J(𝔮̄)ᵀ) E + ‖(J(𝔮) − J(𝔮̄))ζ‖ + w̃,

    λ the smallest eigenvalue. The middle term is evaluated along the run: no constant bounds it
    by ‖𝔢‖, since the arm's self-motion, on which the law does not act, is in it. The joints
    have a bound only with J_x and 𝔢_y in place of J and 𝔢. ‖𝔷‖ is compared with σ‖J(𝔮̄)‖E,
    and 𝔯 with zero, its value where ζ is the command.
    """
    def rate(E: np.ndarray, now: Pair) -> np.ndarray:
        J, J_nominal = now.J_x[:, law.fed_back]
        smallest = np.linalg.eigvalsh(J_nominal @ J_nominal.T)[0]
        drive = np.linalg.norm((J - J_nominal) @ now.zeta[0]) + w_bound
        return drive - law.sigma * smallest * E

    def bounds(E: np.ndarray, now: Pair) -> np.ndarray:
        largest = float(np.linalg.norm(now.J_x[1, law.fed_back], 2))
        joints = E[0] if law.joints else np.inf
        return np.array([*np.repeat(E, 3), joints, law.sigma * largest * E[0], 0.0])

    return RunBound(1, rate, bounds, from_deviation=True)


VELOCITY_LAWS: dict[type[AncillaryLaw], VelocityLaw] = {
    Resolved: VelocityLaw(resolved_velocity, resolved_run_bound),
    Transpose: VelocityLaw(transpose_velocity, transpose_run_bound)}
"""The laws with a velocity, by their exact type."""


def velocity_law(law: AncillaryLaw) -> VelocityLaw:
    """Returns a law where the velocity is the input.

    Raises:
        InvalidParameter: It has none.
    """
    if type(law) not in VELOCITY_LAWS:
        raise InvalidParameter("ancillary", law.name, "a law with a velocity (motion: kinematic)")
    return VELOCITY_LAWS[type(law)]
