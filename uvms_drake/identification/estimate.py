"""Parameters by Gauss and Newton's method on windows, and their intervals by logs or windows.

With residual r of the outputs over their noise, A = ∂x/∂θ and B = ∂x/∂(own parameters) of window w,
the own parameters, of known spread Λ⁻¹, are eliminated:

    H_w = AᵀA − AᵀB(BᵀB + Λ)⁻¹BᵀA,   g_w = Aᵀr − AᵀB(BᵀB + Λ)⁻¹(Bᵀr − Λ(own − its mean)).       (1)

Those that are seen (measured parts of x₀, moments, the clock) move with θ. Velocities that nothing
measures and the forces along them would have several minima in a window; they keep their mean, and
are errors of the outputs with covariance BΛ⁻¹Bᵀ in (1).

A step solves min ½δᵀHδ − gᵀδ with factors and added masses that a body can have. Errors within a
cluster, a log or a window, are correlated, those of different ones are taken as independent. With
H_c and g_c the sums over a cluster, and the correction CR2 of Bell and McCaffrey (2002) for the
part of a residual that its own fit takes away,

    cov θ = Σ s_c s_cᵀ,   s_c = A_c g_c,   A_c = L(I − LᵀH_cL)^(−½)Lᵀ,   LLᵀ = H⁻¹,             (2)

and θ ± t_ν σ with their degrees of freedom after Satterthwaite.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from pydrake.solvers import ClarabelSolver, MathematicalProgram

from uvms_drake.common.errors import RunFailed
from uvms_drake.common.progress import Progress, part_of, silent
from uvms_drake.identification.log import GRID, STATE, gravity_in_body
from uvms_drake.identification.output_error import OWN, STEP, simulated
from uvms_drake.identification.parameters import Parameter
from uvms_drake.identification.windows import INSTANTS, Windows
from uvms_drake.model.frames.spatial import times

NOISE = np.array([0.005, 0.005, 0.01, 0.02, 0.02, 0.02, 0.01, 0.01, 0.01])
"""Errors of x at first [rad, m, m/s, rad/s]; then those that are left, at least `LEAST_NOISE`."""
LEAST_NOISE = 0.02 * NOISE
UNSEEN = np.array([1.0, 1.0, 1e-6, 0.03, 0.03, 0.03, 0.05, 0.05, 0.05])
"""Standard deviation of a part of x₀ that was not measured [rad, m, m/s, rad/s], about zero or the
expected velocity."""
INDEPENDENT = 0.5
"""Time after which an error of the outputs is taken as another one [s]."""
TILT, ACCELERATION, CLOCK = np.deg2rad(0.5), 0.01, 0.1
"""Spread of a window's constant wrench: moments that tilt the vehicle so [rad], forces that
accelerate it so [m/s²]; and of its clock [s]."""
SAMPLES = 20_001
"""Samples by which Student's distribution is integrated."""
LEAST_LEFT = 1e-6
"""Smallest share of the information about a direction that is taken as left without a window."""
ITERATIONS, CONVERGED, LARGEST_STEP = 25, 0.01, 0.5
"""Most steps; step over the standard deviation at which it ends; and largest step over a
parameter's scale."""
STEADY, NEARLY = 15, 0.15
"""Number of steps after which it ends at such a step, since (1) leaves out how B changes: a nearly
undetermined parameter goes on to and fro by it."""
NOISES = 5
"""Number of times that the noise is estimated anew before a step."""
HALVINGS, WORSE = 4, 1.01
"""Most trials of a step, each half of the one before while it makes the cost larger by this factor;
not by less, since (1) leaves out how B changes."""


class Own(NamedTuple):
    """Mean and spread of the windows' own parameters."""

    mean: np.ndarray
    """(W, 16)."""
    spread: np.ndarray
    """Standard deviations (W, 16)."""
    seen: np.ndarray
    """Whether they move with θ (W, 16)."""


class Quadratic(NamedTuple):
    """H and g of each window, and its cost, at the parameters."""

    H: np.ndarray
    """(W, P, P)."""
    g: np.ndarray
    """(W, P)."""
    cost: np.ndarray
    """½ Σ r², with the own parameters eliminated (W,)."""
    step: np.ndarray
    """Step of the own parameters without one of the others (W, 16)."""
    gain: np.ndarray
    """Its derivative by a step of the others (W, 16, P)."""


