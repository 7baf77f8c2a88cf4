"""The tube of the law `resolved` in velocities, attitude, inputs and forces.

Given a nominal state (𝔮̄, ζ̄), a nominal input ū and errors (𝔢_y, 𝔯), the real state and input follow
by algebra, with nothing left to integrate:

    𝔮 = 𝔮(ȳ + 𝔢_y),   ζ = J_x(𝔮)⁻¹[J_x(𝔮̄)ζ̄ − σ𝔢_y] + 𝔯,   u = ζ̇_ref − f(𝔮, ζ) − k𝔯.

With 𝔭 = J_x(𝔮)⁻¹𝔢_y the largest parts are linear,

    ζ − ζ̄ = 𝔯 − σ𝔭 + rest,    u − ū = −(k + σ)𝔯 + σ²𝔭 + rest,                              (1)

and the two terms partly cancel, because both come from the same d: 𝔯̇ = −k𝔯 + d, and from the
cascade 𝔭̇ = −σ𝔭 + 𝔯 − J_x⁻¹J̇_x𝔭. Were the last term zero, (1) would be d through the filters

    s/((s + k)(s + σ))   and   −((k + σ)s + kσ)/((s + k)(s + σ)),

one channel at a time, whose output is at most the L₁ norm of their impulse responses
(`tubes.joint_rate_radius`, `input_gain`) times |dᵢ| ≤ Ŵᵢd̃, and in the 2-norm of a block of channels
times its largest Ŵᵢd̃, for ‖Ŵ⁻¹d‖₂ ≤ d̃. The last term moves 𝔭 from 𝔭₀, which goes without it, by
δ (`tubes.preimage_shift`), which adds σ‖δ‖ and σ²‖δ‖.

The rests in (1) are small: the nominal motion seen from a slightly different configuration, and
the drift. Its largest value over the tube is taken to first order in the errors at sampled nominal
states, where it is a support function Σ_blocks ‖∂c/∂(block)‖ radius (‖∂c/∂(block) Ŵ‖ for 𝔢_q and
𝔯, which are in ellipsoids), and the second-order part is measured at the maximising errors and
added. Further rounds of samples close in on the worst nominal states. That part is an *estimate* of
a supremum, and is multiplied by a declared safety factor.

Where 𝔢_p, 𝔢_o and 𝔢_q may each be anything in their ball, the vehicle has to make up for what the
arm is off by. With weights the errors are therefore also taken as 𝔢_y = J_x(𝔮)(𝔭₀ + δ),
‖Ŵ⁻¹𝔭₀‖ ≤ d̃/(kσ), where joints that are pushed hard leave the vehicle alone, and the smaller
supremum of the two counts.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.euler import wrap_angle
from uvms_drake.model.spatial import times
from uvms_drake.model.uvms_model import COMPLEX_STEP, configuration_rate
from uvms_drake.tube.constraint_set import ConstraintSet
from uvms_drake.tube.push import Push
from uvms_drake.tube.tubes import joint_rate_radius, preimage_shift

CLOSING_ROUNDS = 3
CLOSING_FACTOR = 0.3
"""Size of each round's neighbourhood over the last one's."""
LEADERS = 4
"""Worst nominal states per channel that a round closes in on."""


@dataclass(frozen=True)
class TubeImage:
    """Largest deviation of the real from the nominal, per channel."""

    nu1: float
    """Largest ‖ν₁ − ν̄₁‖₂ [m/s]."""
    nu2: float
    """Largest ‖ν₂ − ν̄₂‖₂ [rad/s]."""
    qdot: float
    """Largest ‖q̇ − q̄̇‖₂ [rad/s]."""
    roll: float
    """Largest |φ − φ̄| of the vehicle [rad]."""
    pitch: float
    """Largest |θ − θ̄| of the vehicle [rad]."""
    u: np.ndarray
    """Largest |𝔲ᵢ − ūᵢ| (6+n,) [m/s² (3), rad/s² (3+n)]."""
    tau: np.ndarray
    """Largest |τᵢ − τ̄ᵢ| (6+n,) [N (3), N m (3+n)], τ = M(𝔮)𝔲."""
    omega: float
    """Bound ω of ‖J_x⁻¹J̇_x‖₂ [1/s]."""
    samples: int
    """Number of nominal states looked at."""


@dataclass(frozen=True)
class _Nominal:
    config: np.ndarray
    zeta: np.ndarray
    u: np.ndarray

    def __getitem__(self, index) -> "_Nominal":
        return _Nominal(self.config[index], self.zeta[index], self.u[index])


@dataclass(frozen=True)
class _Errors:
    """The sets that (𝔢_y, 𝔯) are in, as sums of ellipsoids; see `_largest`."""

    radii: tuple[float, float, float, float]
    """Of 𝔢_p, 𝔢_o, Ŵ⁻¹𝔢_q and Ŵ⁻¹𝔯."""
    weights: np.ndarray
    """Diagonal of Ŵ (6+n,)."""
    shift: float
    """Of 𝔭, in the vehicle's components: in those of the joints, J_x⁻¹J̇_x has no rows."""
    push: Push
    """What a felt contact adds, beyond 𝔢_p and 𝔢_o."""

    def of_blocks(self) -> list[tuple[np.ndarray, float]]:
        """Returns a ball for each block."""
        size = len(self.weights)
        axes = np.diag(np.concatenate([np.ones(6), self.weights[6:], self.weights]))
        blocks = (slice(0, 3), slice(3, 6), slice(6, size), slice(size, 2 * size))
        return [(axes[None, :, block], radius)
                for block, radius in zip(blocks, self.radii, strict=True)
                ] + self._pushed(np.eye(2 * size)[None], (0.0, 0.0, self.push.p[2]))

    def _pushed(self, axes: np.ndarray, p: tuple[float, ...] | np.ndarray
                ) -> list[tuple[np.ndarray, float]]:
        """Returns balls in the blocks of 𝔭 and 𝔯, of the radii `p` and those of the push."""
        size = len(self.weights)
        eye, blocks = np.eye(2 * size)[None], _blocks(size)
        found = [(axes[:, :, block], radius) for block, radius in zip(blocks, p, strict=True)] + [
            (eye[:, :, size:][:, :, block], radius)
            for block, radius in zip(blocks, self.push.r, strict=True)]
        return [(matrix, radius) for matrix, radius in found if radius > 0.0]

    def of_preimage(self, J: np.ndarray) -> list[tuple[np.ndarray, float]]:
        """Returns those of 𝔭₀, δ and Ŵ⁻¹𝔯, by J_x(𝔮̄) (m, 6+n, 6+n)."""
        size = len(self.weights)
        *_, radius, r = self.radii
        both = np.concatenate([J, np.zeros_like(J)], axis=1)
        return [(both * self.weights, radius), (both[:, :, :6], self.shift),
                (np.eye(2 * size)[None, :, size:] * self.weights, r)
                ] + self._pushed(both, self.push.p)


