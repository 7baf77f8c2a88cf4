"""Feedforward of the rows behind delayed actuators: suprema of it, and of its rate.

The rows of `tip first` obey ÿ = Gv + (G − 1)h + c + δ, see `row_loop`; f = ÿ̄ + h is delayed. Along
the plan f is f̄ = (Ā τ̄_v, B̄ τ̄_q) of the plan's own forces τ̄; the real robot has in addition

    φ = h − h̄ − (A − Ā)τ̄,    ‖φ_b‖ ≤ Σ_b' ‖∂φ_b/∂x_b'‖ ‖x_b'‖ + ‖∂φ_b/∂ẋ_b'‖ ‖ẋ_b'‖,        (1)

x the errors of the outputs, those of the tip in joint angles. All suprema are over the declared set
and over plans within: estimates. See tube/actuation/theory.md#feedforward-of-the-rows.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.euler import COMPLEX_STEP
from uvms_drake.model.frames.spatial import times
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.tube.actuation.row_feedforward import RowFeedforward, row_feedforward
from uvms_drake.tube.rows.image import input_within
from uvms_drake.tube.rows.remainders import output_bias, output_jacobian
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.estimate import Check, largest_of
from uvms_drake.tube.search.joint_search import second_over_joints, supremum_over_joints
from uvms_drake.tube.settings import CertificateSettings

BATCH = 100
"""States evaluated at a time."""
SOME = 10
"""Number of states that show which of the numbers are zero everywhere."""
ROUNDS = 2
"""Rounds of the search, each of which takes several seconds."""
DIFFERENCE = 1e-4
"""Step of a finite difference [s]."""
CHECKS_FOR_EACH = 3
"""Points of the second search for each initial one of the first."""


VEHICLE_ROWS, ATTITUDE_ROWS, TIP_ROWS, TASK_ROWS = range(4)
"""Blocks of rows: the vehicle's position and attitude, the tip's position, its remaining task."""


class Plans(NamedTuple):
    """Limits of a plan."""

    nu1: float
    """Largest ‖ν̄₁‖ [m/s]."""
    nu2: float
    """Largest ‖ν̄₂‖ [rad/s]."""
    qdot: float
    """Largest ‖q̄̇‖ [rad/s]."""
    u: np.ndarray
    """Largest |ūᵢ| (6+n,)."""
    rate: np.ndarray
    """Largest |ζ̄̇ᵢ| (6+n,)."""


class ThrusterFeedforward(NamedTuple):
    """Suprema of the feedforward.

    Blocks of rows are those of `VEHICLE_ROWS` and so on; blocks of errors are the vehicle's
    position and attitude, x_q, the tip's in joint angles, and the last two blocks of rows.
    """

    plan: np.ndarray
    """‖f̄_b‖ (4,) [m/s², rad/s²]."""
    plan_rate: np.ndarray
    """‖d/dt f̄_b‖ between two knots of a plan (4,)."""
    jump: np.ndarray
    """‖(ĀM̄ζ̄̇)_b‖, of the part of f̄ that jumps at knots (4,)."""
    jump_rate: np.ndarray
    """‖d/dt (ĀM̄ζ̄̇)_b‖ between them (4,)."""
    smooth_rate: np.ndarray
    """‖d/dt (Āb̄)_b‖, of the part that does not jump (4,)."""
    turning: np.ndarray
    """Norms of the blocks of ȦA⁻¹ and of ḂB⁻¹ (4, 4) [1/s]."""
    by_error: np.ndarray
    """‖∂φ_b/∂x_b'‖, and then those by ẋ_b' (4, 10)."""
    by_error_rate: np.ndarray
    """Norms of the rates of these matrices along a plan (4, 10)."""
    by_tip: np.ndarray
    """Norms of the blocks of A M_vqJ_sq⁻¹ (4, 4): the vehicle's feedforward by the tip's."""
    by_wrench: np.ndarray
    """Norms of the blocks of J_sM⁻¹[1; 0]A⁻¹ (4, 4): the tip's feedforward by the wrench."""
    by_force: np.ndarray
    """‖(A J_Evᵀ)_b‖ and ‖(J_sM⁻¹J_Eᵀ)_b‖ (4,): feedforward by a force on the tip [1/kg]."""
    by_thrusters: np.ndarray
    """‖(J_yM⁻¹)_b ε‖ of the thrusters' wrench errors ε, all together (4,)."""
    by_joints: np.ndarray
    """Norms ‖J_bq‖ of the tip's rows (4,)."""
    into_joints: np.ndarray
    """Norms of J_sq⁻¹'s columns of them (4,)."""
    joints: np.ndarray
    """Gains of u and τ of the joints by the wrench, by the vehicle's blocks (2, 2(6+n))."""
    by_posture: np.ndarray
    """‖(∂M⁻¹/∂q τ̄)ᵢ‖, gain of the input of a plan's force by the joints (6+n,)."""


