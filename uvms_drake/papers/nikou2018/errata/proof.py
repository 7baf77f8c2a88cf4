"""Errata of the model, of the feedback law and of (lemma:tube): E1 to E5 and E12 to E14.

The verdict is a comparison of computed with printed numbers, so it can fail.
"""

import math
from typing import NamedTuple

import numpy as np

from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.papers.nikou2018.errata import paper
from uvms_drake.papers.nikou2018.errata.paper import (
    Erratum,
    configuration,
    erratum,
    numbers,
    robot,
)
from uvms_drake.papers.nikou2018.transpose import LemmaConstants

DIRECTIONS = 4000
"""Number of random (𝔢, 𝔯) at which V̇ is evaluated."""
D_BOUND = 0.1
"""d̃ of the tube in `invariant_sets`; it only scales the tube."""


def acceleration_input() -> Erratum:
    """E1: (eq:dynamics) has f with M⁻¹ inside and 𝔲 without, so 𝔲 is no force.

    The inverse dynamics, which does not use M, gives the τ at which ζ̇ = f + u. The acceleration of
    τ = u is f + M⁻¹u.
    """
    model, tolerance = robot(), 1e-10
    config, zeta, u = np.random.default_rng(1).uniform(-0.3, 0.3, (3, model.size))
    kinematics = model.kinematics(config)
    M = model.mass_matrix(kinematics)
    tau = model.inverse_dynamics(kinematics, zeta, model.drift(config, zeta) + u)
    as_acceleration = float(np.linalg.norm(tau - M @ u) / np.linalg.norm(tau))
    as_force = float(np.linalg.norm(np.linalg.solve(M, u) - u) / np.linalg.norm(u))
    diagonal = np.diag(M)
    return erratum("E1", as_acceleration < tolerance < as_force, as_force=as_force,
                   least=np.min(diagonal), most=np.max(diagonal))


def law_shapes() -> Erratum:
    """E2: the shapes of −k(e − ē) − kσJᵀ(ζ − ζ̄), of −k(𝔷 + σJᵀ𝔢) and of Λ∘Ω̄."""
    size = 6 + paper.NUM_JOINTS
    J, e, z = np.ones((6, size)), np.ones(6), np.ones(size)
    rows = len(z + J.T @ e)
    return erratum("E2", len(J) != len(z) and len(e) != len(z) and rows == size,
                   joints=paper.NUM_JOINTS, size=size, of_z=len(z), of_e=len(e), both=6 + size,
                   rows=rows)


class QuadraticForm(NamedTuple):
    """Bound V̇ ≤ −σ̲‖𝔢‖² + Λ₁‖𝔢‖‖𝔯‖ − (k − Λ₂)‖𝔯‖² + d̃‖𝔯‖ of the Lemma.

    Proof: papers/nikou2018/theory.md#lemma-of-the-paper.
    """

    sigma_lower: float
    Lambda_1: float
    """Λ₁ as printed."""
    corrected: float
    """Λ₁ with the terms that the proof loses."""
    Lambda_2: float

    def radius(self, k: float, d_bound: float, Lambda_1: float | None = None) -> float:
        """Returns d̃ over the smaller eigenvalue of the form, the radius of the ball; or inf.

        It is d̃/min(α₁, α₂) at the best ρ. Λ₁ is the corrected one if it is left out.
        """
        half = -0.5 * (self.corrected if Lambda_1 is None else Lambda_1)
        least = np.linalg.eigvalsh([[self.sigma_lower, half], [half, k - self.Lambda_2]])[0]
        return d_bound / float(least) if least > 0.0 else math.inf


def quadratic_form(c: LemmaConstants, sigma: float) -> QuadraticForm:
    """Returns the bound of V̇ by constants of the robot and a gain σ."""
    L, J = max(c.L_1, c.L_2), c.J_max
    return QuadraticForm(
        sigma * c.J_min - c.L_c, L + J + sigma * (c.L_c + c.J_dot),
        L * (1.0 + sigma * J) + J + sigma * (c.L_c * J + c.J_dot) + sigma**2 * J**3,
        L + sigma * J**2)


