"""Unmodelled dynamics of robot and water as a disturbance: its size, estimated.

For an acceleration ζ̇_c the law asks for τ = Mζ̇_c + b + Jᵀ𝔉, of the robot that it knows. Another
robot, whose joints stick, does M′ζ̇ + b′ + Jᵀ𝔉 = τ + τ_f, so that with ζ̇ = ζ̇_c + d

    d = M′⁻¹[(M − M′)ζ̇_c + b − b′ + τ_f].                                                    (1)

Axes that move with the water see still water, and gravity g − v̇_c. With ν_c = Rᵀv_c of a uniform
current or wave, ζ less ν_c is M(ζ̇ + ω × ν_c − Rᵀv̇_c) + b(𝔮, ζ − ν_c; g − v̇_c) + Jᵀ𝔉 = τ, and

    d = M⁻¹[b(𝔮, ζ; g) − b(𝔮, ζ − ν_c; g − v̇_c)] − ω × ν_c + Rᵀv̇_c.                          (2)

At a state each of them is d = c + As with any s in [−1, 1]ʲ: ζ̇_c in its box, friction of either
sign. A component's largest value over s is |cᵢ| + Σⱼ|Aᵢⱼ|; a norm's, which is convex, is
at a corner, and the step from s to sign(Aᵀ(c + As)) never makes it smaller. Over postures and
velocities of the declared set, as points of a box, the search is that of `joint_search`: an
estimate from below.
"""

import copy
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from uvms_drake.model.frames.spatial import cross, times
from uvms_drake.model.links import links_between
from uvms_drake.model.surface.contact_laws import dissipation_factor
from uvms_drake.model.uvms_model import Kinematics, UvmsModel
from uvms_drake.tube.search.constraint_set import BISECTIONS, ConstraintSet, pulled
from uvms_drake.tube.search.joint_search import Function

ASCENT = 3
"""Number of steps from corner to corner."""
DIRECTIONS = np.array([each for each in itertools.product((-1.0, 0.0, 1.0), repeat=3)
                       if any(each)]).T
"""Directions (3, 26) whose extreme corners an ascent of a vector starts from."""


@dataclass(frozen=True)
class Motions:
    """Stacks of motions."""

    config: np.ndarray
    """𝔮 (m, 6+n)."""
    zeta: np.ndarray
    """ζ (m, 6+n)."""
    heading: np.ndarray
    """Direction of the water's motion, from x of Σ_I about z (m,) [rad]."""
    phase: np.ndarray
    """Phase of a wave (m,) [rad]."""
    errors: np.ndarray
    """Errors of the robot over their sizes (m, k), at most 1."""
    kinematics: Kinematics
    """Kinematics at 𝔮."""


class MotionSet:
    """Motions of a declared set, as points of a box: (φ, θ, ψ, q), ζ, heading, phase, errors.

    Poses that are off in tip pitch or tool angle are moved towards one that is far from these
    limits, ζ is projected on its balls: every point is a motion of the set, and every motion of the
    set, but for its position, is a point.

    Args:
        model: The robot.
        declared: The set.
        errors: Smallest errors of the robot over their sizes (k,), which are at most 1.

    Attributes:
        model: The robot.
        declared: The set.
        box: Bounds of the points (11+2n+k,).
    """

    def __init__(self, model: UvmsModel, declared: ConstraintSet, errors: Sequence[float] = ()):
        self.model, self.declared = model, declared
        self._centre, (lower, upper) = declared.centre(model), declared.box
        free = np.concatenate([np.ones(model.size), [np.pi, np.pi]])
        self.box = (np.concatenate([lower, -free, errors]),
                    np.concatenate([upper, free, np.ones(len(errors))]))

    def at(self, points: np.ndarray) -> Motions:
        """Returns the motions of points (m, 11+2n+k)."""
        model, declared, pose = self.model, self.declared, self.model.size - 3
        config = np.zeros((len(points), model.size))
        config[:, 3:] = pulled(lambda x: declared.keeps_attitude(model, x), points[:, :pose],
                               self._centre, BISECTIONS)
        blocks = np.split(points[:, pose: pose + model.size], [3, 6], axis=1)
        zeta = np.concatenate([
            radius * block / np.maximum(np.linalg.norm(block, axis=1, keepdims=True), 1.0)
            for block, radius in zip(
                blocks, (declared.nu1, declared.nu2, declared.qdot), strict=True)], axis=1)
        heading, phase, *_ = points[:, pose + model.size:].T
        return Motions(config, zeta, heading, phase, points[:, pose + model.size + 2:],
                       model.kinematics(config))


