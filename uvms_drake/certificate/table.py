"""The certificate as a table that a reviewer can follow."""

import math

import numpy as np

from uvms_drake.certificate.assumptions import scope_of
from uvms_drake.certificate.certificate import Certificate
from uvms_drake.control.limits import HoldRadii
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.constants import QUANTITIES, Constant
from uvms_drake.tube.contact.tip_motion import JERK
from uvms_drake.tube.law_tube import WEIGHTED
from uvms_drake.tube.ultimate_bounds import HOLD, LIKELY

INPUTS = ("a smaller disturbance.bound, larger gains, a wider limit or a smaller "
          "limits.static_force, up to which the tube is taken")
HELP = {
    "contact.force_error": "a larger contact.force_error or contact.delay, or a better sensor",
    "contact.clearance": "a larger contact.clearance, or a shorter tare",
    "contact.speed": "a shorter mpc.time_step, or slower limits",
    "safe region": "a softer tool (contact.stiffness), larger gains or a larger "
        "contact.force",
    "task.force": "a smaller force, a softer tool (contact.stiffness) or larger gains",
    "hold": "larger gains, a softer tool (contact.stiffness) or less contact.dissipation",
    "mission": "less force or speed of that step, a larger contact.force or speed_across, or "
        "larger gains",
    "limits.contact_speed": "a larger contact.speed, contact.speed_across or larger gains, "
        "or less contact.dissipation, contact.force_rate and contact.force_ripple",
    "limits.u": INPUTS,
    "limits.tau": INPUTS,
    "tightening": "a smaller disturbance.bound, larger gains or a wider limit",
    "estimates": "a larger certificate.safety_factor, or more tube_samples",
    "σ": "slower speed limits or a larger ancillary.sigma",
    "law": "a law whose tube is known, resolved or tip first",
    "surface": "that method, see `Surface`",
    "mpc.terms": "the task's cost alone",
    "mpc.initial_state": "initial_state: nominal",
    "mpc.terminal_weight": "terminal_weight: null, so that P is computed",
    "mpc.terminal_set": "terminal_set: true",
    "current": "still water, an ideal wrench without a clock, or --uncertified",
    "waves": "still water, an ideal wrench without a clock, or --uncertified",
    "model_error": "leaving it out",
    "declared unknowns": "smaller unknowns",
    "surface_error": "leaving it out: it acts as a disturbance that d̃ does not count",
    "faults": "no faults but those of the solver",
    "sensing": "leaving it out",
    "actuation": "leaving it out",
    "actuation path": "a clock and then thrusters, or leaving it out",
    "vehicle loop": "smaller ancillary.vehicle gains or less lag",
    "tip loop": "smaller ancillary.tip gains or a faster clock",
    "terminal set": "wider limits, a task further inside them or other mpc weights",
    "left by the tube": "a wider limit, a smaller disturbance.bound or larger gains",
    "first plan between knots": "a shorter mpc.time_step with a longer mpc.horizon, or wider "
        "limits of angles and static force",
    "first plan": "a start further inside the limits",
    "limit without tightening": "a method tube_takes of that limit, or going without it",
    "first plan to the terminal set": "a longer horizon or a closer start",
}
"""Advice on a failed condition by its `topic`, or by its `kind` if its topic has none. A paper adds
its topics."""

UNITS = {
    "e": "m, rad", "position": "m", "orientation": "rad", "joints": "rad", "z": "m/s, rad/s",
    "nu1": "m/s", "nu2": "rad/s", "qdot": "rad/s", "tip_speed": "m/s",
    "depth": "m", "depth_speed": "m/s", "between_knots": "m", "joints_between": "rad",
    "attitude_between": "rad", "tool_between": "rad", "roll": "rad", "pitch": "rad",
    "u": "m/s², rad/s²", "tau": "N, N m", "force": "N"}
"""Units of radii and ultimate bounds; metres and radians mixed. A paper adds those of its radii."""
PLAIN = {weighted: name for name, weighted in WEIGHTED.items()}
"""Constants of J_x by those of J_xŴ, which have the same unit."""


def format_certificate(certificate: Certificate) -> str:
    """Returns the certificate as text."""
    return "\n".join([
        f"{certificate.scenario}: law {certificate.law}, "
        f"{_gains(certificate)}",
        "", "constants", *(_constant_row(item) for item in certificate.constants),
        "", "conditions", *(_condition_row(item) for item in certificate.conditions),
        "", "tube", *_tube_rows(certificate),
        *_unknown_rows(certificate),
        *_budget_rows(certificate),
        *_estimate_rows(certificate),
        "", *_terminal_rows(certificate),
        *_bound_rows(certificate),
        *_leg_rows(certificate),
        *_assumption_rows(certificate),
        "", *scope(certificate), verdict(certificate)])


