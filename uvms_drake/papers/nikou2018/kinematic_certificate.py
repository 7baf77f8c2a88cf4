"""The paper's theorem for its simulation: tube, tightened limits, terminal set, first plan.

The radii of 𝔢 are in closed form, `attitude_radii` proves the vehicle's attitude, the speeds under
`resolved` are searched for. Theorem: papers/nikou2018/theory.md#kinematic-tubes.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from uvms_drake.certificate.certify import declared_set
from uvms_drake.common.progress import Progress, silent
from uvms_drake.control.limits import TubeRadii
from uvms_drake.control.ocp.ocp import FEASIBLE
from uvms_drake.control.plan.plan import advance
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.spatial import times
from uvms_drake.papers.nikou2018 import kinematics
from uvms_drake.papers.nikou2018.transpose import Transpose, undetermined_joints
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.conditions import Condition, assumption
from uvms_drake.tube.constants import checked_constants, estimate_constants
from uvms_drake.tube.estimates import CertificateSettings, checked
from uvms_drake.tube.row_gains import attitude_radii
from uvms_drake.tube.search.ascent import first_order
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.search_problem import SearchProblem
from uvms_drake.tube.search.second_search import claimed

THEOREM = "papers/nikou2018/theory.md#kinematic-tubes"
GUARANTEE = "control/theory.md#closed-loop-guarantee"
TIGHTENING = "control/theory.md#constraint-tightening"
TERMINAL = "control/theory.md#terminal-set"
FEASIBILITY = "control/theory.md#recursive-feasibility"
"""Theorems of the conditions."""
PATIENCE, LEADERS = 10, 12
"""Effort of the search for the largest velocities: the vehicle has to turn far for them."""
SHELLS = (1.0, 0.7, 0.4, 0.1)
"""‖ξ‖_P/ε of the states at which the terminal set is checked; below, the linearisation holds."""


@dataclass(frozen=True)
class KinematicCertificate:
    """Conditions of a scenario, its tube and its terminal set."""

    scenario: str
    conditions: list[Condition]
    radii: dict[str, Any]
    """Radii of the tube by the names of `TubeRadii`."""
    terminal_radius: float
    """Radius ε of the terminal set; zero if it is not known."""

    @property
    def certified(self) -> bool:
        """Whether every condition was computed and holds."""
        return all(condition.holds for condition in self.conditions)

    def applied_to(self, scenario: Scenario) -> Scenario:
        """Returns the scenario with this tube and terminal set."""
        return replace(scenario, tube=TubeRadii(**self.radii), mpc=replace(
            scenario.mpc, terminal_radius=self.terminal_radius or scenario.mpc.terminal_radius))

    @property
    def text(self) -> str:
        """Verdict and conditions."""
        failed = [each for each in self.conditions if not each.holds]
        verdict = (f"certified: all {len(self.conditions)} conditions hold" if self.certified else
                   f"NOT certified: {len(failed)} of {len(self.conditions)} conditions fail")
        radii = ", ".join(f"{name} {value:.4g}" for name, value in self.radii.items())
        return "\n".join([f"{self.scenario}: {verdict}", f"tube: {radii}",
                          *(f"  {each}" for each in self.conditions)])


def certify(scenario: Scenario, progress: Progress = silent) -> KinematicCertificate:
    """Returns the certificate of a scenario, certified or not; it ends at the first failure."""
    # Assumptions of the proofs that a scenario can give up.
    progress("tube", 0.0)
    model, y_des, bounds = kinematics.posed(scenario)
    mpc, settings, n = scenario.mpc, scenario.certificate, model.num_joints
    free = int(np.count_nonzero(np.asarray(mpc.weight_y)[6:] == 0.0))
    conditions = [assumption(key, reason, broken, theorem=GUARANTEE) for key, reason, broken in (
        ("mpc.initial_state", "plans start at the measured state", mpc.initial_state != "nominal"),
        ("mpc.terminal_weight", "P without a terminal controller", mpc.terminal_weight is not None),
        ("mpc.terminal_set", "none", not mpc.terminal_set),
        ("joints of weight zero", "which no terminal set covers", free))]
    # Tube, and the rest of the limits.
    declared = declared_set(scenario.limits, model)
    law, w_bound = scenario.ancillary, scenario.disturbance.d_bound
    found = (of_transpose(law, model, declared, w_bound, settings)
             if isinstance(law, Transpose) else
             of_resolved(law.sigma, model, declared, w_bound, settings))
    radii: dict[str, Any] = dict(zip(
        ("e", "joints", "z", "nu1", "nu2", "qdot"), found.radii, strict=True))
    radii["roll"], radii["pitch"] = attitude_radii(
        declared, model.R_WT, radii["e"], radii["joints"], n)
    margins = [*bounds.speeds, *(0.5 * (bounds.upper - bounds.lower))]
    conditions += [*found.conditions, *(
        Condition(f"tube in limits.{name}", taken, "<", margin, theorem=TIGHTENING,
                  kind="tightening", topic=f"limits.{name}", about=name)
        for name, taken, margin in zip(
            bounds.names(), bounds.taken(TubeRadii(**radii)), margins, strict=True))]
    draft = KinematicCertificate(scenario.name, conditions, radii, 0.0)
    if not draft.certified:
        return draft
    # Second search, terminal set and first plan.
    conditions += checked(found.second())
    progress("terminal set", 0.9)
    problem = kinematics.KinematicMpc(model, mpc, y_des, bounds.tightened(TubeRadii(**radii)))
    epsilon, worst, limiting = terminal_set(problem, settings.terminal_samples, settings.seed)
    conditions += [
        Condition("terminal set, ε", epsilon, ">", 0.0, theorem=TERMINAL, topic="terminal set"),
        Condition(f"terminal set, worst margin ({limiting})", worst, ">=", 0.0, theorem=TERMINAL,
                  topic="terminal set")]
    draft = replace(draft, terminal_radius=epsilon)
    if draft.certified:
        progress("first plan", 0.95)
        problem.terminal = replace(problem.terminal, radius=epsilon)
        plan = problem.solve(problem.resting(scenario.start.config), kinematics.FIRST_ITERATIONS)
        value, between = problem.value(plan), between_knots(problem, plan)
        conditions += [
            Condition(f"first plan, {what}", size, "<=", allowed, theorem=FEASIBILITY,
                      topic="first plan")
            for what, size, allowed in (
                ("violation of a limit", value.violation, FEASIBLE),
                ("violation between its knots [rad]", between, FEASIBLE),
                ("distance to the terminal set", value.slack, 1e-6))]
    return draft


# Tubes --------------------------------------------------------------------------------------------


class FoundTube(NamedTuple):
    """Tube of a law, without the vehicle's attitude."""

    radii: tuple[float, float, float, float, float, float]
    """Radii of 𝔢, the joints, all velocities, ν₁, ν₂ and q̇."""
    conditions: tuple[Condition, ...]
    second: Any
    """Function that returns the estimates, each with the result of a second search."""


