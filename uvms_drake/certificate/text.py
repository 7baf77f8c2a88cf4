"""Certificates in words: verdict, advice, the most important numbers, and all as a table."""

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from uvms_drake.certificate.arrival import Arrival
from uvms_drake.certificate.assumptions import scope_of
from uvms_drake.certificate.claims import Claims
from uvms_drake.certificate.in_probability import (
    FAILURES,
    ProbabilityCertificate,
    percent_above,
    spent,
)
from uvms_drake.control.limits import HoldRadii, TubeRadii
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.constants import QUANTITIES, Constant
from uvms_drake.tube.contact.tip_motion import JERK
from uvms_drake.tube.law_tube import WEIGHTED
from uvms_drake.tube.ultimate_bounds import HOLD, LIKELY

INPUTS = ("a smaller disturbance.bound, larger gains, a wider limit or a smaller "
          "limits.static_force (contact.force, where it is sensed), up to which the tube is taken")
DRAWN = "certify --runs N, for no proof of the worst case covers it"
HELP = {
    "contact.force_error": "a larger contact.force_error or contact.delay, or a better sensor",
    "class of the wall": "a contact that declares this surface, or --uncertified",
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
    "no power": "a smaller certificate.safety_factor, or more tube_samples",
    "σ": "slower speed limits or a larger ancillary.sigma",
    "law": "a law whose tube is known, resolved or tip first",
    "surface": "that method, see `Surface`",
    "mpc.terms": "the task's cost alone",
    "mpc.initial_state": "initial_state: nominal",
    "mpc.terminal_weight": "terminal_weight: null, so that P is computed",
    "mpc.terminal_set": "terminal_set: true",
    "current": "still water or an ideal wrench without a clock, or else certify --runs N",
    "waves": "still water or an ideal wrench without a clock, or else certify --runs N",
    "model_error": "leaving it out",
    "declared unknowns": "smaller unknowns",
    "surface_error": "leaving it out: it acts as a disturbance that d̃ does not count",
    "faults": "no faults but those of the solver",
    "sensing": DRAWN,
    "actuation": DRAWN,
    "actuation path": DRAWN,
    "supervisor": "slower limits, less contact.dissipation or contact.delay, faults of the solver "
        "that end, or supervisor: null",
    "terminal set": "wider limits, a task further inside them or other mpc weights",
    "left by the tube": "a wider limit, a smaller disturbance.bound or larger gains",
    "first plan between knots": "a shorter mpc.time_step with a longer mpc.horizon, or wider "
        "limits of angles and static force",
    "first plan": "a start further inside the limits",
    "limit without tightening": "a method tube_takes of that limit, or going without it",
    "arrival": "a longer duration, or more of contact.speed left by the tube",
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
"""Units of radii and ultimate bounds; metres and radians mixed."""
PLAIN = {weighted: name for name, weighted in WEIGHTED.items()}
"""Constants of J_x by those of J_xŴ, which have the same unit."""
NAMED, USES = 12, 6
"""Largest numbers of failed runs, and of rows of the tube, that are named."""


# Verdict and advice -------------------------------------------------------------------------------


def verdict(claims: Claims) -> str:
    """Returns one line: certified, or not, with the first failed condition and advice."""
    if claims.failed is None:
        return f"certified: all {len(claims.conditions)} conditions hold{_proven(claims)}"
    advice = help_for(claims.failed)
    return f"not certified: {violation(claims.failed)}" + (f"; {advice}" if advice else "")


def scope(claims: Claims) -> list[str]:
    """Returns the first lines of the verdict: actuation, sensing and surface that it is about."""
    return [f"{'for' if claims.certified else 'asked for'} {about}: {statement}"
            for about, statement in scope_of(claims.assumptions).items()]


def violation(condition: Condition) -> str:
    """Returns a condition that does not hold, and by how much."""
    if condition.is_count:
        return condition.name
    by = f" by {-condition.margin:.4g}" if -math.inf < condition.margin < 0.0 else ""
    return f"{condition}{by}"


def help_for(condition: Condition) -> str:
    """Returns the advice on a condition that does not hold; empty if there is none."""
    known = HELP.get(condition.topic, HELP.get(condition.kind, ""))
    found = [text for text in (condition.advice, known) if text]
    return f"what would help: {', or '.join(found)}" if found else ""


def _proven(claims: Claims) -> str:
    """Returns the number of proven values, and the extreme ratios of the second search."""
    numbers = claims.tightening
    if not numbers:
        return ""
    proven = sum(each.proven for each in numbers)
    jerk = any(each.name == JERK for each in claims.estimates)
    given = f", given the estimated {JERK}" if proven and jerk else ""
    ratios = [each.ratio for each in claims.estimates]
    again = (f" (of each, a second search reached {min(ratios):.0%} to {max(ratios):.0%})"
             if ratios and proven < len(numbers) else "")
    return (f"; of the {len(numbers)} numbers that tighten limits {proven} are proven{given}, "
            f"{len(numbers) - proven} estimated{again}")


# In short -----------------------------------------------------------------------------------------


def format_overview(claims: Claims, scenario: Scenario, computed: str = "") -> str:
    """Returns the verdict, its scope, its numbers in short, and failed conditions with advice.

    Args:
        claims: Those of a certificate of the scenario.
        scenario: The scenario, which has the limit of the force and the desired one.
        computed: Time of the computation, or "before, from the cache"; empty: not printed.
    """
    rows = list(_numbers(claims, scenario)) if claims.certified else []
    if computed:
        rows.append(("computed", computed))
    failures = [line for each in claims.conditions if not each.holds for line in (
        f"  {violation(each)}", *([f"    {help_for(each)}"] if help_for(each) else []))]
    return "\n".join([
        f"{claims.scenario}: {verdict(claims)}", *scope(claims),
        *_section("", [f"{name:<18}{text}" for name, text in rows]),
        *_section("does not hold", failures)])


def largest_force(claims: Claims, scenario: Scenario) -> str:
    """Returns the largest static force in motion and in a hold in words; empty if none is claimed.

    That of a mission is the largest of its steps.
    """
    limit, bounds = scenario.contact.force_limit(scenario.limits), claims.bounds
    desired = float(np.linalg.norm(np.asarray(scenario.task.force, dtype=float)[:3]))
    error = bounds.get(HOLD, bounds.get("force"))
    bands = [(leg.force, band) for leg in claims.legs
             if (band := leg.band if leg.hold_band is None else leg.hold_band) is not None]
    if bands:
        desired, error = max(bands, key=sum)
    if error is None:
        return ""
    motion = "not limited" if limit is None else f"{limit:.4g} N"
    where = "in a hold of" if bands or HOLD in bounds else "with the plan at its target,"
    return (f"{motion} in motion, {desired + error:.4g} N {where} "
            f"{desired:.4g} ± {error:.3g} N; static, without impact and damping")


def _approach(arrival: Arrival, duration: float) -> str:
    """Returns speed and times of the nominal closed loop in words."""
    hold = ("no hold is in force" if math.isinf(arrival.hold) else
            f"a hold is in force {arrival.hold - arrival.touch:.2g} s after the touch")
    return (f"at up to {1e3 * arrival.speed:.3g} mm/s, touch at {arrival.touch:.3g} s and target "
            f"at {arrival.target:.3g} s of {duration:g} s; {hold}; on the scenario's own surface, "
            "without disturbance")


def tightest_limit(claims: Claims) -> Condition | None:
    """Returns the condition of the limit of which the tube takes the largest part."""
    limits = [each for each in claims.conditions if each.kind == "tightening" and each.right > 0.0]
    return max(limits, key=lambda each: each.left / each.right, default=None)


def _numbers(claims: Claims, scenario: Scenario) -> Iterator[tuple[str, str]]:
    """Yields names and values: force, end-effector, approach and tightest limit."""
    bounds = claims.bounds
    if text := largest_force(claims, scenario):
        yield "largest force", text
    if HOLD in claims.bounds and claims.hold_condition:
        yield "in a hold", claims.hold_condition
    if "position" in bounds:
        yield ("end-effector", f"within {1e3 * bounds['position']:.3g} mm and "
               f"{1e3 * bounds['orientation']:.3g} mrad of the plan")
    if claims.arrival is not None:
        yield "approach", _approach(claims.arrival, scenario.duration)
    if tightest := tightest_limit(claims):
        yield ("tightest limit", f"{tightest.about}: of its {tightest.right:.3g} the tube takes "
               f"{tightest.left:.3g} ({100.0 * tightest.left / tightest.right:.3g} %), "
               f"the plan has {tightest.margin:.3g}")


# Everything ---------------------------------------------------------------------------------------


def format_certificate(claims: Claims) -> str:
    """Returns the certificate as a table that a reviewer can follow."""
    return "\n".join([
        f"{claims.scenario}: law {claims.law}, {_gains(claims)}",
        *_section("constants", map(_constant_row, claims.constants)),
        *_section("conditions", map(_condition_row, claims.conditions)),
        *_section("tube", ["  none"] if claims.tube is None else _tube_rows(claims.tube)),
        *_section("declared unknowns: part of disturbance.bound that each takes, and its largest "
                  "component of surge, sway, heave, roll, pitch, yaw, joints [m/s², rad/s²]",
                  _unknown_rows(claims)),
        *_section("budget: share of each source in the tube [mm, mrad, mm/s]",
                  _budget_rows(claims)),
        *_section("estimates: claimed value, and the part of it that a second search found", (
            f"  {each.name:<36}{each.claim:>12.4g}{each.ratio:>8.0%}" for each in sorted(
                claims.estimates, key=lambda each: -each.ratio))),
        *_section("", _bound_rows(claims)),
        *_section("mission: largest force along n, error bounds with the plan at its target, in "
                  "motion and in a hold", _leg_rows(claims)),
        *_section("assumptions, not computed, and who guarantees them", (
            f"  {item.about:<12}{item.statement} [{item.guaranteed_by}]"
            for item in claims.assumptions)),
        "", *scope(claims), verdict(claims)])


def _section(title: str, rows: Iterable[str]) -> list[str]:
    """Returns rows below a title, if there is one; nothing without rows."""
    rows = list(rows)
    return ["", *([title] if title else []), *rows] if rows else []


def _gains(claims: Claims) -> str:
    """Returns the gains of the law and the bound of the disturbance."""
    known = "".join(f"{name} = {gain:g} 1/s, " for name, gain in (
        ("k", claims.k), ("σ", claims.sigma)) if math.isfinite(gain))
    if claims.weights is None:
        return f"{known}d̃ = {claims.d_bound:g} m/s², rad/s²"
    axes = ", ".join(f"{axis:.3g}" for axis in claims.d_bound * claims.weights)
    return f"{known}‖W⁻¹d‖ ≤ 1, W = {axes} m/s², rad/s²"


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


def _tube_rows(tube: TubeRadii) -> list[str]:
    """Returns the radii, and those in a hold."""
    rows = [f"  {name:<20}{_radius(value)} {UNITS[name]}" for name, value in vars(tube).items()
            if not isinstance(value, HoldRadii | None) and np.size(value)]
    if (hold := tube.hold) is None:
        return rows
    return [*rows, "in a hold",
            f"  {'depth':<20}{hold.depth:>12.4g} m", f"  {'position':<20}{hold.position:>12.4g} m",
            f"  {'advance':<20}{hold.advance:>12.4g} m/s",
            f"  {'error of a reading':<20}{hold.reading:>12.4g} N, along the direction",
            f"  {'age of the target':<20}{hold.since:>12.4g} s, mean of its readings"]


def _radius(value: float | np.ndarray) -> str:
    if isinstance(value, float):
        return f"{value:>12.4g}"
    return "  " + ", ".join(f"{x:.3g}" for x in value)


def _unknown_rows(claims: Claims) -> list[str]:
    """Returns the accelerations by the declared unknowns, a row each, and their sum."""
    if not claims.unknowns:
        return []
    width = max(len(each.name) for each in claims.unknowns) + 2
    return [*(f"  {each.name:<{width}}{each.takes:>10.4g}   " + ", ".join(
                f"{value:.3g}" for value in each.each) for each in claims.unknowns),
            f"  {'sum':<{width}}{sum(each.takes for each in claims.unknowns):>10.4g}"]


def _budget_rows(claims: Claims) -> list[str]:
    """Returns the share of each source in the radii, a row each, their sums and the limits."""
    budget, margin = claims.budget, claims.margin
    if not budget:
        return []
    rows: dict[str, list[float | None]] = {
        source: [parts[source] for parts in budget.values()]
        for source in next(iter(budget.values()))}
    rows["sum"] = [sum(parts.values()) for parts in budget.values()]
    if margin:
        rows["limits leave"] = [margin.get(name) for name in budget]
    return [f"  {'':<30}" + "".join(f"{name:>12}" for name in budget), *(
        f"  {name:<30}" + "".join(
            f"{'-' if each is None else f'{1e3 * each:.4g}':>12}" for each in values)
        for name, values in rows.items())]


def _bound_rows(claims: Claims) -> list[str]:
    """Returns terminal set and ultimate bounds."""
    terminal, bounds = claims.terminal, claims.bounds
    hold = None if claims.tube is None else claims.tube.hold
    rows = [] if terminal is None else [
        f"terminal set  ‖ξ‖_P ≤ {terminal.radius:.4g}, checked at {terminal.samples} states; "
        f"limited by: {terminal.limiting}"]
    rows += [f"ultimate bound of the {name:<12}{value:>11.4g} {UNITS[name]}"
             for name, value in bounds.items() if name in UNITS]
    if hold is None or HOLD not in bounds:
        return rows
    return [*rows[:-1], f"{rows[-1]}, at touch and in motion, the plan at its target",
            f"{'':<34}{bounds[HOLD]:>11.4g} N, in a hold: {claims.hold_condition}",
            f"{'':<34}{bounds[LIKELY]:>11.4g} N, likely in a hold, if noise is independent; "
            "not certified"]


def _leg_rows(claims: Claims) -> list[str]:
    """Returns a row for each step of a mission, below their head."""
    rows = [f"  {'step':<14}{'force, N':>12}{'error, N':>10}{'hold, N':>10}{'s, least':>10}"
            f"{'most':>8}"] if claims.legs else []
    for i, leg in enumerate(claims.legs):
        band, hold = ("-" if each is None else f"{each:.3g}" for each in (leg.band, leg.hold_band))
        rows.append(f"  {i:>3} {leg.kind:<10}{leg.force:>12.4g}{band:>10}{hold:>10}"
                    f"{leg.least:>10.3g}{leg.most:>8.3g}"
                    f"{'  not certified: ' + leg.unmet if leg.unmet else ''}")
    return rows


# In probability -----------------------------------------------------------------------------------


def format_probability(certificate: ProbabilityCertificate, seconds: float | None = None, *,
                       full: bool = True) -> str:
    """Returns the verdict, and runs, failures by kind, bound and time as a table.

    Args:
        certificate: The certificate.
        seconds: Median time of a run on one core [s]; None if it is not printed.
        full: Whether uses, draws, sentences and declared distribution follow.
    """
    runs, level = certificate.runs, spent(certificate.confidence, certificate.attempt)
    rows = {
        "runs": _count(certificate),
        "attempt": f"{certificate.attempt} at: {certificate.attempts[-1].task}",
        "bound": f"{percent_above(certificate.probability)} per run, at {100.0 * level:.5g} % "
                 "confidence for this attempt",
        "time": "" if seconds is None else
                f"{seconds:.3g} s a run in the median, by the clock, {runs * seconds:.3g} s in all",
        **(_details(certificate) if full else {})}
    return "\n".join([
        f"{certificate.scenario}: {certificate.verdict}", "",
        *(f"{name:<14}{text}" for name, text in rows.items() if text),
        *(["", *sentences(certificate), *_section(
            "declared distribution", (f"  {line}" for line in certificate.distribution))]
          if full else [])])


def _details(certificate: ProbabilityCertificate) -> dict[str, str]:
    """Returns largest uses, force, and the shares accepted."""
    runs, draws, force = certificate.runs, certificate.draws, certificate.force
    most, watched = (", ".join(
        f"{name} {use:.2f}" for name, use in sorted(found.items(), key=lambda row: -row[1])[:USES])
        for found in (certificate.use, certificate.supervisor))
    return {
        "tube used": most or "not watched",
        "supervisor": f"largest over its threshold: {watched}" if watched else "",
        "force": "" if force["off_line"] is None else
                 f"{force['least']:.3g} to {force['largest']:.3g} N desired; at the end of a hold "
                 f"off by at most {force['off_line']:.2f} of the force line",
        "draws": ", ".join(f"{runs} of {number} {name} accepted ({100.0 * runs / number:.3g} %)"
                           for name, number in draws.items() if number),
        "its own run": f"never drawn: {'; '.join(certificate.never_drawn)}"
                       if certificate.never_drawn else "accepted by the test of the draws"}


def sentences(certificate: ProbabilityCertificate) -> list[str]:
    """Returns the statement, its scope, and the definition of a failure."""
    p, inputs = percent_above(certificate.probability), certificate.inputs[:12]
    chance = f"{100.0 * (1.0 - certificate.confidence):.3g} %"
    counted = [text for kind, text in FAILURES.items() if kind != "mission" or certificate.mission]
    return [
        f"Of the declared distribution of {certificate.scenario} ({inputs}, frozen before), a run "
        f"of this simulation fails with a probability of at most {p}, unless an event of "
        f"probability {chance} or less over all attempts in the ledger happened.",
        "It is a statement about drawn runs of this simulation, none about the worst of them, and "
        "none about a robot that differs from its declared distribution. The radii of the tube "
        "carry no guarantee of their own.",
        f"A run counts as failed if it {_listed(counted, 'or')}. The tube is watched from the end "
        "of the hover on, all else from the start."]


def _count(certificate: ProbabilityCertificate) -> str:
    """Returns the number of failures by kind, and the failed runs."""
    if certificate.failures == 0:
        return f"0 of {certificate.runs} failed"
    failed = certificate.failed
    named = ", ".join(map(str, failed[:NAMED])) + (", ..." if len(failed) > NAMED else "")
    kinds = [f"{count} {FAILURES[kind]}" for kind, count in certificate.kinds.items() if count]
    return (f"{certificate.failures} of {certificate.runs} failed ({named}): "
            f"{_listed(kinds, 'and')}")


def _listed(parts: Sequence[str], last: str) -> str:
    *before, end = parts
    return f"{', '.join(before)} {last} {end}" if before else end
