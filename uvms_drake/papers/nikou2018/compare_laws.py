"""Comparison of two laws: certified radius, radius reached by an adversary, radius of the paper.

The loop starts at the task, in contact, under an adversarial disturbance with ‖Ŵ⁻¹d‖ = d̃: along
the leading direction of J_x, along J_xᵀ𝔢_y, or constant. Certified is ‖y − ȳ‖ for `resolved` and
‖χ − χ̄‖ for `transpose`. The radius of the paper's Lemma, d̃/min(α₁, α₂), is at least d̃/σ̲ with
σ̲ = σJ̲ − L_𝔠 for any k.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder

from uvms_drake.certificate.certify import basis_of
from uvms_drake.common.errors import require
from uvms_drake.common.progress import Progress, silent
from uvms_drake.control.feedback.tube_monitor import TubeMonitor, TubeReport
from uvms_drake.control.laws.law import FIELDS, AncillaryLaw
from uvms_drake.control.laws.resolved import Resolved
from uvms_drake.control.tube_mpc import make_tube_mpc
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.papers.nikou2018.constants import TRANSPOSE, lemma_constants
from uvms_drake.papers.nikou2018.transpose import Transpose
from uvms_drake.papers.nikou2018.transpose_tube import transpose_task_radius
from uvms_drake.plant.adversary import AdversarialDisturbance, Adversary, Kind
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state
from uvms_drake.station.motions.motion import Motion
from uvms_drake.station.motions.motions import motion_of
from uvms_drake.station.problem import make_dynamic_ocp
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.step_bounds import step_of
from uvms_drake.tube.laws.resolved import resolved_task_radius

LAWS: tuple[AncillaryLaw, ...] = (
    Resolved(k=10.0, sigma=2.0), Resolved(k=10.0, sigma=5.0), Resolved(k=20.0, sigma=5.0),
    Resolved(k=40.0, sigma=5.0), Transpose(k=20.0, sigma=1.0), Transpose(k=40.0, sigma=5.0))
TASK_RADII: dict[type[AncillaryLaw], Callable[..., float]] = {
    Resolved: resolved_task_radius, Transpose: transpose_task_radius}
"""Functions from a law and a `Basis` to the radius [m, rad] of the error that the law feeds back,
without a search; by the law's exact type."""
ATTACKS: tuple[Kind, ...] = ("leading", "along_task_error", "constant")
DURATION = 3.0
"""Duration of each attack [s]: six time constants of the slowest tube."""
HORIZON = 5
"""Horizon of the MPC, short to save time: the plan is constant."""
STEPS_PER_TIME_CONSTANT = 2.0
"""Smallest number of integration steps in 1/k."""


@dataclass(frozen=True)
class LawRow:
    """Radii of a law with its gains."""

    law: AncillaryLaw
    """The law and its gains."""
    certified: float
    """Certified radius [m, rad]; inf if there is none."""
    observed: float
    """Largest deviation that an adversary reached [m, rad]."""
    paper: float
    """Lower bound d̃/σ̲ of the paper's radius [m, rad]; inf if σ̲ ≤ 0."""


def compare_laws(scenario: Scenario, model: ContactModel, laws: Iterable[AncillaryLaw] = LAWS,
                 progress: Progress = silent) -> list[LawRow]:
    """Returns a row for every law, with the controller's model and the scenario's limits and d̃."""
    motion = motion_of(scenario)
    check_laws(motion)
    d, laws = scenario.disturbance.d_bound, tuple(laws)
    weights = motion.weights(scenario.disturbance, model.size)
    needed = {name for law in laws if type(law) in TASK_RADII
              for name in motion.tubes[type(law)].constants(law, weights)}
    basis = basis_of(scenario, model, tuple(sorted({*TRANSPOSE, *needed})))
    lemma = lemma_constants(basis.constants)
    rows: list[LawRow] = []
    for law in laws:
        progress(law.name, len(rows) / len(laws))
        radius = TASK_RADII.get(type(law))
        certified = math.inf if radius is None else radius(law, basis)
        margin = law.sigma * lemma.J_min - lemma.L_c
        rows.append(LawRow(
            law, certified,
            max(worst_deviation(scenario, model, law, attack) for attack in ATTACKS),
            d / margin if margin > 0.0 else math.inf))
    return rows


def check_laws(motion: Motion) -> None:
    """Raises `InvalidParameter` unless forces move the robot."""
    require(motion.has_forces, "motion", motion.name, "dynamic, for --compare-laws")


def worst_deviation(scenario: Scenario, model: ContactModel, law: AncillaryLaw, attack: Kind
                    ) -> float:
    """Returns the largest deviation that one adversary reaches in `DURATION`."""
    # Plant and controller.
    declared = scenario.disturbance
    ocp = make_dynamic_ocp(
        replace(scenario, mpc=replace(scenario.mpc, horizon=HORIZON)), model)
    builder = DiagramBuilder()
    uvms = builder.AddNamedSystem("uvms", make_uvms_plant(
        scenario.model, surface=scenario.surface, disturbance=None))
    controller = builder.AddNamedSystem("tube_mpc", make_tube_mpc(ocp, law))
    state = uvms.GetOutputPort("state")
    # Only a bound of 1 is set, so that the worst ratio is the worst deviation itself.
    monitor = TubeMonitor.AddToBuilder(
        builder, model, law, declared.d_bound, {"task": 1.0}, state=state, period=0.0,
        weights=declared.relative_weights(model.size),
        nominal_state=controller.GetOutputPort("nominal_state"),
        pair=controller.GetOutputPort("pair"))
    # The adversary aims with the monitor's errors.
    adversary = Adversary.AddToBuilder(
        builder, model,
        AdversarialDisturbance(declared.bound, attack, weights=declared.weights), state=state,
        e_y=monitor.GetOutputPort("e_y"), r=monitor.GetOutputPort("r"))
    builder.Connect(adversary.get_output_port(), uvms.GetInputPort("disturbance"))
    builder.Connect(state, controller.GetInputPort("state"))
    builder.Connect(controller.GetOutputPort("tau"), uvms.GetInputPort("tau"))
    # From rest at the task, with fixed steps that resolve the gain k.
    simulator = Simulator(builder.Build())
    step = min(step_of(scenario), 1.0 / (STEPS_PER_TIME_CONSTANT * law.k))
    ResetIntegratorFromFlags(simulator, "runge_kutta3", step)
    simulator.get_mutable_integrator().set_fixed_step_mode(True)
    context = simulator.get_mutable_context()
    config = model.configuration(ocp.y_des)
    set_state(uvms, uvms.GetMyMutableContextFromRoot(context),
              np.concatenate([config, np.zeros_like(config)]))
    simulator.AdvanceTo(DURATION)
    now = monitor.GetMyContextFromRoot(context)
    ratios = monitor.GetOutputPort("ratio").Eval(now)
    report = TubeReport(monitor.GetOutputPort("report").Eval(now))
    return float(max(ratios[FIELDS.index("task")], report.worst_set_task))


def format_laws(rows: list[LawRow]) -> str:
    """Returns the rows as a table."""
    def radius(value: float) -> str:
        return f"{1e3 * value:.2f}" if math.isfinite(value) else "none"

    head = (f"{'law':<12}{'k [1/s]':>9}{'σ [1/s]':>9}{'certified':>12}{'observed':>11}"
            f"{'paper, any k':>15}   [mm, mrad]")
    return "\n".join([head, *(
        f"{row.law.name:<12}{row.law.k:>9g}{row.law.sigma:>9g}"
        f"{radius(row.certified):>12}{radius(row.observed):>11}{radius(row.paper):>15}"
        for row in rows)])