@dataclass(frozen=True)
class Estimate:
    """Estimated parameters of windows."""

    theta: np.ndarray
    """Errors θ of the file (P,)."""
    own: np.ndarray
    """Own parameters of the windows (W, 16)."""
    noise: np.ndarray
    """Errors of x that are left (9,)."""
    quadratic: Quadratic
    """At the end."""
    prior: np.ndarray
    """Inverse variances of θ before any log (P,)."""

    def deviations(self, cluster: np.ndarray, which: np.ndarray | slice = slice(None)
                   ) -> tuple[np.ndarray, np.ndarray]:
        """Returns standard deviations by (2), and their degrees of freedom ν (P,).

        ν = (tr Ω)²/tr Ω² of parameter i, where Ω is the covariance of the clusters' parts aᵢᵀg_c of
        it, aᵢᵀ row i of A_c, were all errors independent: Ω_cd = v_cᵀ(δ_cd aᵢ − H⁻¹v_d) with
        v_c = H_c aᵢ. It is zero for a parameter that no cluster says anything about. The error of
        the prior is in neither.

        Args:
            cluster: Log or window that each window's errors are correlated in (W,), any numbers.
            which: The windows to take.
        """
        # Sums over the clusters, at the estimate of these windows alone.
        _, index = np.unique(cluster[which], return_inverse=True)
        member = np.eye(index.max() + 1)[index].T
        H = np.tensordot(member, self.quadratic.H[which], 1)
        g = member @ self.quadratic.g[which] - times(H, self.of(which) - self.theta)
        inverse = np.linalg.inv(self._information(which))
        L = np.linalg.cholesky(inverse)
        left, axes = np.linalg.eigh(np.eye(len(L)) - L.T @ H @ L)
        half = axes / np.sqrt(np.maximum(left, LEAST_LEFT))[:, None] @ axes.swapaxes(1, 2)
        A = L @ half @ L.T
        # Both traces without Ω itself (C, P).
        v = A @ H
        own, mixed = np.sum(v * A, axis=2), np.sum(v @ inverse * v, axis=2)
        joint = inverse @ np.einsum("cil,cim->ilm", v, v, optimize=True)
        square = np.sum(own**2 - 2.0 * own * mixed, axis=0) + np.einsum("ilm,iml->i", joint, joint)
        trace = np.sum(own - mixed, axis=0)
        freedom = np.divide(trace**2, square, out=np.zeros(len(L)), where=square > 0.0)
        return np.sqrt(np.sum(times(A, g)**2, axis=0)), freedom

    def of(self, which: np.ndarray | slice) -> np.ndarray:
        """Returns θ (P,) of some of the windows: one step from that of all."""
        step = np.linalg.solve(self._information(which), np.sum(self.quadratic.g[which], axis=0)
                               - self.prior * self.theta)
        return self.theta + step

    def known_by_prior(self) -> np.ndarray:
        """Returns the standard deviations of θ over those before any log (P,), at most 1."""
        return np.sqrt(np.diag(np.linalg.inv(self._information(slice(None)))) * self.prior)

    def _information(self, which: np.ndarray | slice) -> np.ndarray:
        return np.sum(self.quadratic.H[which], axis=0) + np.diag(self.prior)


def hydrostatics(windows: Windows, parameters: Sequence[Parameter]) -> np.ndarray:
    """Returns θ (P,) by the samples at rest: a linear least-squares fit of the static balance.

    Parameters without an effect at rest stay zero, as all do without a rest.
    """
    at = np.flatnonzero(windows.resting)
    theta = np.zeros(len(parameters))
    if len(at) == 0:
        return theta
    dynamics, g_B = windows.dynamics.at(at), gravity_in_body(windows.state[at])
    still = np.zeros((len(at), 6))
    Y = dynamics.regressor(still, still, g_B)
    left = windows.wrench[at] - dynamics.force(still[:, None], g_B[:, None])[:, 0]
    scale = np.array([each.scale for each in parameters])
    A = np.moveaxis(Y, 1, 2).reshape(-1, len(parameters)) * scale
    # One sample in a second counts, with errors as of a tilt; unseen parameters stay zero.
    size = TILT * _stiffness(windows) / np.sqrt(GRID)
    normal = A.T @ A + size**2 * np.eye(len(scale))
    theta = scale * np.linalg.solve(normal, A.T @ left.ravel())
    return theta


