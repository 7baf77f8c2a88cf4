"""Tube of the law `tip first` in joints, attitude of the tool, velocities, inputs and forces.

Given a nominal state, a nominal input and errors e = y − ȳ, ė of the outputs y = (η, s), the real
state and input follow by algebra:

    𝔮 = 𝔮(ȳ + e),   ζ = J_y(𝔮)⁻¹(J_y(𝔮̄)ζ̄ + ė),   u = J_y⁻¹(ÿ̄ + w − J̇_yζ) − f(𝔮, ζ),
    w = −(K + Σ)ė − KΣe,        u − ū = J_y(𝔮)⁻¹w + remainder.                             (1)

e, ė and w have bounds of their own by block of rows, and are taken as independent. Joints, tool and
velocities are searched whole; of u and τ the linear part of (1) is the largest sum of operator
norms over the postures, and the remainder is searched. All of it is estimated. See
tube/theory.md#image-of-the-tube-under-the-law-tip-first.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from uvms_drake.control.laws.outputs import vehicle_motion
from uvms_drake.control.limits import TubeRadii
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.frames.spatial import times
from uvms_drake.model.uvms_model import Kinematics, configuration_rate_matrix
from uvms_drake.tube.estimates import (
    CertificateSettings,
    Check,
    Estimate,
    no_estimates,
    together,
)
from uvms_drake.tube.laws.resolved_remainders import jacobian_rate_times
from uvms_drake.tube.search import joint_search, search_problem
from uvms_drake.tube.search.ascent import first_order
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.second_search import claimed

LEADERS = 12
"""Climbers for each channel: near a singular posture there are many local maxima."""
ITERATIONS = 6
"""Number of Newton's steps to the joint angles of outputs."""


