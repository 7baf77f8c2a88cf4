"""Errata of the paper, computed: one function for each."""

from collections.abc import Callable

from uvms_drake.common.progress import Progress, silent
from uvms_drake.papers.nikou2018.errata import proof, simulation
from uvms_drake.papers.nikou2018.errata.paper import (
    Erratum,
    errata_markdown,
    errata_table,
    robot_constants,
)

__all__ = ["Erratum", "all_errata", "errata_markdown", "errata_table"]


def all_errata(progress: Progress = silent) -> list[Erratum]:
    """Returns E1, E2, ..., in order; it takes some seconds."""
    progress("constants", 0.0)
    constants, J = robot_constants()
    sigma = 2.0 * constants.L_c / constants.J_min  # σ̲ = L_𝔠: twice the least.
    checks: tuple[Callable[[], Erratum], ...] = (
        proof.acceleration_input, proof.law_shapes, lambda: proof.lost_terms(constants, J, sigma),
        lambda: proof.velocity_tube(J, sigma), proof.self_motion, simulation.hold_input,
        simulation.terminal_penalty, simulation.simulation_numbers, simulation.initial_state,
        simulation.initial_configuration, simulation.first_horizon,
        lambda: proof.invariant_sets(J), proof.terminal_shapes, proof.configuration_set)
    found = []
    for i, check in enumerate(checks):
        progress(f"E{i + 1}", (i + 1) / (len(checks) + 1))
        found.append(check())
    return found