class KinematicTubes(NamedTuple):
    """Radii of 𝔢 under χ̇ = J(𝔮)ζ + w, ‖w‖₂ ≤ w̃."""

    printed: float
    """Radius w̃/(σJ̲ + L_𝔠) of the paper."""
    corrected: float
    """Radius w̃/(σJ̲ − L_𝔠); inf if the condition fails."""
    condition: Condition
    """Condition σJ̲ > L_𝔠 of the law `transpose`; `resolved`, with w̃/σ, needs none."""


def kinematic_tubes(J_min: float, L_c: float, sigma: float, w_bound: float) -> KinematicTubes:
    """Returns the tubes of the law `transpose`; proof: papers/nikou2018/theory.md#kinematic-tubes.

    Args:
        J_min: J̲, smallest eigenvalue of J Jᵀ.
        L_c: L_𝔠, see `LemmaConstants`.
        sigma: σ.
        w_bound: w̃; of w̃ sin(t) in six components it is √6 times the amplitude.
    """
    condition = Condition("σJ̲, above L_c", sigma * J_min, ">", L_c, theorem=THEOREM, topic="σ")
    return KinematicTubes(
        w_bound / (sigma * J_min + L_c),
        w_bound / (sigma * J_min - L_c) if condition.holds else math.inf, condition)