@dataclass(frozen=True)
class TipFirstProblem(search_problem.SearchProblem):
    """Remainders by errors (e, ė); see `tip_first_remainders`."""

    rows: np.ndarray
    """The tip's task in (χ, q) (n,)."""
    u_limits: np.ndarray
    """|ūᵢ| (6+n,)."""
    forces: bool = False
    """True if the remainders of τ count, too."""
    largest_rate: np.ndarray | float = field(default=np.inf)
    """|ζ̄̇ᵢ| (6+n,), in addition to the bound by |ūᵢ|."""

    @property
    def channels(self) -> list[slice]:
        """Channels of ν₁, ν₂, q̇, q, 𝔬, uᵢ and τᵢ."""
        size = self.size
        n, first = size - 6, 2 * size - 3
        return [slice(0, 3), slice(3, 6), slice(6, size), slice(size, size + n),
                slice(size + n, first), *(slice(i, i + 1) for i in range(
                    first, first + (2 if self.forces else 1) * size))]

    def values(self, x: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Returns the remainders (..., 4(6+n) − 3)."""
        pose, zeta, share = np.split(x, 3, axis=-1)
        nominal = search_problem.nominal_motion(self.model, self.config(pose), zeta)
        u = search_problem.input_within(nominal.drift, share, self.u_limits, self.largest_rate)
        return tip_first_remainders(self.model, self.rows, nominal, u, error[..., : self.size],
                                    error[..., self.size:])


class BlockBounds(NamedTuple):
    """Bounds of the 2-norms of a block of e, ė and w, or of their values in joint angles."""

    rows: np.ndarray
    """Indices in y = (η, s)."""
    e: float
    """Bound of e [m, rad]."""
    e_dot: float
    """Bound of ė [m/s, rad/s]."""
    w: float
    """Bound of w [m/s², rad/s²]."""


def block_bounds(sums: Mapping[str, np.ndarray], size: int) -> list[BlockBounds]:
    """Returns the bounds of the blocks from the bounds (4,) of e, ė, w and ë by name."""
    return [BlockBounds(where, *map(float, sums[name][:3])) for name, where in (
        ("vehicle", np.arange(3)), ("attitude", np.arange(3, 6)), ("joints", np.arange(6, size)))]


def tip_first_image(model: ContactModel, declared: ConstraintSet, rows: np.ndarray,
                    blocks: list[BlockBounds], u_limits: np.ndarray,
                    settings: CertificateSettings, *, forces: bool,
                    largest_rate: np.ndarray | float, tip: float) -> tuple[TubeRadii, Check]:
    """Returns the deviations over the declared set, in which J_sq is regular, and their check.

    They are `joints` and `orientation`, and with the tip's position `e`; `nu1`, `nu2`, `qdot` and
    `z`; `u` and, if it is needed, `tau`. All of them are estimated.

    Args:
        model: The prediction model.
        declared: Set of nominal and real states.
        rows: The tip's task in (χ, q) (n,).
        blocks: Bounds of x_η, and of x_q of the tip's rows; see `tip_first_remainders`.
        u_limits: |ūᵢ| (6+n,).
        settings: Search effort.
        forces: True if τ is needed.
        largest_rate: Bounds of |ζ̄̇ᵢ| (6+n,), in addition to those by |ūᵢ|.
        tip: Radius of the tip's position [m].
    """
    # The linear part, and the speeds that remain for a plan.
    size = model.size
    linear, check = _linear(model, declared, rows, blocks, settings)
    least = least_speeds(model, declared, rows, blocks, settings.seed)
    limits = np.array([declared.nu1, declared.nu2, declared.qdot])
    if np.any(least >= limits):  # No speed remains for a plan.
        none = np.full(size, np.inf)
        nu1, nu2, qdot = map(float, least)
        return TubeRadii(e=np.inf, joints=np.inf, orientation=np.inf, nu1=nu1, nu2=nu2, qdot=qdot,
                         z=float(np.linalg.norm(least)), u=none,
                         tau=none if forces else None), check

    # The remainders, over plans of these speeds and errors in balls by block.
    nu1, nu2, qdot = limits - least
    declared = replace(declared, nu1=nu1, nu2=nu2, qdot=qdot)
    eye = np.eye(2 * size)
    parts: list[search_problem.Part] = [(eye[:, block.rows + shift], radius) for block in blocks
                         for shift, radius in ((0, block.e), (size, block.e_dot))
                         if radius > 0.0 and len(block.rows) > 0]
    problem = TipFirstProblem(model, declared, parts, rows, u_limits, forces, largest_rate)
    x = problem.draw(settings.tube_samples, np.random.default_rng(settings.seed))
    names = ["ν₁", "ν₂", "q̇", "q", "𝔬", *(f"remainder of {name}[{i}]" for name in (
        ("u", "τ") if forces else ("u",)) for i in range(size))]
    claim, check_search = claimed(problem, names, x, first_order(problem, x),
                                  settings.safety_factor, settings.seed, leaders=LEADERS)
    claim[:3] = np.maximum(claim[:3], least)

    u, tau = claim[5: 5 + size] + linear[:size], None
    if forces:
        tau = claim[5 + size:] + linear[size:]
    nu1, nu2, qdot, joints, orientation = map(float, claim[:5])
    return TubeRadii(e=float(np.linalg.norm([tip, orientation, joints])), position=tip,
                     joints=joints, orientation=orientation, z=float(np.linalg.norm(claim[:3])),
                     nu1=nu1, nu2=nu2, qdot=qdot, u=u, tau=tau), together(check, check_search)


class Arm(NamedTuple):
    """Authority of the arm over its tip's task, at its worst over the declared set."""

    regular: float
    """Smallest singular value of J_sq; not positive if its determinant changes its sign."""
    carried: float
    """Largest ‖J_sq⁻¹J_sv‖, gain of the joints by the vehicle [1/m]."""
    check: Check = no_estimates
    """Makes the second search for both."""


def arm_of(model: ContactModel, declared: ConstraintSet, rows: np.ndarray,
           settings: CertificateSettings) -> Arm:
    """Returns the authority of the arm over the declared set, estimated."""
    lower, upper = _postures(model, declared, rows)
    middle = np.linalg.slogdet(_task(model, rows, 0.5 * (lower + upper)[None])[..., 6:])[0]

    def values(x: np.ndarray) -> np.ndarray:
        J_s = _task(model, rows, x)
        J_sq = J_s[..., 6:]
        sign = np.linalg.slogdet(J_sq)[0] * middle
        least = sign * np.linalg.svd(J_sq, compute_uv=False)[:, -1]
        carried = np.linalg.norm(np.linalg.pinv(J_sq) @ J_s[..., :6], 2, axis=(1, 2))
        return np.stack([-least, carried], axis=1)

    found = joint_search.supremum_over_joints(values, lower, upper, settings.seed)
    least, factor = -float(found[0]), settings.safety_factor
    if least <= 0.0:
        return Arm(least, np.inf)
    carried = factor * float(found[1])

    def check() -> tuple[Estimate, ...]:
        second = joint_search.second_over_joints(values, lower, upper, settings.seed)
        other = -float(second[0])
        return (Estimate("‖J_sq⁻¹‖", factor / least, 1.0 / other if other > 0.0 else np.inf),
                Estimate("‖J_sq⁻¹J_sv‖", carried, float(second[1])))

    return Arm(least / factor, carried, check)


def _postures(model: ContactModel, declared: ConstraintSet, rows: np.ndarray
              ) -> tuple[np.ndarray, np.ndarray]:
    """Returns the box of joint angles, roll, pitch and, if it makes a difference, yaw.

    The position makes none. Nor does yaw if the tip's rows are turned by it as a whole: all of the
    position or none, and angles about a z-axis of Σ_T that is vertical.
    """
    turned = np.count_nonzero(rows < 3) in (0, 3) and (
        model.R_WT[2, 2] > 1.0 - 1e-12 or not np.any((rows >= 3) & (rows < 6)))
    attitude = [declared.roll, declared.pitch, *([] if turned else [declared.yaw])]
    return (np.append(declared.q_lower, np.negative(attitude)),
            np.append(declared.q_upper, attitude))


def _config(model: ContactModel, x: np.ndarray) -> np.ndarray:
    """Returns 𝔮 (m, 6+n) of postures (m, n+2) or (m, n+3)."""
    n = model.num_joints
    config = np.zeros((len(x), model.size))
    config[:, 3:3 + x.shape[1] - n], config[:, 6:] = x[:, n:], x[:, :n]
    return config


def _task(model: ContactModel, rows: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Returns J_s (m, n, 6+n) of postures."""
    return model.task_jacobian(_config(model, x))[:, rows]


def least_speeds(model: ContactModel, declared: ConstraintSet, rows: np.ndarray,
                 blocks: list[BlockBounds], seed: int) -> np.ndarray:
    """Returns the least radii of ν₁, ν₂ and q̇ (3,): those by ė to first order."""
    parts = slice(0, 3), slice(3, 6), slice(6, model.size)

    def values(x: np.ndarray) -> np.ndarray:
        inverse = _by_outputs(model, rows, _config(model, x))
        return np.stack([np.sum([
            np.linalg.norm(inverse[:, part][:, :, block.rows], 2, axis=(1, 2)) * block.e_dot
            for block in blocks], axis=0) for part in parts], axis=1)

    return joint_search.supremum_over_joints(values, *_postures(model, declared, rows), seed)


def _by_outputs(model: ContactModel, rows: np.ndarray, config: np.ndarray) -> np.ndarray:
    """Returns J_y⁻¹ diag(I, J_sq) (m, 6+n, 6+n), which takes (x_η, x_q) to ζ."""
    J = output_jacobian(model, config, model.kinematics(config), rows)
    right = np.zeros_like(J)
    right[:, :6, :6] = np.eye(6)
    right[:, 6:, 6:] = J[:, 6:, 6:]
    inverse: np.ndarray = np.linalg.solve(J, right)
    return inverse


def _linear(model: ContactModel, declared: ConstraintSet, rows: np.ndarray,
            blocks: list[BlockBounds], settings: CertificateSettings
            ) -> tuple[np.ndarray, Check]:
    """Returns the largest J_y⁻¹w and MJ_y⁻¹w (2(6+n),), w = (w_η, J_sq w_q)."""

    def values(x: np.ndarray) -> np.ndarray:
        config = _config(model, x)
        inverse = _by_outputs(model, rows, config)
        M = model.mass_matrix(model.kinematics(config))
        both = np.concatenate([inverse, M @ inverse], axis=1)
        sizes: np.ndarray = np.sum([np.linalg.norm(both[:, :, block.rows], axis=2) * block.w
                                    for block in blocks], axis=0)
        return sizes

    return joint_search.claimed_over_joints(
        "J_y⁻¹w and MJ_y⁻¹w", values, *_postures(model, declared, rows), settings.safety_factor,
        settings.seed)


def tip_first_remainders(
        model: ContactModel, rows: np.ndarray, nominal: search_problem.NominalMotion,
        nominal_u: np.ndarray, x: np.ndarray, x_dot: np.ndarray) -> np.ndarray:
    """Returns the remainders by errors of the outputs y = (η, s) (..., 4(6+n) − 3).

    The errors are e = (x_η, J_sq x_q) and ė = (x_η', J_sq x_q'), J_sq that of the real robot: those
    of s are in joint angles. In the order ζ − ζ̄; q − q̄ (n) and 𝔬 − 𝔬̄ of the end-effector; the
    remainders of u and of τ = Mu, u − ū − J_y⁻¹w and τ − τ̄ − MJ_y⁻¹w for the
    w = −(K + Σ)ė − KΣe of the law, J_y and M those of the real robot. Any argument may be complex,
    for a derivative.

    Args:
        model: The prediction model.
        rows: The tip's task in (χ, q) (n,).
        nominal: The nominal motion.
        nominal_u: ū (..., 6+n).
        x: (x_η, x_q) (..., 6+n).
        x_dot: (x_η', x_q') (..., 6+n).
    """
    # The nominal motion in y.
    config_bar, zeta_bar, at = nominal.config, nominal.zeta, nominal.kinematics
    J_bar = output_jacobian(model, config_bar, at, rows)
    y_dot = times(J_bar, zeta_bar)
    y_ddot = (times(J_bar, nominal_u + nominal.drift)
              + output_bias(config_bar, at, zeta_bar, rows))

    # The real state, and the acceleration of the law in it but for w.
    config = configuration_of(model, rows, config_bar, at, x)
    real = model.kinematics(config)
    J = output_jacobian(model, config, real, rows)
    inverse = np.linalg.inv(J)
    x_dot = np.broadcast_to(x_dot, config.shape)
    e_dot = np.concatenate([x_dot[..., :6], times(J[..., 6:, 6:], x_dot[..., 6:])], axis=-1)
    zeta = times(inverse, y_dot + e_dot)
    zeta_dot = times(inverse, y_ddot - output_bias(config, real, zeta, rows))
    f, M = model.drift_and_inertia(real, zeta)
    u_remainder = zeta_dot - f - nominal_u
    turned = pose_difference(real.chi, at.chi + 0.0 * real.chi)[..., 3:]
    return np.concatenate([
        zeta - zeta_bar, config[..., 6:] - config_bar[..., 6:], turned, u_remainder,
        times(M, u_remainder + nominal_u) - times(nominal.M, nominal_u)], axis=-1)


def output_jacobian(model: ContactModel, config: np.ndarray, kinematics: Kinematics,
                    rows: np.ndarray) -> np.ndarray:
    """Returns J_y (..., 6+n, 6+n), ẏ = J_y ζ."""
    J_eta = configuration_rate_matrix(config)[..., :6, :]
    return np.concatenate([J_eta, model.extended(kinematics.J_chi)[..., rows, :]], axis=-2)


def output_bias(config: np.ndarray, kinematics: Kinematics, zeta: np.ndarray, rows: np.ndarray
                ) -> np.ndarray:
    """Returns J̇_y ζ (..., 6+n)."""
    return np.concatenate([vehicle_motion(config, zeta)[2],
                           jacobian_rate_times(kinematics, zeta, zeta)[..., rows]], axis=-1)


def configuration_of(model: ContactModel, rows: np.ndarray, nominal_config: np.ndarray,
                     nominal: Kinematics, x: np.ndarray) -> np.ndarray:
    """Returns 𝔮 (..., 6+n) with the outputs ȳ + (x_η, J_sq(𝔮)x_q), by Newton's method from q̄."""
    s_bar = np.concatenate([nominal.chi, nominal_config[..., 6:]], axis=-1)[..., rows]
    config = nominal_config + 0.0 * x
    config[..., :6] += x[..., :6]
    for _ in range(ITERATIONS):
        kinematics = model.tip_kinematics(config)
        y = np.concatenate([kinematics.chi, config[..., 6:]], axis=-1)
        whole = y + 0.0
        whole[..., rows] = s_bar
        missing = pose_difference(whole, y)[..., rows]
        J_sq = model.extended(kinematics.J_chi)[..., rows, :][..., 6:]
        config[..., 6:] += np.linalg.solve(J_sq, missing[..., None])[..., 0] + x[..., 6:]
    return config