def scope(certificate: Certificate) -> list[str]:
    """Returns the first lines of the verdict: actuation, sensing and surface that it is about."""
    return [f"{'for' if certificate.certified else 'asked for'} {about}: {statement}"
            for about, statement in scope_of(certificate.assumptions).items()]


def _assumption_rows(certificate: Certificate) -> list[str]:
    return ["", "assumptions, not computed, and who guarantees them", *(
        f"  {item.about:<12}{item.statement} [{item.guaranteed_by}]"
        for item in certificate.assumptions)] if certificate.assumptions else []


def _gains(certificate: Certificate) -> str:
    gains = (("k", certificate.k), ("σ", certificate.sigma))
    known = "".join(f"{name} = {gain:g} 1/s, " for name, gain in gains if math.isfinite(gain))
    if certificate.weights is None:
        return f"{known}d̃ = {certificate.d_bound:g} m/s², rad/s²"
    axes = ", ".join(f"{axis:.3g}" for axis in certificate.d_bound * certificate.weights)
    return f"{known}‖W⁻¹d‖ ≤ 1, W = {axes} m/s², rad/s²"


def verdict(certificate: Certificate) -> str:
    """Returns one line: certified, or not, with the first failed condition and advice."""
    failed = certificate.failed
    if failed is None:
        return f"certified: all {len(certificate.conditions)} conditions hold{_proven(certificate)}"
    return f"not certified: {violation(failed)}{help_for(failed)}"


def _proven(certificate: Certificate) -> str:
    """Returns the number of proven values, and the largest ratio of the second search."""
    if not certificate.tightening:
        return ""
    estimated = certificate.tightening - certificate.proven
    ratio = max((estimate.ratio for estimate in certificate.estimates), default=None)
    again = "" if ratio is None or not estimated else (
        f" (a second search found up to {ratio:.0%} of the claims)")
    given = certificate.proven and any(
        estimate.name == JERK for estimate in certificate.estimates)
    return (f"; of the {certificate.tightening} numbers that tighten limits "
            f"{certificate.proven} are proven{f', given the {JERK}' if given else ''}, "
            f"{estimated} estimated{again}")


def violation(condition: Condition) -> str:
    """Returns a condition that does not hold, and by how much."""
    if condition.is_count:
        return condition.name
    by = f" by {-condition.margin:.4g}" if math.isfinite(condition.margin) else ""
    return f"{condition}{by}"


def help_for(condition: Condition) -> str:
    """Returns the advice on a condition that does not hold; empty if there is none."""
    known = HELP.get(condition.topic, HELP.get(condition.kind, ""))
    if condition.obstacle:
        return f"; not with this vehicle, because {condition.obstacle}; or {known}"
    found = [text for text in (condition.advice, known) if text]
    return f"; what would help: {', or '.join(found)}" if found else ""


def _constant_row(constant: Constant) -> str:
    states = "samples" if constant.how == "estimated" else "boxes"
    unit = QUANTITIES[PLAIN.get(constant.name, constant.name)].unit
    return (f"  {constant.name:<20}{constant.value:>12.4g} {unit:<5} "
            f"{constant.how}, {constant.samples} {states}, worst seen {constant.sampled_value:.4g}")


def _condition_row(condition: Condition) -> str:
    mark = "holds" if condition.holds else "DOES NOT HOLD"
    if condition.is_count:
        return f"  {condition!s:<76}  {mark}"
    return (f"  {condition.name:<52}{condition.left:>11.4g} {condition.relation:<2}"
            f"{condition.right:>11.4g}  {mark}")


def _leg_rows(certificate: Certificate) -> list[str]:
    """Returns a row for each step of a mission."""
    if not certificate.legs:
        return []
    rows = ["", "mission: largest force along n, error bounds with the plan at its target, in "
            "motion and in a hold",
            f"  {'step':<14}{'force, N':>12}{'error, N':>10}{'hold, N':>10}{'s, least':>10}"
            f"{'most':>8}"]
    for i, leg in enumerate(certificate.legs):
        band, hold = ("-" if each is None else f"{each:.3g}" for each in (leg.band, leg.hold_band))
        rows.append(f"  {i:>3} {leg.kind:<10}{leg.force:>12.4g}{band:>10}{hold:>10}"
                    f"{leg.least:>10.3g}{leg.most:>8.3g}"
                    f"{'  not certified: ' + leg.unmet if leg.unmet else ''}")
    return rows