def _stiffness(windows: Windows) -> float:
    """Returns the moment over a small tilt [N m/rad], a mean of roll and pitch."""
    G = np.mean(windows.dynamics.composite.weight, axis=0)
    down = gravity_in_body(np.zeros(9))
    turned = np.column_stack([np.cross(down, axis) for axis in np.eye(3)[:2]])
    return float(np.mean(np.abs(np.diag(G[3:5] @ turned))))


def own_of(windows: Windows, noise: np.ndarray) -> Own:
    """Returns mean and spread of the windows' own parameters before they are simulated."""
    first = windows.state[windows.start]
    mean, known = np.zeros((len(first), OWN)), np.isfinite(first)
    mean[:, :len(STATE)] = windows.first_state()
    inertia = np.mean(windows.dynamics.composite.inertia, axis=0)
    force, moment = ACCELERATION * np.mean(np.diag(inertia)[:3]), TILT * _stiffness(windows)
    spread = np.tile(np.concatenate(
        [np.zeros(len(STATE)), np.repeat([force, moment], 3), [CLOCK]]), (len(first), 1))
    spread[:, :len(STATE)] = np.where(known, 3.0 * noise, UNSEEN)
    seen = np.concatenate([known, known[:, 3:6], np.ones((len(first), 4), dtype=bool)], axis=1)
    return Own(mean, spread, seen)