def _blocks(size: int) -> tuple[slice, slice, slice]:
    """Returns the components of ν₁, ν₂ and q̇."""
    return slice(0, 3), slice(3, 6), slice(6, size)


def input_gain(k: float, sigma: float) -> float:
    """Returns the L₁ norm of ((k + σ)s + kσ)/((s + k)(s + σ)), symmetric in k and σ.

    Its impulse response (k² e^{−kt} − σ² e^{−σt})/(k − σ) changes its sign once, at
    t* = 2 ln(k/σ)/(k − σ); with F(t) the integral up to t and F(∞) = 1, the norm is 2F(t*) − 1.
    """
    if abs(k - sigma) < 1e-6 * k:
        sigma = k * (1.0 - 1e-6)
    late = 2.0 * np.log(k / sigma) / (k - sigma)
    part = (k * (1.0 - np.exp(-k * late)) - sigma * (1.0 - np.exp(-sigma * late))) / (k - sigma)
    return float(2.0 * part - 1.0)


def rests(model: ContactModel, nominal_config: np.ndarray, nominal_zeta: np.ndarray,
         nominal_u: np.ndarray, e_y: np.ndarray, r: np.ndarray, k: float, sigma: float
         ) -> np.ndarray:
    """Returns the rests of ζ and u in (1), of τ = M𝔲, and (φ, θ) − (φ̄, θ̄) (..., 3(6+n) + 2).

    In the order ζ, (φ, θ), u, τ. The rest of τ is τ − τ̄ − M(𝔮)[−(k + σ)𝔯 + σ²𝔭].

    Args:
        model: The prediction model.
        nominal_config: 𝔮̄ (..., 6+n).
        nominal_zeta: ζ̄ (..., 6+n).
        nominal_u: ū (..., 6+n).
        e_y: 𝔢_y (..., 6+n); complex for a derivative.
        r: 𝔯 (..., 6+n); complex for a derivative.
        k: Velocity gain [1/s].
        sigma: σ [1/s].
    """
    # The nominal motion and its input.
    y_bar, J_bar, J_bar_dot = model.task_motion(nominal_config, nominal_zeta)
    f_bar = model.drift(nominal_config, nominal_zeta)
    y_dot = times(J_bar, nominal_zeta)
    y_ddot = times(J_bar_dot, nominal_zeta) + times(J_bar, nominal_u + f_bar)
    tau_bar = times(model.mass_matrix(model.kinematics(nominal_config)), nominal_u)

    # The real state, and the input of the law in it.
    config = model.configuration(y_bar + e_y)
    kinematics = model.kinematics(config)
    J = model.task_jacobian(config)
    p = _solve(J, e_y)
    zeta_ref = _solve(J, y_dot) - sigma * p
    zeta = zeta_ref + r
    e_dot = times(J, zeta) - y_dot
    J_dot_zeta_ref = _jacobian_rate_times(model, config, zeta, zeta_ref)
    zeta_ref_dot = _solve(J, y_ddot - sigma * e_dot - J_dot_zeta_ref)
    bias = model.inverse_dynamics(kinematics, zeta, np.zeros_like(zeta))
    M = model.mass_matrix(kinematics)
    u_rest = zeta_ref_dot + _solve(M, bias) + sigma * r - sigma**2 * p - nominal_u
    # Less the linear parts of (1).
    attitude = wrap_angle(config[..., 3:5] - nominal_config[..., 3:5])
    return np.concatenate([zeta - nominal_zeta - r + sigma * p, attitude, u_rest,
                           times(M, u_rest + nominal_u) - tau_bar], axis=-1)