def of_transpose(law: Transpose, model: ContactModel, declared: ConstraintSet, w_bound: float,
                 settings: CertificateSettings) -> FoundTube:
    """Returns the tube of ζ = ζ̄ − σJ(𝔮̄)ᵀ𝔢, ‖ζ − ζ̄‖ ≤ σJ̄E; χ has to determine the joints."""
    names = ("Jx_inv_max", "Jx_max", "L_c") if law.joints else ("J_inv_max", "J_max", "L_c_chi")
    constants = estimate_constants(
        model, declared, names, samples=settings.constant_samples,
        safety_factor=settings.safety_factor, seed=settings.seed)
    inverse, J_max, L_c = (constants[name].value for name in names)
    found = kinematic_tubes(inverse**-2, L_c, law.sigma, w_bound)
    e, z = found.corrected, law.sigma * J_max * found.corrected
    joints = e if law.joints or model.num_joints == 0 else np.inf
    return FoundTube((e, joints, z, z, z, z), (found.condition, undetermined_joints(law, model)),
                     lambda: checked_constants(model, declared, tuple(constants.values()),
                                               settings.seed))


def of_resolved(sigma: float, model: ContactModel, declared: ConstraintSet, w_bound: float,
                settings: CertificateSettings) -> FoundTube:
    """Returns the tube of ζ = J_x(𝔮)⁻¹[J_x(𝔮̄)ζ̄ − σ𝔢_y]: w̃/σ, and the joints as planned."""
    e = w_bound / sigma
    if e >= declared.tip_pitch:
        return FoundTube((e, 0.0, np.inf, np.inf, np.inf, 0.0), (), tuple)
    nominal = replace(declared, tip_pitch=declared.tip_pitch - e)
    problem = VelocityProblem(model, nominal, [(np.eye(2 * model.size)[:, :6], e)], sigma)
    x = problem.draw(settings.tube_samples, np.random.default_rng(settings.seed))
    nu, check = claimed(problem, ("ν₁", "ν₂"), x, first_order(problem, x), settings.safety_factor,
                        settings.seed, PATIENCE, LEADERS)
    return FoundTube((e, 0.0, float(np.hypot(*nu)), float(nu[0]), float(nu[1]), 0.0), (), check)