def _tube_rows(certificate: Certificate) -> list[str]:
    if certificate.tube is None:
        return ["  none"]
    radii = {name: value for name, value in vars(certificate.tube).items()
             if not isinstance(value, HoldRadii | None) and np.size(value)}
    return [*(f"  {name:<20}{_radius(value)} {UNITS[name]}" for name, value in radii.items()),
            *_hold_rows(certificate.tube.hold)]


def _hold_rows(hold: HoldRadii | None) -> list[str]:
    """Returns the radii in a hold."""
    if hold is None:
        return []
    return [f"in a hold, from {hold.time:.2g} s on with the tip of the plan below "
            f"{1e3 * hold.standing:g} mm/s",
            f"  {'depth':<20}{hold.depth:>12.4g} m", f"  {'position':<20}{hold.position:>12.4g} m",
            f"  {'advance':<20}{hold.advance:>12.4g} m/s",
            f"  {'error of a reading':<20}{hold.reading:>12.4g} N, along the direction"]


def _radius(value: float | np.ndarray) -> str:
    if isinstance(value, float):
        return f"{value:>12.4g}"
    return "  " + ", ".join(f"{x:.3g}" for x in value)


def _budget_rows(certificate: Certificate) -> list[str]:
    """Returns the share of each source in the radii, a row each, their sums and the limits."""
    if not certificate.budget:
        return []
    budget, margin = certificate.budget, certificate.margin
    sources = list(next(iter(budget.values())))

    def row(name: str, values: list[str]) -> str:
        return f"  {name:<30}" + "".join(f"{value:>12}" for value in values)

    return ["", "budget: share of each source in the tube [mm, mrad, mm/s]",
            row("", list(budget)),
            *(row(source, [f"{1e3 * parts[source]:.4g}" for parts in budget.values()])
              for source in sources),
            row("sum", [f"{1e3 * sum(parts.values()):.4g}" for parts in budget.values()]),
            *([row("limits leave", [f"{1e3 * margin[name]:.4g}" if name in margin else "-"
                                    for name in budget])] if margin else [])]


def _unknown_rows(certificate: Certificate) -> list[str]:
    """Returns the accelerations by the declared unknowns, a row each."""
    if not certificate.unknowns:
        return []
    width = max(len(each.name) for each in certificate.unknowns) + 2
    return ["", "declared unknowns: part of disturbance.bound that each takes, and its largest "
            "component of surge, sway, heave, roll, pitch, yaw, joints [m/s², rad/s²]",
            *(f"  {each.name:<{width}}{each.takes:>10.4g}   " + ", ".join(
                f"{value:.3g}" for value in each.each) for each in certificate.unknowns),
            f"  {'sum':<{width}}{sum(each.takes for each in certificate.unknowns):>10.4g}"]


def _estimate_rows(certificate: Certificate) -> list[str]:
    """Returns the estimates, by the ratio that the second search reached."""
    estimates = sorted(certificate.estimates, key=lambda estimate: -estimate.ratio)
    return ["", "estimates: claimed value, and the part of it that a second search found", *(
        f"  {estimate.name:<36}{estimate.claim:>12.4g}{estimate.ratio:>8.0%}"
        for estimate in estimates)] if estimates else []


def _terminal_rows(certificate: Certificate) -> list[str]:
    terminal = certificate.terminal
    if terminal is None:
        return []
    return [f"terminal set  ‖ξ‖_P ≤ {terminal.radius:.4g}, checked at {terminal.samples} states; "
            f"limited by: {terminal.limiting}"]


def _bound_rows(certificate: Certificate) -> list[str]:
    hold = None if certificate.tube is None else certificate.tube.hold
    rows = [f"ultimate bound of the {name:<12}{value:>11.4g} {UNITS[name]}"
            for name, value in certificate.bounds.items() if name in UNITS]
    if hold is None or HOLD not in certificate.bounds:
        return rows
    likely = certificate.bounds[LIKELY]
    return [*rows[:-1], f"{rows[-1]}, at touch and in motion, the plan at its target",
            f"{'':<34}{certificate.bounds[HOLD]:>11.4g} N, in a hold, from {hold.time:.2g} s after "
            "the plan stands",
            f"{'':<34}{likely:>11.4g} N, likely in a hold, if noise is independent; "
            "not certified"]