Affine = tuple[np.ndarray, np.ndarray]
"""c (m, 6+n) and A (m, 6+n, j) of d = c + As."""
UnmodelledTerm = Callable[[Motions], Affine]
"""Unmodelled acceleration as a function of motions."""
Rate = Callable[[Motions], np.ndarray]
"""Bounds of |ζ̇₀| (m, 6+n) as a function of motions."""
Family = Callable[[Motions], UvmsModel]
"""Robot for each of the motions, by their errors."""


class ForceChange(NamedTuple):
    """Largest change of a sensed force since the mean of it that is read."""

    normal: float
    """ρ(T + h) + a + ⟨a − ρT⟩₊, of the size of the normal force [N]."""
    tangential: float
    """ρ′(T + h) + 2a′, of the rest [N]."""
    tool_angle: float
    """Largest angle between n and the tip's x-axis [rad]."""


NO_CHANGE = ForceChange(0.0, 0.0, 0.0)


def commanded_rate(model: UvmsModel, u_limit: np.ndarray, fixed: np.ndarray, *, force: float = 0.0,
                   damping: float = 0.0, missed: ForceChange = NO_CHANGE) -> Rate:
    """Returns the bound |ζ̇₀| ≤ min(ū + |f| + p, r̄ + 2p) + c, tube/theory.md#declared-unknowns.

    Args:
        model: The controller's.
        u_limit: Limits ū of |𝔲| (6+n,) [m/s², rad/s²].
        fixed: r̄ (6+n,), rate of a plan and of the feedback [m/s², rad/s²].
        force: Largest static ‖𝔉‖ of which |M⁻¹Jᵀ𝔉| is p [N]; zero if 𝔲 is within its limits without
            it.
        damping: Dissipation a of the surface, at which a tip of the speed v exerts ψ(av) as much
            [s/m].
        missed: Change of a sensed force that its reading misses, of which |M⁻¹J_Eᵀ(𝔉_s − 𝔉)| is c.
    """
    def rate(at: Motions) -> np.ndarray:
        b, M = _bias(model, at.kinematics, at.zeta), model.mass_matrix(at.kinematics)
        drift = np.linalg.solve(M, b[..., None])[..., 0]
        J = at.kinematics.J_links[:, -1, :3]
        gain = np.linalg.solve(M, J.swapaxes(-1, -2))
        size = np.linalg.norm(gain, axis=-1)
        speed = np.linalg.norm(times(J, at.zeta), axis=-1)
        pressed = (force * dissipation_factor(damping * speed))[:, None] * size
        # |G n| of the n nearest to the row of G, in the cone about the tip's x-axis.
        off = np.arccos(np.clip(np.abs(gain[..., 0]) / np.maximum(size, 1e-300), 0.0, 1.0))
        along = size * np.cos(np.maximum(off - missed.tool_angle, 0.0))
        return (np.minimum(u_limit + np.abs(drift) + pressed, fixed + 2.0 * pressed)
                + along * missed.normal + size * missed.tangential)

    return rate