def thruster_feedforward(model: ContactModel, declared: ConstraintSet, rows: np.ndarray,
                         plans: Plans, driven: np.ndarray, off: np.ndarray,
                         settings: CertificateSettings) -> tuple[ThrusterFeedforward, Check]:
    """Returns the suprema, and the second search for them.

    Args:
        model: The prediction model; without contact, which is a source of its own.
        declared: The set.
        rows: The tip's task in (χ, q) (n,).
        plans: Limits of plans in it.
        driven: Axes of the vehicle with thrusters, and rows of η that are fed back.
        off: Wrench error of each thruster (6, m) [N, N m].
        settings: Search effort.
    """
    def at(points: np.ndarray) -> np.ndarray:
        return np.concatenate([values_at(
            points[i: i + BATCH], model, declared, rows, plans, driven, off)
            for i in range(0, len(points), BATCH)])

    corner, seed = np.ones(2 + model.num_joints + 3 * model.size), settings.seed
    # Many of them are zero everywhere.
    some = np.any(at(np.random.default_rng(seed).uniform(-1.0, 1.0, (SOME, len(corner)))), axis=0)
    box = -corner, corner
    claim = np.zeros(len(some))
    claim[some] = settings.safety_factor * supremum_over_joints(
        lambda points: at(points)[:, some], *box, seed, points=settings.tube_samples, rounds=ROUNDS)
    return _named(claim, model.size), lambda: (largest_of(
        "feedforward of the rows", claim, second_over_joints(
            at, *box, seed, points=CHECKS_FOR_EACH * settings.tube_samples)),)


def _named(values: np.ndarray, size: int) -> ThrusterFeedforward:
    """Returns the numbers of `values_at` by their names."""
    shapes = (*[(4,)] * 5, (4, 4), *[(4, 10)] * 2, *[(4, 4)] * 2, *[(4,)] * 4, (2, 2 * size),
              (size,))
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes])[:-1]
    return ThrusterFeedforward(*(part.reshape(shape) for part, shape in zip(
        np.split(values, ends), shapes, strict=True)))


