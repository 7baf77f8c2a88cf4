"""Random systems under the two feedback laws, a thousand at a time, whose constants are known."""

from collections.abc import Callable, Iterator
from types import SimpleNamespace

import numpy as np

from uvms_drake.papers.nikou2018.transpose import LemmaConstants, transpose_tube

COUNT = 1000
SPEED_LIMIT = 2.0
"""‖ζ‖ of the systems under `transpose`, whose L_c is that of these speeds."""


def times(A: np.ndarray, x: np.ndarray) -> np.ndarray:
    return (A @ x[..., None])[..., 0]


def transposed(A: np.ndarray) -> np.ndarray:
    return np.swapaxes(A, -1, -2)


def norm(x: np.ndarray) -> np.ndarray:
    return np.linalg.norm(x, axis=-1)


def unit(x: np.ndarray) -> np.ndarray:
    return x / np.maximum(norm(x), 1e-12)[..., None]


def integrate(rate: Callable, x: np.ndarray, duration: float, dt: float
              ) -> Iterator[tuple[float, np.ndarray]]:
    """Yields t and x at every step of a fourth-order Runge–Kutta method."""
    yield 0.0, x
    for i in range(round(duration / dt)):
        t = i * dt
        k1 = rate(t, x)
        k2 = rate(t + 0.5 * dt, x + 0.5 * dt * k1)
        k3 = rate(t + 0.5 * dt, x + 0.5 * dt * k2)
        k4 = rate(t + dt, x + dt * k3)
        x = x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        yield t + dt, x


def attack(seed: int, d_bound: np.ndarray, t: float, r: np.ndarray, toward_e: np.ndarray,
           leading: np.ndarray) -> np.ndarray:
    """Returns d (COUNT, size): each system has one of seven adversaries, with a random phase."""
    rng = np.random.default_rng(seed)
    phase, fixed = rng.uniform(0.0, 2.0 * np.pi, COUNT), unit(rng.normal(size=r.shape))
    wave = np.sin(2.0 * np.pi * rng.uniform(0.1, 2.0, COUNT) * t + phase)
    channel = np.eye(r.shape[1])[rng.integers(r.shape[1], size=COUNT)]
    small = 1e-6 * fixed
    kinds = [unit(r + small), unit(toward_e + small), leading, fixed, fixed * wave[:, None],
             fixed * np.sign(wave)[:, None], channel * np.sign(wave)[:, None]]
    which = np.arange(COUNT) % len(kinds)
    return d_bound[:, None] * np.stack(kinds)[which, np.arange(COUNT)]