def needed_lambda(constants: LemmaConstants, J: np.ndarray, sigma: float, seed: int = 0) -> float:
    """Returns the largest Λ₁ that some admissible state needs in (eq:lyap3).

    V̇ comes from the error dynamics themselves, 𝔢̇ = 𝔟 + J𝔷 and 𝔷̇ = 𝔩; both sides have the same
    terms in k and d, which are left out. 𝔟, 𝔩 and J̇ maximise V̇ within the constants; 𝔢 and 𝔯,
    about the leading singular directions of J, and ‖𝔯‖/‖𝔢‖ are random.
    """
    c, L, form = constants, max(constants.L_1, constants.L_2), quadratic_form(constants, sigma)
    rng = np.random.default_rng(seed)
    U, _, Vh = np.linalg.svd(J)
    sign = rng.choice([-1.0, 1.0], (2, DIRECTIONS, 1))
    spread = 10.0 ** rng.uniform(-2.0, 1.0, (DIRECTIONS, 1))
    e = _unit(sign[0] * U[:, 0] + spread * rng.normal(size=(DIRECTIONS, len(U))))
    r = _unit(sign[1] * Vh[0] + spread * rng.normal(size=(DIRECTIONS, len(Vh))))
    along, R = r, 10.0 ** rng.uniform(-1.0, 4.0, DIRECTIONS)
    r = R[:, None] * along
    z = r - sigma * e @ J
    e_dot = c.L_c * _unit(e + sigma * r @ J.T) + z @ J.T
    drift = L * (1.0 + np.linalg.norm(z, axis=1))[:, None] * along
    r_dot = drift + sigma * c.J_dot * along + sigma * e_dot @ J
    growth = np.sum(e * e_dot, axis=1) + np.sum(r * r_dot, axis=1)
    return float(np.max((growth + form.sigma_lower - form.Lambda_2 * R**2) / R))


def lost_terms(constants: LemmaConstants, J: np.ndarray, sigma: float) -> Erratum:
    """E3: Λ₁ as printed, and with the terms that the proof loses, against the Λ₁ of states.

    Args:
        constants: Constants of the robot.
        J: A Jacobian (6, 6+n) with ‖J‖ = J̄.
        sigma: σ.
    """
    form = quadratic_form(constants, sigma)
    printed, corrected = form.Lambda_1, form.corrected
    needed = needed_lambda(constants, J, sigma)
    return erratum("E3", printed < needed <= corrected * (1.0 + 1e-9), printed=printed, sigma=sigma,
                   corrected=corrected, directions=DIRECTIONS, needed=needed,
                   of_printed=needed / printed, of_corrected=needed / corrected)


def attained_velocity(J: np.ndarray, sigma: float) -> float:
    """Returns ‖𝔷‖ at a state with ‖(𝔢, 𝔯)‖ = 1: leading directions of J, 𝔢 against 𝔯."""
    U, s, Vh = np.linalg.svd(J)
    length = math.hypot(1.0, sigma * s[0])
    e, r = sigma * s[0] / length * U[:, 0], -Vh[0] / length
    return float(np.linalg.norm(r - sigma * J.T @ e))


def velocity_tube(J: np.ndarray, sigma: float) -> Erratum:
    """E4: the radius of Ω₂ in units of that of Ω₁, against a state of the ball of the proof."""
    largest = float(np.linalg.norm(J, 2))
    printed, corrected = 2.0 / largest, math.hypot(1.0, sigma * largest)
    attained = attained_velocity(J, sigma)
    return erratum("E4", printed < attained <= corrected * (1.0 + 1e-9), printed=printed,
                   largest=largest, sigma=sigma, attained=attained, ratio=attained / printed,
                   corrected=corrected)


def self_motion() -> Erratum:
    """E5: two configurations with the same χ, and the differences of J and f between them."""
    q_a, q_b = paper.Q_START, paper.Q_START_OTHER
    model, config = robot(), configuration(paper.CHI_START, np.array([q_a, q_b]))
    geometry = model.kinematics(config)
    apart = float(np.linalg.norm(pose_difference(*geometry.chi)))
    J_gap = float(np.linalg.norm(geometry.J_chi[0] - geometry.J_chi[1], 2))
    f = model.drift(config, np.zeros_like(config))
    f_gap = float(np.linalg.norm(f[0] - f[1]))
    return erratum("E5", apart < paper.SAME and max(J_gap, f_gap) > 1e-6, q_a=numbers(q_a),
                   q_b=numbers(q_b), same=paper.SAME, J_gap=J_gap, f_gap=f_gap)