@dataclass(frozen=True)
class VelocityProblem(SearchProblem):
    """ν − ν̄ under `resolved`, as a function of nominal motions and of 𝔢.

    With J = [J_v J_a] of vehicle and arm, ζ = (ν, q̇) and 𝔮 = 𝔮(ȳ + (𝔢, 0)), q̇ = q̄̇ and

        ν − ν̄ = J_v(𝔮)⁻¹[J(𝔮̄)ζ̄ − J_a(𝔮)q̄̇ − σ𝔢] − ν̄.
    """

    sigma: float

    @property
    def channels(self) -> list[slice]:
        """Channels of ν₁ and ν₂."""
        return list(kinematics.BLOCKS[:2])

    def values(self, x: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Returns ν − ν̄ (..., 6) of motions (..., 3(6+n)) and errors 𝔢."""
        pose, zeta, _ = np.split(x, 3, axis=-1)
        config, e = self.config(pose), error[..., :6]
        y = self.model.task_pose(config) + np.zeros_like(e[..., :1])
        y[..., :6] += e
        J = self.model.kinematics(self.model.configuration(y)).J_chi
        rate = times(self.model.kinematics(config).J_chi, zeta) - self.sigma * e
        rate = rate - times(J[..., 6:], zeta[..., 6:])
        return np.linalg.solve(J[..., :6], rate[..., None])[..., 0] - zeta[..., :6]


# Terminal set and first plan ----------------------------------------------------------------------


def terminal_set(mpc: kinematics.KinematicMpc, samples: int, seed: int) -> tuple[float, float, str]:
    """Returns the largest ε that passes, its worst margin, and the name of that condition.

    The largest aᵀξ where ‖ξ‖_P ≤ ε is ε‖a‖_{P⁻¹}, of ‖Aξ‖ it is ε√λ_max(AP⁻¹Aᵀ). Decrease and the
    vehicle's angles are checked at random states on shells; ε is halved until they pass.
    """
    P, gain, bounds, size = mpc.terminal.P, mpc.terminal.gain, mpc.bounds, len(mpc.y_des)
    inverse, rng = np.linalg.inv(P), np.random.default_rng(seed)
    at_task = kinematics.limited_angles(mpc.model.configuration(mpc.y_des), mpc.y_des)
    free = np.minimum(bounds.upper - at_task, at_task - bounds.lower)
    eye = np.eye(size)
    linear = {name: (left, eye[[i]]) for name, left, i in zip(
        bounds.names()[5:], free[2:], [4, *range(6, size)], strict=True)} | {
        name: (left, gain[block]) for name, left, block in zip(
            bounds.names(), bounds.speeds, kinematics.BLOCKS, strict=False)}
    largest = {name: left / math.sqrt(np.linalg.eigvalsh(A @ inverse @ A.T)[-1])
               for name, (left, A) in linear.items()}
    name = min(largest, key=lambda each: largest[each])
    states = rng.normal(size=(samples, size)) @ np.linalg.inv(np.linalg.cholesky(P))
    states /= np.sqrt(np.sum(states @ P * states, axis=1, keepdims=True))
    states = np.concatenate([shell * states for shell in SHELLS])
    epsilon = largest[name]
    while epsilon > 1e-3 * largest[name]:
        decrease, angle = (float(np.min(each)) for each in _margins(mpc, epsilon * states, free))
        if min(decrease, angle) >= 0.0:
            margins = {name: 1.0 - epsilon / largest[name], "decrease": decrease, "attitude": angle}
            limiting = min(margins, key=lambda each: margins[each])
            return epsilon, margins[limiting], limiting
        epsilon *= 0.5
    return 0.0, min(decrease, angle), "decrease" if decrease < angle else "attitude"


def _margins(mpc: kinematics.KinematicMpc, xi: np.ndarray, free: np.ndarray
             ) -> Iterator[np.ndarray]:
    """Yields (V − V⁺)/ℓ − 1 of a step from ξ (m, 6+n), and the rest of the vehicle's angles."""
    zeta, h = xi @ mpc.terminal.gain.T, mpc.mpc.time_step
    config = mpc.model.configuration(mpc.y_des + xi)
    after = mpc.errors(advance(config, zeta, np.zeros_like(zeta), h))
    V, V_after, Q, R = (np.sum(x @ W * x, axis=1) for x, W in (
        (xi, mpc.terminal.P), (after, mpc.terminal.P), (xi, mpc.Q), (zeta, mpc.R)))
    yield (V - V_after) / (h * (Q + R)) - 1.0
    yield 1.0 - np.abs(config[:, 3:5]) / mpc.bounds.upper[:2]


def between_knots(mpc: kinematics.KinematicMpc, plan: kinematics.Plan, points: int = 9) -> float:
    """Returns the largest excess of a plan's angles over their limits between its knots [rad]."""
    inside = np.linspace(0.0, mpc.mpc.time_step, points + 2)[1:-1, None, None]
    zeta = np.broadcast_to(plan.zeta, (points, *plan.zeta.shape))
    config = advance(plan.config[None, :-1], zeta, np.zeros_like(zeta), inside)
    angles = kinematics.limited_angles(config, mpc.y_des + mpc.errors(config))
    return float(np.max(np.maximum(angles - mpc.bounds.upper, mpc.bounds.lower - angles),
                        initial=0.0))