def products_of(windows: Windows, theta: np.ndarray, own: np.ndarray,
                progress: Progress = silent) -> np.ndarray:
    """Returns the sums over a window of all products of [A, B, r], by parts of x (W, 9, ·, ·).

    A, B and r are in units of x, and zero where nothing was measured.
    """
    moved, parts = windows.dynamics.with_parameters(theta), []
    blocks = np.array_split(np.arange(len(windows.start)), -(-len(windows.start) // 60))
    for i, block in enumerate(blocks):
        progress("simulation of windows", i / len(blocks))
        some = windows.of(block)
        motion, measured = simulated(moved, windows.wrench, some.start, INSTANTS, own[block]), (
            some.measured()[..., None])
        columns = np.where(np.isfinite(measured), np.concatenate(
            [motion.sensitivity, measured - motion.state[..., None]], axis=-1), 0.0).swapaxes(1, 2)
        parts.append(STEP * GRID / INDEPENDENT * columns.swapaxes(-1, -2) @ columns)
    return np.concatenate(parts)


def quadratic_of(products: np.ndarray, own: np.ndarray, about: Own, noise: np.ndarray
                 ) -> Quadratic:
    """Returns (1) of each window by its `products_of`."""
    N = np.tensordot(products, noise**-2.0, (1, 0))
    first, last = slice(None, -OWN - 1), slice(-OWN - 1, -1)
    weight, off = about.spread**-2.0, own - about.mean
    inner, cross = N[:, last, last] + np.eye(OWN) * weight[:, None], N[:, first, last]
    g_own = N[:, last, -1] - weight * off
    solved = np.linalg.solve(inner, np.concatenate(
        [g_own[..., None], cross.swapaxes(1, 2)], axis=-1))
    step, gain = solved[..., 0], -solved[..., 1:]
    return Quadratic(N[:, first, first] + cross @ gain, N[:, first, -1] - times(cross, step),
                     0.5 * (N[:, -1, -1] + np.sum(weight * off**2 - g_own * step, axis=1)),
                     step, gain)


def _noise(windows: Windows, products: np.ndarray, found: Quadratic) -> np.ndarray:
    """Returns the rms residuals of x (9,) that the own parameters leave."""
    weights = np.concatenate([-found.step, np.ones((len(found.step), 1))], axis=1)
    part = products[..., -OWN - 1:, -OWN - 1:]
    left = np.einsum("wi,wcij,wj->c", weights, part, weights) / (STEP * GRID / INDEPENDENT)
    count = np.sum(np.isfinite(windows.measured()), axis=(0, 1))
    return np.where(count, np.maximum(np.sqrt(left / np.maximum(count, 1)), LEAST_NOISE), NOISE)


def constrained_step(H: np.ndarray, g: np.ndarray, theta: np.ndarray,
                     parameters: Sequence[Parameter]) -> np.ndarray:
    """Returns the δ (P,) of min ½δᵀHδ − gᵀδ with θ + δ within the bounds, and δ not too large."""
    scale = np.array([each.scale for each in parameters])
    lower, upper = np.array([each.bounds for each in parameters]).T
    program = MathematicalProgram()
    z = program.NewContinuousVariables(len(theta))  # δ over its scale
    Q = H * np.outer(scale, scale)
    program.AddQuadraticCost(0.5 * (Q + Q.T), -g * scale, z, is_convex=True)
    program.AddBoundingBoxConstraint(
        np.maximum((lower - theta) / scale, -LARGEST_STEP),
        np.minimum((upper - theta) / scale, LARGEST_STEP), z)
    result = ClarabelSolver().Solve(program)
    if not result.is_success():
        raise RunFailed(f"identify: the least-squares program has no solution "
                        f"({result.get_solution_result().name})")
    return scale * result.GetSolution(z)


def estimated(windows: Windows, parameters: Sequence[Parameter], theta: np.ndarray,
              progress: Progress = silent, own: np.ndarray | None = None) -> Estimate:
    """Returns the parameters of windows, from θ (P,) on.

    Args:
        windows: The windows, with the effects of the parameters.
        parameters: The parameters.
        theta: Their errors at first (P,).
        progress: Receives the stages.
        own: Own parameters of the windows at first (W, 16); None: their means.

    Raises:
        RunFailed: It does not converge.
    """
    prior = np.array([each.scale for each in parameters]) ** -2.0
    about = own_of(windows, NOISE)
    own = about.mean if own is None else own
    products = products_of(windows, theta, own, part_of(
        progress, 0.0, 1.0 / (ITERATIONS + 1)))
    found = quadratic_of(products, own, about, NOISE)
    for iteration in range(ITERATIONS):
        for _ in range(NOISES):
            noise = _noise(windows, products, found)
            about = own_of(windows, noise)
            found = quadratic_of(products, own, about, noise)
        H, g = np.sum(found.H, axis=0) + np.diag(prior), np.sum(found.g, axis=0) - prior * theta
        step = constrained_step(H, g, theta, parameters)
        least = CONVERGED if iteration < STEADY else NEARLY
        if np.all(np.abs(step) < least * np.sqrt(np.diag(np.linalg.inv(H)))):
            return Estimate(theta, own, noise, found, prior)
        own_step = about.seen * (found.step + times(found.gain, step))
        total = np.sum(found.cost) + 0.5 * np.sum(prior * theta**2)
        for share in 0.5 ** np.arange(HALVINGS):
            new, new_own = theta + share * step, own + share * own_step
            moved = products_of(windows, new, new_own, part_of(
                progress, (iteration + 1) / (ITERATIONS + 1), (iteration + 2) / (ITERATIONS + 1)))
            there = quadratic_of(moved, new_own, about, noise)
            if np.sum(there.cost) + 0.5 * np.sum(prior * new**2) < WORSE * total:
                theta, own, products, found = new, new_own, moved, there
                break
    raise RunFailed(f"identify: no convergence after {ITERATIONS} steps")


def student(confidence: float, degrees: np.ndarray) -> np.ndarray:
    """Returns the t of ±t that a variable of Student's distribution is within, with `confidence`.

    With t = √ν tan φ its density is proportional to cos^(ν−1) φ, which is integrated.

    Args:
        confidence: The probability.
        degrees: Degrees of freedom ν, at least 1, of any shape.
    """
    phi = np.linspace(0.0, 0.5 * np.pi, SAMPLES)
    out = []
    for v in np.ravel(np.asarray(degrees, dtype=float)):
        density = np.cos(phi) ** (v - 1.0)
        within = np.concatenate([[0.0], np.cumsum(density[1:] + density[:-1])])
        out.append(np.sqrt(v) * np.tan(np.interp(confidence * within[-1], within, phi)))
    return np.reshape(out, np.shape(degrees))