def corner_motion(s: float, k: float, sigma: float, z: float) -> tuple[float, float]:
    """Returns the rate of ‖𝔢‖ at the start [1/s], and its peak, from ‖𝔢‖ = 1 and ‖𝔷‖ = z.

    J is constant, f = 0 and d = 0; 𝔢 and 𝔷 start along the leading directions of J, ‖J‖ = s:

        d/dt (𝔢, 𝔷) = [0 s; −kσs −k] (𝔢, 𝔷).

    ‖𝔢‖ is largest when 𝔷 = 0.
    """
    values, vectors = np.linalg.eig(np.array([[0.0, s], [-k * sigma * s, -k]]).astype(complex))
    parts = vectors * np.linalg.solve(vectors, np.array([1.0, z], dtype=complex))  # Σ parts e^{λt}
    peak_time = (np.log(-parts[1, 1] / parts[1, 0]) / (values[0] - values[1])).real
    return s * z, float(np.sum(parts[0] * np.exp(values * peak_time)).real)


def ball_rate(J: np.ndarray, k: float, sigma: float) -> float:
    """Returns sup V̇/‖(𝔢, 𝔯)‖² of that loop: the largest eigenvalue of a symmetric matrix."""
    A = np.block([[-sigma * J @ J.T, J],
                  [-sigma**2 * J.T @ J @ J.T, sigma * J.T @ J - k * np.eye(J.shape[1])]])
    return float(np.linalg.eigvalsh(0.5 * (A + A.T))[-1])


def invariant_sets(J: np.ndarray, sigma: float = 1.0) -> Erratum:
    """E12: a corner of Ω₁ × Ω₂ is left even with the corrected terms; the ball of (𝔢, 𝔯) is not.

    The loop is the simplest, J(𝔮) constant and f = 0, so L = L_𝔠 = J̃ = 0, and k is twice the
    value of the corrected conditions.

    Args:
        J: A Jacobian (6, 6+n).
        sigma: σ.
    """
    singular = np.linalg.svd(J, compute_uv=False)
    constants = LemmaConstants(
        float(singular[-1]) ** 2, float(singular[0]), J_dot=0.0, L_c=0.0, L_1=0.0, L_2=0.0)
    form = quadratic_form(constants, sigma)
    k = 2.0 * (form.corrected**2 / (4.0 * form.sigma_lower) + form.Lambda_2)
    e = form.radius(k, D_BOUND)
    rate, peak = corner_motion(
        constants.J_max, k, sigma, math.hypot(1.0, sigma * constants.J_max))
    decay = -ball_rate(J, k, sigma)
    ball_is_kept = decay * e >= D_BOUND  # V̇ ≤ −decay ρ² + d̃ρ on its boundary
    return erratum("E12", peak > 1.0 + 1e-9 and ball_is_kept, k=k, rate=rate, peak=peak,
                   decay=decay, radius=e / D_BOUND)


def terminal_shapes() -> Erratum:
    """E13: the shapes of u_loc = 𝔎ξ̄ and of Q̃ = Q + 𝔎ᵀR."""
    size, state = 6 + paper.NUM_JOINTS, 12 + paper.NUM_JOINTS  # of u and of ξ = (e, ζ)
    return erratum("E13", size != state, joints=paper.NUM_JOINTS, size=size, state=state)


def configuration_set() -> Erratum:
    """E14: ‖J‖ on the way to 𝔮 = 0, a member of Q, and ‖J̇‖ at one 𝔮 for several ζ."""
    model = robot()
    gaps = (1e-2, 1e-4)  # of the vehicle's pitch [rad]
    near = np.outer(gaps, np.eye(model.size)[4])
    steep = np.linalg.norm(model.kinematics(near).J_chi, 2, axis=(-2, -1))
    zeta = np.random.default_rng(0).normal(size=model.size)
    zeta /= np.linalg.norm(zeta)
    still = configuration(paper.CHI_DES, paper.Q_DES)
    J_dot = [float(np.linalg.norm(model.task_motion(still, speed * zeta)[2][:6], 2))
             for speed in (0.0, 1.0, 2.0)]
    return erratum("E14", bool(steep[1] > 10.0 * steep[0] and J_dot[2] > 1.5 * J_dot[1] > 0.0),
                   steep=steep, gaps=gaps, J_dot=J_dot)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