def values_at(points: np.ndarray, model: ContactModel, declared: ConstraintSet, rows: np.ndarray,
              plans: Plans, driven: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Returns all numbers of `ThrusterFeedforward` at points of the cube [−1, 1]^(2+n+3(6+n)).

    The real and the nominal motion are in the same posture, with velocities of their own; a point
    is (q, roll, pitch), ζ, ζ̄ and ū, the last by its share of the tighter bound.
    """
    size, n, count = model.size, model.num_joints, len(points)
    by_position = np.flatnonzero(rows < 3)
    of_y = (np.arange(3), driven[driven >= 3], 6 + by_position,
            6 + np.setdiff1d(np.arange(n), by_position))
    config, zeta, zeta_bar, share = _motions(points, model, declared, plans)
    rate = model.drift(config, zeta_bar) + input_within(
        model, config, zeta_bar, share, plans.u, plans.rate)
    none = {"tip_acceleration": np.zeros((count, n)), "wrench": np.zeros((count, 6))}

    def of_rows(A: np.ndarray) -> list[np.ndarray]:
        """Returns norms (m,) of the blocks of A (m, 6+n, c)."""
        return [_norm(A[:, block]) for block in of_y]

    def between(A: np.ndarray) -> list[np.ndarray]:
        """Returns norms (m,) of the blocks of A (m, 6+n, 6+n)."""
        return [_norm(A[:, i[:, None], j]) for i in of_y for j in of_y]

    # f̄ of a plan, and its rate while ζ̄̇ is constant.
    step = 1j * COMPLEX_STEP * np.concatenate([configuration_rate(config, zeta_bar), rate], axis=1)
    planned = row_feedforward(
        model, config + step[:, :size], zeta_bar + step[:, size:], rows, **none)
    jumps, smooth = (times(_whole(planned, driven), forces)[..., None]
                     for forces in (times(planned.M, rate), planned.b))
    out = [norm for each in (
        (jumps + smooth).real, (jumps + smooth).imag / COMPLEX_STEP, jumps.real,
        jumps.imag / COMPLEX_STEP, smooth.imag / COMPLEX_STEP) for norm in of_rows(each)]

    # The maps A and B, and ȦA⁻¹ and ḂB⁻¹, zero for axes without thrusters.
    here = row_feedforward(
        model, config + 1j * COMPLEX_STEP * configuration_rate(config, zeta), zeta, rows, **none)
    maps, M = _whole(here, driven), here.M.real
    idle = np.setdiff1d(np.arange(6), driven)
    regular = maps.real.copy()
    regular[:, idle, idle] = 1.0
    inverse = np.linalg.inv(regular)
    inverse[:, idle] = 0.0
    out += between(maps.imag / COMPLEX_STEP @ inverse)

    # φ by the errors, now and a little later along the plan.
    kinematics = model.kinematics(config)
    J, J_E = output_jacobian(model, config, kinematics, rows), kinematics.J_links[:, -1]
    forces = times(M, rate) + here.b.real
    forces[:, idle] = 0.0
    by_x = _by_errors(model, config, zeta, rows, of_y, rate, forces)
    later = _by_errors(model, config + DIFFERENCE * configuration_rate(config, zeta_bar),
                       zeta + DIFFERENCE * rate, rows, of_y, rate, forces)
    out += [_norm(each[:, block]) for block in of_y for each in by_x]
    out += [_norm((after - each)[:, block]) / DIFFERENCE for block in of_y
            for each, after in zip(by_x, later, strict=True)]

    # The feedforward of the vehicle by that of the tip, and the other way round.
    across = np.zeros((2, count, size, size))
    across[0, :, :6, 6:] = here.by_tip.real
    across[1, :, 6:, :6] = here.by_wrench.real @ inverse[:, :6, :6]
    out += [*between(across[0]), *between(across[1])]

    # Forces on the tip, errors of the thrusters, and the tip's rows in joint angles.
    by_force = np.zeros((count, size, 3))
    by_force[:, :6] = here.vehicle_map.real @ J_E[:, :3, :6].swapaxes(1, 2)
    by_force[:, 6:] = J[:, 6:] @ np.linalg.solve(M, J_E[:, :3].swapaxes(1, 2))
    wrong = np.concatenate([off, np.zeros((n, off.shape[1]))])
    wrong = J @ np.linalg.solve(M, np.broadcast_to(wrong, (count, *wrong.shape)))
    by_joints, into_joints = np.zeros((2, count, size, n))
    by_joints[:, 6:] = J[:, 6:, 6:]
    into_joints[:, 6:] = np.linalg.inv(J[:, 6:, 6:]).swapaxes(1, 2)
    out += [*of_rows(by_force), *(np.sum(np.linalg.norm(wrong[:, block], axis=1), axis=-1)
                                  for block in of_y), *of_rows(by_joints), *of_rows(into_joints)]

    # Inputs of the joints by the wrench, and of a plan's forces by the posture.
    torques = np.zeros((count, size, 6))
    torques[:, 6:] = np.linalg.solve(here.tip_map.real, across[1, :, 6:, :6])
    both = np.concatenate([np.linalg.solve(M, torques), torques], axis=1)
    bent = config[:, None] + 1j * COMPLEX_STEP * np.eye(size)[6:]
    inputs = np.linalg.solve(model.mass_matrix(model.kinematics(bent)), np.broadcast_to(
        forces[:, None, :, None], (count, n, size, 1)))[..., 0]
    by_posture = np.linalg.norm(inputs.imag / COMPLEX_STEP, axis=1)
    return np.column_stack([*out, *(
        np.linalg.norm(both[:, :, block], axis=2) for block in of_y[:2]), by_posture])


def _whole(feedforward: RowFeedforward, driven: np.ndarray) -> np.ndarray:
    """Returns A and B as one matrix (m, 6+n, 6+n), zero for the axes that nothing drives."""
    n = feedforward.tip_map.shape[-1]
    out = np.zeros((len(feedforward.tip_map), 6 + n, 6 + n), feedforward.tip_map.dtype)
    out[:, driven[:, None], driven] = feedforward.vehicle_map[:, driven[:, None], driven]
    out[:, 6:, 6:] = feedforward.tip_map
    return out


def _motions(points: np.ndarray, model: ContactModel, declared: ConstraintSet, plans: Plans
             ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Returns 𝔮, ζ, ζ̄ and the share of ū (m, 6+n each) of points."""
    n = model.num_joints
    lower = np.append(declared.q_lower, [-declared.roll, -declared.pitch])
    upper = np.append(declared.q_upper, [declared.roll, declared.pitch])
    angles = lower + 0.5 * (1.0 + points[:, : n + 2]) * (upper - lower)
    config = np.zeros((len(points), model.size))
    config[:, 6:], config[:, 3:5] = angles[:, :n], angles[:, n:]
    real, planned, share = np.split(points[:, n + 2:], 3, axis=1)
    return (config, _in_balls(real, declared.nu1, declared.nu2, declared.qdot),
            _in_balls(planned, plans.nu1, plans.nu2, plans.qdot), share)


def _in_balls(unit: np.ndarray, *radii: float) -> np.ndarray:
    """Returns ζ (m, 6+n) whose ν₁, ν₂ and q̇ are in balls, of points of the unit cube."""
    blocks = np.split(unit, [3, 6], axis=1)
    return np.concatenate([
        radius * block / np.maximum(np.linalg.norm(block, axis=1, keepdims=True), 1.0)
        for block, radius in zip(blocks, radii, strict=True)], axis=1)


def _by_errors(model: ContactModel, config: np.ndarray, zeta: np.ndarray, rows: np.ndarray,
               blocks: Sequence[np.ndarray], rate: np.ndarray, forces: np.ndarray
               ) -> list[np.ndarray]:
    """Returns the ∂φ/∂x_b, and the ∂φ/∂ẋ_b (m, 6+n, ...), for `rate` and `forces` as planned."""
    size = model.size
    kinematics = model.kinematics(config)
    J_sq = output_jacobian(model, config, kinematics, rows)[:, 6:, 6:]
    tip_acceleration = times(output_jacobian(model, config, kinematics, rows)[:, 6:], rate)
    tip_acceleration += output_bias(config, kinematics, zeta, rows)[:, 6:]
    steps = 1j * COMPLEX_STEP * np.eye(2 * size)
    config, zeta = config[:, None] + steps[:, :size], zeta[:, None] + steps[:, size:]
    feedforward = row_feedforward(
        model, config, zeta, rows, tip_acceleration=tip_acceleration[:, None],
        wrench=forces[:, None, :6])
    kinematics = model.kinematics(config)
    s = np.concatenate([kinematics.chi, config[..., 6:]], axis=-1)[..., rows]
    rates = times(output_jacobian(model, config, kinematics, rows), zeta)
    # By 𝔮 and ζ: a row for each of them.
    of_outputs = np.concatenate([config[..., :6], s, rates], axis=-1).imag / COMPLEX_STEP
    off = np.concatenate([feedforward.vehicle - times(feedforward.vehicle_map, forces[:, None, :6]),
                          feedforward.tip - times(feedforward.tip_map, forces[:, None, 6:])],
                         axis=-1)
    of_feedforward = off.imag / COMPLEX_STEP
    both = np.split(np.linalg.solve(of_outputs, of_feedforward).swapaxes(1, 2), 2, axis=2)
    return [each for by_y in both for each in (
        by_y[..., :3], by_y[..., 3:6], by_y[..., 6:] @ J_sq, *(by_y[..., i] for i in blocks[2:]))]


def _norm(A: np.ndarray) -> np.ndarray:
    """Returns spectral norms (m,) of matrices (m, r, c); zero if one has no rows or columns."""
    if 0 in A.shape[1:]:
        return np.zeros(len(A))
    out: np.ndarray = np.linalg.norm(A, 2, axis=(1, 2))
    return out
