"""All errata, with the robot's own numbers where a robot is needed."""

from collections.abc import Callable
from functools import partial

from uvms_drake.common.progress import Progress, silent
from uvms_drake.papers.nikou2018.errata import cost, lemma, simulation
from uvms_drake.papers.nikou2018.errata.erratum import Erratum
from uvms_drake.papers.nikou2018.errata.paper import robot_constants


def all_errata(progress: Progress = silent) -> list[Erratum]:
    """Returns E1, E2, ..., in order; it takes some seconds."""
    progress("constants", 0.0)
    constants, J = robot_constants()
    sigma = 2.0 * constants.L_c / constants.J_min  # σ̲ = L_𝔠: twice the least.
    checks: tuple[Callable[[], Erratum], ...] = (
        lemma.acceleration_input,
        lemma.law_shapes,
        partial(lemma.lost_terms, constants, J, sigma),
        partial(lemma.velocity_tube, J, sigma),
        lemma.self_motion,
        cost.hold_input,
        cost.terminal_penalty,
        simulation.simulation_numbers,
        simulation.initial_state,
        simulation.initial_configuration,
        simulation.first_horizon,
        partial(lemma.invariant_sets, J),
        lemma.terminal_shapes,
        lemma.configuration_set,
    )
    found = []
    for i, check in enumerate(checks):
        progress(f"E{i + 1}", (i + 1) / (len(checks) + 1))
        found.append(check())
    return found