def _jacobian_rate_times(model: ContactModel, config: np.ndarray, zeta: np.ndarray,
                         vector: np.ndarray) -> np.ndarray:
    """Returns J̇_x(𝔮; ζ) w by a central difference, which takes complex arguments too."""
    step = 1e-4
    rate = configuration_rate(config, zeta)
    ahead = model.task_jacobian(config + step * rate)
    behind = model.task_jacobian(config - step * rate)
    return times(ahead - behind, vector) / (2.0 * step)


def _solve(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.linalg.solve(A, b[..., None])[..., 0]


def tube_image(model: ContactModel, constraint_set: ConstraintSet, u_limits: np.ndarray, *,
               d_bound: float, gains: tuple[float, float], k: float, sigma: float,
               samples: int, safety_factor: float, seed: int,
               weights: np.ndarray | float = 1.0, push: Push | None = None,
               largest_rate: np.ndarray | float = np.inf) -> TubeImage:
    """Returns the deviations over the constraint set; infinite if σ ≤ ω.

    Args:
        model: The prediction model.
        constraint_set: Where nominal and real state are.
        u_limits: |ūᵢ| (6+n,).
        d_bound: d̃ [m/s², rad/s²].
        gains: Bounds of the norms of the position rows and the orientation rows of J_x Ŵ.
        k: Velocity gain [1/s].
        sigma: σ [1/s].
        samples: Number of nominal states of the first round.
        safety_factor: Factor of estimated suprema.
        seed: Seed of the samples.
        weights: Diagonal of Ŵ (6+n,), at most 1; 1 for a ball.
        push: What the errors of a force sensor add, if the contact is felt.
        largest_rate: Bounds of |ζ̄̇ᵢ| (6+n,) beside those that |ūᵢ| gives.
    """
    push = push or Push()
    rng = np.random.default_rng(seed)
    weights = weights * np.ones(model.size)
    def draw(count: int) -> _Nominal:
        """Returns random nominal motions within the limits."""
        config, zeta = constraint_set.sample(model, count, rng)
        u = u_limits * np.clip(1.5 * rng.uniform(-1.0, 1.0, zeta.shape), -1.0, 1.0)
        if np.any(np.isfinite(largest_rate)):
            f = model.drift(config, zeta)
            u = np.clip(u + f, -largest_rate, largest_rate) - f
        return _Nominal(config, zeta, u)

    # Samples of the whole set, then of ever smaller neighbourhoods of the worst ones.
    nominal = draw(samples)
    motion, inertia = _motion_and_inertia(model, nominal, 1.0)
    weighted_motion, weighted_inertia = _motion_and_inertia(model, nominal, weights)
    omega, alpha = safety_factor * motion, safety_factor * weighted_motion
    shift = preimage_shift(k, sigma, d_bound, omega, alpha)
    if np.any(push.p):  # ‖J_x⁻¹J̇_x𝔭₀‖ ≤ ω‖𝔭₀‖
        drift = omega * float(np.linalg.norm(push.p))
        shift += drift / (sigma - omega) if omega < sigma else np.inf
    radius = d_bound / (k * sigma)
    errors = _Errors((gains[0] * radius + push.position, gains[1] * radius + push.orientation,
                      radius, d_bound / k), weights, shift, push)
    values = _support(model, nominal, errors, k, sigma)
    total, spread = samples, 1.0
    for _ in range(CLOSING_ROUNDS):
        spread *= CLOSING_FACTOR
        leaders = np.unique(np.argsort(values, axis=0)[-LEADERS:].ravel())
        fresh = _between(model, nominal[leaders], draw(len(leaders)), spread)
        fresh = fresh[constraint_set.contains(model, fresh.config, fresh.zeta)]
        nominal = _Nominal(*(np.concatenate(pair) for pair in zip(
            _fields(nominal[leaders]), _fields(fresh), strict=True)))
        values = np.concatenate([values[leaders], _support(model, fresh, errors, k, sigma)])
        total += len(fresh.u)

    # The linear parts by their filters, with the shift δ of 𝔭; the rests as they were found.
    worst = safety_factor * np.max(values, axis=0)
    nu1, nu2, qdot = (
        joint_rate_radius(k, sigma, d_bound * float(np.max(weights[block], initial=0.0)))
        for block in (slice(0, 3), slice(3, 6), slice(6, None)))
    u, extra = input_gain(k, sigma) * d_bound, sigma**2 * shift
    u_rest, tau_rest = np.split(worst[4:], 2)
    nu1, nu2, qdot = np.array([nu1, nu2, qdot]) + push.z
    return TubeImage(
        nu1=float(worst[0] + (nu1 + sigma * shift)), nu2=float(worst[1] + (nu2 + sigma * shift)),
        qdot=float(qdot), roll=float(worst[2]), pitch=float(worst[3]),
        u=u_rest + (weights * u + extra + push.u),
        tau=(tau_rest + safety_factor * inertia * (weighted_inertia / inertia * u + extra)
             + safety_factor * _inertia_of_blocks(model, nominal) @ push.w),
        omega=float(omega), samples=total)


def _motion_and_inertia(model: ContactModel, nominal: _Nominal, weights: np.ndarray | float
                        ) -> tuple[float, np.ndarray]:
    """Returns the largest ‖J_x⁻¹J̇_xŴ‖ [1/s] and the largest norm of each row of MŴ (6+n,)."""
    _, J, J_dot = model.task_motion(nominal.config, nominal.zeta)
    motion = np.linalg.norm(np.linalg.solve(J, J_dot) * weights, 2, axis=(1, 2))
    M = model.mass_matrix(model.kinematics(nominal.config))
    return float(np.max(motion)), np.max(np.linalg.norm(M * weights, axis=2), axis=0)


def _inertia_of_blocks(model: ContactModel, nominal: _Nominal) -> np.ndarray:
    """Returns the largest norm of each row of the columns of M of ν₁, ν₂ and q̇ (6+n, 3)."""
    M = model.mass_matrix(model.kinematics(nominal.config))
    norms = [np.linalg.norm(M[:, :, block], axis=2) for block in _blocks(model.size)]
    return np.max(np.stack(norms, axis=-1), axis=0)


def _between(model: ContactModel, a: _Nominal, b: _Nominal, spread: float) -> _Nominal:
    """Returns states a fraction `spread` of the way from `a` to `b`, straight in (y, ζ, ū).

    Joint limits, tip pitch, depth in a plane and speeds are convex there; the vehicle's attitude
    is not.
    """
    y_a, y_b = model.task_pose(a.config), model.task_pose(b.config)
    return _Nominal(model.configuration(y_a + spread * (y_b - y_a)),
                    a.zeta + spread * (b.zeta - a.zeta), a.u + spread * (b.u - a.u))


def _fields(nominal: _Nominal) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return nominal.config, nominal.zeta, nominal.u


def _support(model: ContactModel, nominal: _Nominal, errors: _Errors, k: float, sigma: float
             ) -> np.ndarray:
    """Returns the largest rest of ν₁, ν₂, φ, θ, uᵢ and τᵢ (m, 4 + 2(6+n)) over the errors."""
    # Jacobian of all rests by (𝔢_y, 𝔯) at zero errors.
    size = model.size
    steps = 1j * COMPLEX_STEP * np.eye(2 * size)
    lift = _Nominal(*(item[:, None] for item in _fields(nominal)))
    moved = rests(model, *_fields(lift), steps[:, :size], steps[:, size:], k, sigma)
    G = np.swapaxes(moved.imag / COMPLEX_STEP, 1, 2)  # (m, channels, 2(6+n))

    def rest(error: np.ndarray) -> np.ndarray:
        return rests(model, *_fields(nominal), error[:, :size], error[:, size:], k, sigma)

    found = _largest(G, errors.of_blocks(), rest)
    ball = np.all(errors.weights == 1.0) and not np.any(errors.push.p)
    if ball or not np.isfinite(errors.shift):
        return found
    # The same errors by 𝔭; the second-order part has J_x at the real configuration in it.
    y, J = model.task_pose(nominal.config), model.task_jacobian(nominal.config)

    def rest_of_preimage(error: np.ndarray) -> np.ndarray:
        e_y, r = np.split(error, 2, axis=1)
        real = model.task_jacobian(model.configuration(y + e_y))
        return rest(np.concatenate([times(real, _solve(J, e_y)), r], axis=1))

    return np.minimum(found, _largest(G, errors.of_preimage(J), rest_of_preimage))


def _largest(G: np.ndarray, parts: list[tuple[np.ndarray, float]],
             rest: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Returns the largest rests (m, 4 + 2(6+n)) over a set of errors, a sum of ellipsoids.

    For the norm of a block of channels the operator norm of its Jacobian takes the place of the
    row's norm; errors and remainder are those of the block's leading direction.

    Args:
        G: Jacobians of the rests by the errors (m, 3(6+n) + 2, 2(6+n)).
        parts: Matrices (m or 1, 2(6+n), j) and radii: the errors are Σ matrix · ball of the radius.
        rest: Gives the rests themselves (m, 3(6+n) + 2) at errors (m, 2(6+n)).
    """
    count, width, columns = G.shape
    size = columns // 2
    # ν₁ and ν₂ are a channel each, then every component is one.
    channels = [slice(0, 3), slice(3, 6), *(slice(i, i + 1) for i in range(size, width))]
    out = np.empty((count, len(channels)))
    for column, row in enumerate(channels):
        # To first order, the largest value over the errors, and those at which it is reached.
        out[:, column], error = 0.0, np.zeros((count, columns))
        for matrix, radius in parts:
            left, singular, right = np.linalg.svd(G[:, row] @ matrix, full_matrices=False)
            out[:, column] += radius * singular[:, 0]
            # One sign for all parts, so that their contributions add up.
            sign = np.where(np.sum(left[:, :, 0], axis=1) < 0.0, -1.0, 1.0)
            error += radius * times(matrix, sign[:, None] * right[:, 0, :])
        # The part of second order, at these errors.
        linear = times(G[:, row], error)
        out[:, column] += np.linalg.norm(rest(error)[:, row] - linear, axis=1)
    return out