def largest_norm(A: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Returns the largest ‖A + sB‖₂ (COUNT,), |s| ≤ 1: it is convex in s, so largest at an end."""
    return np.max(np.linalg.norm(np.stack([A + B, A - B]), 2, axis=(2, 3)), axis=0)


def extended_jacobians(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Returns A and B (COUNT, 4, 4) of `run_resolved`."""
    A, B = rng.normal(size=(2, COUNT, 4, 4))
    A[:, 2:] = np.eye(4)[2:]
    A[:, :2, :2] = np.linalg.qr(A[:, :2, :2])[0] * rng.uniform(0.7, 1.4, (COUNT, 1, 1))
    B[:, 2:] = 0.0
    B *= 0.2 / np.linalg.norm(B, 2, axis=(1, 2))[:, None, None]
    B[np.arange(COUNT) // 7 % 7 == 0] = 0.0
    return A, B


def run_resolved(seed: int) -> SimpleNamespace:
    """Runs ẏ = J(t, y)ζ, ζ̇ = f + u + d under `resolved`; the last two of four rows are joints.

    J = A + B sin(w·y + νt + φ) above [0 I]; in a seventh of the systems B = 0, and all adversaries
    meet them. f is stiff: its Lipschitz constant is 10³.

    Returns:
        k, sigma, d_bound (COUNT,); gains of the rows 0–3, 0–1, 0 and 2–3; time (T,); norms
        (7, T, COUNT) of 𝔯, the four blocks of 𝔢, 𝔢̇ and q̇ − q̄̇.
    """
    rng = np.random.default_rng(seed)
    k, sigma, d_bound = (rng.uniform(*span, COUNT) for span in ((5, 25), (1, 12), (0.05, 0.5)))
    A, B = extended_jacobians(rng)
    w, nu, phi = rng.normal(size=(COUNT, 4)), rng.normal(size=COUNT), rng.normal(size=COUNT)
    swing, beat = rng.uniform(0.05, 0.3, (COUNT, 4)), rng.uniform(0.5, 2.0, (COUNT, 4))
    mix = 1e3 * unit(rng.normal(size=(COUNT, 4, 4)))
    leading = np.linalg.svd(A)[2][:, 0]

    def errors(t, x):
        y, zeta = np.split(x, 2, axis=1)
        theta = np.sum(w * y, axis=1) + nu * t + phi
        J = A + B * np.sin(theta)[:, None, None]
        y_dot = times(J, zeta)
        J_dot = B * (np.cos(theta) * (np.sum(w * y_dot, axis=1) + nu))[:, None, None]
        nominal, velocity = swing * np.sin(beat * t), swing * beat * np.cos(beat * t)
        e, e_dot = y - nominal, y_dot - velocity
        zeta_ref = np.linalg.solve(J, (velocity - sigma[:, None] * e)[..., None])[..., 0]
        wanted = -beat**2 * nominal - sigma[:, None] * e_dot - times(J_dot, zeta_ref)
        zeta_ref_dot = np.linalg.solve(J, wanted[..., None])[..., 0]
        return J, e, e_dot, zeta - zeta_ref, zeta_ref_dot

    def rate(t, x):
        y, zeta = np.split(x, 2, axis=1)
        J, e, _, r, zeta_ref_dot = errors(t, x)
        f = times(mix, np.sin(y) + zeta * np.abs(zeta))
        u = zeta_ref_dot - f - k[:, None] * r
        d = attack(seed, d_bound, t, r, times(transposed(J), e), leading)
        return np.hstack([times(J, zeta), f + u + d])

    start = np.linalg.solve(A + B * np.sin(phi)[:, None, None], (swing * beat)[..., None])[..., 0]
    time, norms = [], []
    for t, x in integrate(rate, np.hstack([np.zeros((COUNT, 4)), start]), 2.0, 0.005):
        _, e, e_dot, r, _ = errors(t, x)
        time.append(t)
        norms.append([norm(part) for part in (
            r, e, e[:, :2], e[:, :1], e[:, 2:], e_dot, e_dot[:, 2:])])
    gains = [largest_norm(A[:, rows], B[:, rows])
             for rows in (slice(0, 4), slice(0, 2), slice(0, 1), slice(2, 4))]
    return SimpleNamespace(k=k, sigma=sigma, d_bound=d_bound, gains=gains, time=np.array(time),
                           norms=np.moveaxis(norms, 1, 0))


def draw_transpose(rng: np.random.Generator) -> SimpleNamespace:
    """Returns the systems of `run_transpose` and their constants."""
    A = np.linalg.qr(rng.normal(size=(COUNT, 4, 4)))[0][:, :3] * rng.uniform(
        0.9, 1.1, (COUNT, 1, 1))
    B = rng.normal(size=(COUNT, 3, 4))
    size = rng.uniform(0.0, 0.1, COUNT)
    size[np.arange(COUNT) // 7 % 7 == 0] = 0.0
    B *= (size / np.linalg.norm(B, 2, axis=(1, 2)))[:, None, None]
    w, nu, phi = rng.normal(size=(COUNT, 3)), rng.normal(size=COUNT), rng.normal(size=COUNT)
    L_1, L_2 = rng.uniform(0.0, 2.0, COUNT), rng.uniform(0.0, 1.0, COUNT)
    M = np.linalg.qr(rng.normal(size=(COUNT, 4, 3)))[0]
    N = np.linalg.qr(rng.normal(size=(COUNT, 4, 4)))[0]
    swing, beat = rng.uniform(-0.4, 0.4, (COUNT, 4)), rng.uniform(0.5, 2.0, (COUNT, 4))
    J_max = largest_norm(A, B)
    J_min = (np.linalg.svd(A)[1][:, -1] - size) ** 2
    steepness = size * norm(w)
    J_dot = steepness * J_max * norm(swing) + size * np.abs(nu)
    constants = [LemmaConstants(*values) for values in zip(
        J_min, J_max, J_dot, steepness * SPEED_LIMIT, L_1, L_2, strict=True)]
    return SimpleNamespace(A=A, B=B, w=w, nu=nu, phi=phi, L_1=L_1, L_2=L_2, M=M, N=N, swing=swing,
                           beat=beat, constants=constants)


def smallest_k(constants: LemmaConstants, sigma: float) -> float:
    """Returns the gain at which ab = J̄G in the tube of `transpose`: b is linear in it."""
    tube = transpose_tube(constants, 1.0, sigma, 0.0)
    return 1.0 - tube.b + tube.g * tube.G / tube.a


def run_transpose(seed: int) -> SimpleNamespace:
    """Runs χ̇ = J(t, χ)ζ, ζ̇ = f + u + d, 3 rows and 4 inputs, under `transpose`.

    J = A + B sin(w·χ + νt + φ), f = L₁ M sin χ + L₂ N sin ζ with ‖M‖ = ‖N‖ = 1. k is 1.1 to 2
    times the smallest that has a tube.

    Returns:
        constants, a list of `LemmaConstants`; k, sigma, d_bound (COUNT,); time (T,); norms
        (3, T, COUNT) of 𝔢, 𝔯 and 𝔷.
    """
    rng = np.random.default_rng(seed)
    system = draw_transpose(rng)
    A, B, w, nu, phi, L_1, L_2, M, N, swing, beat, constants = vars(system).values()
    d_bound = rng.uniform(0.05, 0.5, COUNT)
    sigma = np.array([2.0 * item.L_c / item.J_min + 0.2 for item in constants])
    k = rng.uniform(1.1, 2.0, COUNT) * np.array(
        [smallest_k(item, s) for item, s in zip(constants, sigma, strict=True)])
    leading = np.linalg.svd(A)[2][:, 0]

    def jacobian(t, chi):
        return A + B * np.sin(np.sum(w * chi, axis=1) + nu * t + phi)[:, None, None]

    def drift(chi, zeta):
        return (L_1[:, None] * times(M, np.sin(chi)) + L_2[:, None] * times(N, np.sin(zeta)))

    def errors(t, x):
        chi, zeta, nominal = np.split(x, [3, 7], axis=1)
        J_nominal = jacobian(t, nominal)
        e, z = chi - nominal, zeta - swing * np.sin(beat * t)
        return J_nominal, e, z + sigma[:, None] * times(transposed(J_nominal), e), z

    def rate(t, x):
        chi, zeta, nominal = np.split(x, [3, 7], axis=1)
        J_nominal, e, r, z = errors(t, x)
        u_nominal = swing * beat * np.cos(beat * t) - drift(nominal, zeta - z)
        d = attack(seed, d_bound, t, r, times(transposed(J_nominal), e), leading)
        zeta_dot = drift(chi, zeta) + u_nominal - k[:, None] * r + d
        return np.hstack([times(jacobian(t, chi), zeta), zeta_dot, times(J_nominal, zeta - z)])

    time, norms = [], []
    for t, x in integrate(rate, np.zeros((COUNT, 10)), 3.0, 0.01):
        assert np.max(norm(x[:, 3:7])) < SPEED_LIMIT
        time.append(t)
        norms.append([norm(part) for part in errors(t, x)[1:]])
    return SimpleNamespace(constants=constants, k=k, sigma=sigma, d_bound=d_bound,
                           time=np.array(time), norms=np.moveaxis(norms, 1, 0))