def drift_change(motions: MotionSet, radii: np.ndarray
                 ) -> tuple[Function, tuple[np.ndarray, np.ndarray]]:
    """Returns |f(𝔮, ζ) − f(𝔮̄, ζ̄)| (m, 6+n) in free water as a function of points, and their box.

    Args:
        motions: Set of (𝔮, ζ).
        radii: Bounds of the joints, roll and pitch, and of ζ (2+n+6+n,), each component.
    """
    model, (lower, upper) = motions.model, motions.box
    n, points = model.num_joints, len(lower)

    def drift(at: Motions) -> np.ndarray:
        b = _bias(model, at.kinematics, at.zeta)
        return -np.linalg.solve(model.mass_matrix(at.kinematics), b[..., None])[..., 0]

    def values(pairs: np.ndarray) -> np.ndarray:
        at = motions.at(pairs[:, :points])
        config, off = at.config.copy(), pairs[:, points:] * radii
        config[:, 6:] += off[:, :n]
        config[:, 3:5] += off[:, n: n + 2]
        near = replace(at, config=config, zeta=at.zeta + off[:, n + 2:],
                       kinematics=model.kinematics(config))
        return np.abs(drift(at) - drift(near))

    one = np.ones(len(radii))
    return values, (np.append(lower, -one), np.append(upper, one))


def family(base: UvmsModel, ends: Sequence[UvmsModel]) -> Family:
    """Returns the robots between one and those with each error at its size, see `links_between`."""
    links = [end.links for end in ends]

    def robots(at: Motions) -> UvmsModel:
        out = copy.copy(base)
        out.links = links_between(base.links, links, at.errors[:, :len(links)])
        return out

    return robots if ends else lambda at: base


def by_robot(known: Family, true: Family, rate: Rate) -> UnmodelledTerm:
    """Returns (1) of a true robot that differs from the model."""
    def error(at: Motions) -> Affine:
        robots = known(at), true(at)
        M, M_true = (model.mass_matrix(at.kinematics) for model in robots)
        b, b_true = (_bias(model, at.kinematics, at.zeta) for model in robots)
        inverse = np.linalg.inv(M_true)
        return (times(inverse, b - b_true),
                inverse @ (M - M_true) * rate(at)[..., None, :])

    return error


def by_forces(robots: Family, forces: np.ndarray) -> UnmodelledTerm:
    """Returns M⁻¹τ_f of generalised forces of either sign, |τ_f| ≤ `forces` (6+n,)."""
    def error(at: Motions) -> Affine:
        M = robots(at).mass_matrix(at.kinematics)
        return np.zeros_like(at.zeta), np.linalg.inv(M) * forces

    return error


def by_water(robots: Family, current: tuple[float, float],
             wave: tuple[float, float] | None = None) -> UnmodelledTerm:
    """Returns (2) of a current with a wave, along one heading.

    Args:
        robots: The robot.
        current: Horizontal and vertical speed [m/s].
        wave: Its orbital speed [m/s] and ω [rad/s]; None: none.
    """
    def error(at: Motions) -> Affine:
        model = robots(at)
        e = np.stack([np.cos(at.heading), np.sin(at.heading), np.zeros_like(at.heading)], axis=1)
        e_z, (c, s) = np.array([0.0, 0.0, 1.0]), (
            f(at.phase)[:, None] for f in (np.cos, np.sin))
        R = at.kinematics.R_WB.swapaxes(-1, -2)
        velocity = current[0] * e + current[1] * e_z
        acceleration = np.zeros_like(velocity)
        if wave is not None:
            speed, frequency = wave
            velocity = velocity + speed * (c * e + s * e_z)
            acceleration = frequency * speed * (c * e_z - s * e)
        v = times(R, velocity)
        relative, none = at.zeta.copy(), np.zeros_like(at.zeta)
        relative[:, :3] -= v
        b = _bias(model, at.kinematics, at.zeta) - _bias(model, at.kinematics, relative)
        if wave is not None:
            # −τ of weight and buoyancy is linear in g.
            b += sum(_bias(_with_gravity(model, axis), at.kinematics, none) * a[:, None]
                     for axis, a in zip(np.eye(3), acceleration.T, strict=True))
        out = np.linalg.solve(model.mass_matrix(at.kinematics), b[..., None])[..., 0]
        out[:, :3] += times(R, acceleration) - cross(at.zeta[:, 3:6], v)
        return out, np.zeros((*out.shape, 1))

    return error


def tip_acceleration(model: UvmsModel, at: Motions, rate: np.ndarray, reach: float) -> np.ndarray:
    """Returns bounds of the acceleration of points about the tip (m,) [m/s²].

    The tip has Jζ̇ + J̇ζ, the largest of which over |ζ̇| ≤ `rate` is at a corner. A point fixed to it
    at a distance has no more than reach (‖α‖ + ‖ω‖²) in addition; with s = ‖ν₂‖ + Σ|q̇ⱼ| ≥ ‖ω‖, α is
    J_ωζ̇ but for s² at most.

    Args:
        model: The robot.
        at: Motions.
        rate: Bounds of |ζ̇| (m, 6+n).
        reach: Largest distance of the points from the tip [m].
    """
    J, J_angular = at.kinematics.J_chi[:, :3], at.kinematics.J_links[:, -1, 3:]
    bias = times(model.task_jacobian_rate(at.kinematics, at.zeta)[:, :3], at.zeta)
    spin = np.linalg.norm(at.zeta[:, 3:6], axis=1) + np.sum(np.abs(at.zeta[:, 6:]), axis=1)
    tip, turning = (_largest_norm(c, A, np.sign(A.swapaxes(1, 2) @ DIRECTIONS)) for c, A in (
        (bias, J * rate[:, None]), (np.zeros_like(bias), J_angular * rate[:, None])))
    return tip + reach * (turning + 2.0 * spin**2)


def _bias(model: UvmsModel, kinematics: Kinematics, zeta: np.ndarray) -> np.ndarray:
    """Returns b (m, 6+n), without contact."""
    return model.inverse_dynamics(kinematics, zeta, np.zeros_like(zeta),
                                  np.zeros((*zeta.shape[:-1], 6)))


def _with_gravity(model: UvmsModel, gravity: np.ndarray) -> UvmsModel:
    """Returns the robot under another gravity (3,)."""
    out = copy.copy(model)
    out.gravity = gravity
    return out


def sizes_of(errors: Sequence[UnmodelledTerm], motions: MotionSet,
             weights: np.ndarray | float = 1.0) -> Function:
    """Returns the larger |dᵢ| and ‖Ŵ⁻¹d‖₂ (m, 6+n+1) of several errors as a function of points.

    Args:
        errors: Model errors, such as one of both signs.
        motions: The set.
        weights: Diagonal of Ŵ (6+n,), or 1.
    """
    def values(points: np.ndarray) -> np.ndarray:
        at = motions.at(points)
        out: np.ndarray = np.max([sizes(error(at), weights) for error in errors], axis=0)
        return out

    return values


def sizes(affine: Affine, weights: np.ndarray | float) -> np.ndarray:
    """Returns the largest |dᵢ| and ‖Ŵ⁻¹d‖₂ over s (m, 6+n+1); the last by ascent."""
    c, A = affine
    each = np.abs(c) + np.sum(np.abs(A), axis=2)
    w = np.broadcast_to(1.0 / np.asarray(weights), c.shape[1:])
    c, A = c * w, A * w[:, None]
    sign = np.where(c < 0.0, -1.0, 1.0)
    s = np.sign(A.swapaxes(1, 2) * sign[:, None])  # (m, j, 6+n), a corner for each component
    return np.column_stack([each, _largest_norm(c, A, s)])


def _largest_norm(c: np.ndarray, A: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Returns the largest ‖c + As‖₂ (m,) by ascent from corners s (m, j, starts)."""
    for _ in range(ASCENT):
        s = np.sign(A.swapaxes(1, 2) @ (c[..., None] + A @ s))
    norm: np.ndarray = np.max(np.linalg.norm(c[..., None] + A @ s, axis=1), axis=1)
    return norm
