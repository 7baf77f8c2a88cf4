"""Tolerances: the largest value of each source of error, alone, with which a certificate holds.

The converse of a budget: one value is changed at a time, all others stay nominal, and the largest
value is found with which all conditions on the tube hold and every limit has a margin. Searches are
memoised (`tube.search.search_memo`), without terminal set, first plan and second searches: an
estimate, which `certify --set` confirms.

Parameters of the tube are changed directly: the bound of d, the force sensor, the walls. A worse
sensor comes with the allowance that the safe region needs for it (`contact.force_error`, `delay`).
Model errors and the motion of the water count by the d that they induce, see `unknown_margins`; the
settings with which `certify` covers the largest are printed. A source that no proof covers is named
as such.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from uvms_drake.actuation import IdealWrench, SampledCommand, Thrusters
from uvms_drake.certificate.certify import assumed_conditions, basis_of
from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.common.progress import Progress, silent
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.sensing import Navigation
from uvms_drake.station.contact.parameters import Parameter
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.studies.margins.margin import Margin, bracket, tube_of, worst_of
from uvms_drake.studies.margins.unknown_margins import Study, unknowns
from uvms_drake.tube.conditions import Condition, assumption
from uvms_drake.tube.search.search_memo import SearchMemo, memoising


def margins(scenario: Scenario, model: ContactModel, progress: Progress = silent) -> list[Margin]:
    """Returns the margins of a scenario with a certified tube; `model` is the controller's."""
    disturbance = scenario.disturbance
    bound = Parameter("d, disturbance", "m/s², rad/s²", disturbance.bound, lambda value: replace(
        scenario, disturbance=replace(disturbance, bound=value)), 0.01)
    values = [bound, *scenario.contact.parameters(scenario)]
    delays, unknown = _delays(scenario, model), unknowns()
    count, out = len(values) + len(delays) + len(unknown), list[Margin]()
    progress("tube", 0.0)
    searches = SearchMemo()
    failed = _worst_failed(bound, bound.today, searches)
    require(failed is None, "scenario", scenario.name, f"certified, but {failed}")
    for value in (*values, *delays):
        progress(value.name, len(out) / count)
        out.append(_margin(value, searches if value in values else SearchMemo()))
    study = Study(scenario, model)
    for source in unknown:
        progress(source.name, len(out) / count)
        out.append(source.margin(study))
    return out


def _worst_failed(value: Parameter, size: float, searches: SearchMemo) -> Condition | None:
    """Returns the most violated condition on the tube or a limit with a value, or None."""
    searches.again()
    try:
        scenario = value.at(size)
        model = load_model(scenario)
        conditions = assumed_conditions(scenario, model)
        if all(condition.holds for condition in conditions):
            with memoising(searches):
                conditions = tube_of(scenario, model, basis_of(scenario, model))[1]
    except InvalidParameter as error:
        return assumption(str(error), "", theorem="control/theory.md#closed-loop-guarantee")
    return worst_of(conditions)


def _margin(value: Parameter, searches: SearchMemo) -> Margin:
    """Returns the largest value, by doubling and then halving the ratio."""
    holds = value.today
    if holds == 0.0:  # Find a first positive value.
        failed = _worst_failed(value, value.start, searches)
        if failed is not None and failed.is_count:
            return Margin(value.name, value.unit, 0.0, math.nan, failed.name)
        if failed is not None:
            return Margin(value.name, value.unit, 0.0, 0.0, failed.name)
        holds = value.start
    largest_value, failed = bracket(
        lambda size: _worst_failed(value, size, searches), holds)
    return Margin(value.name, value.unit, value.today, value.tried(largest_value),
                  failed.name if failed else "")


def _delays(scenario: Scenario, model: ContactModel) -> list[Parameter]:
    """Returns the parameters of clocks, thrusters and navigation, ideal ones if missing."""
    def with_part(key: str, kind: type, **none: Any) -> Callable[..., Scenario]:
        """Returns the scenario as a function of the changed fields of its part of a kind."""
        parts = [part for part in getattr(scenario, key)  # Thrusters are in place of an ideal one.
                 if not (kind is Thrusters and isinstance(part, IdealWrench))]
        here = [i for i, part in enumerate(parts) if isinstance(part, kind)]
        at = here[0] if here else (0 if kind is SampledCommand else len(parts))
        part = parts[at] if here else kind(**none)
        rest = parts[at + 1:] if here else parts[at:]
        def changed_by(**changed: Any) -> Scenario:
            all_parts: Any = {key: [*parts[:at], replace(part, **changed), *rest]}
            return replace(scenario, **all_parts)

        return changed_by

    def today(key: str, kind: type, value: Callable[[Any], float]) -> float:
        return next((value(part) for part in getattr(scenario, key) if isinstance(part, kind)), 0.0)

    # Parts to vary, ideal ones where the scenario has none, and their nominal values.
    clock = with_part("actuation", SampledCommand, period=1e-3, delay=0.0)
    thrusters = with_part("actuation", Thrusters, period=1e-3, lag=1e-3, dead_time=0.0)
    navigation = with_part("sensing", Navigation)
    sampled = today("actuation", SampledCommand, lambda part: part.period)
    delays = today("actuation", SampledCommand, lambda part: part.delay)
    lag = today("actuation", Thrusters, lambda part: part.command_path(model).lag)
    dvl = today("sensing", Navigation, lambda part: float(np.max(part.dvl.noise)))
    step = scenario.mpc.time_step

    def with_ticks(period: float) -> float:
        """Returns the largest period that is not longer and has ticks at the knots of plans."""
        require(period <= step, "period", period, f"at most mpc.time_step, {step:g} s")
        return float(step / np.ceil(step / period - 1e-9))

    found = [Parameter("feedback, period", "s", sampled,
                    lambda value: clock(period=with_ticks(value)), tried=with_ticks),
             Parameter("feedback, delay", "s", delays, lambda value: clock(delay=value))]
    if model.thrusters is not None:
        found.append(Parameter("thrusters, lag", "s", lag, lambda value: thrusters(lag=value)))
    own = next((part.dvl for part in scenario.sensing if isinstance(part, Navigation)),
               Navigation().dvl)
    return [*found, Parameter(
        "navigation, noise of a velocity (σ)", "m/s", dvl, lambda value: navigation(
            dvl=replace(own, noise=np.full(3, value))), 1e-4)]


def format_margins(found: Sequence[Margin]) -> str:
    """Returns the margins as tables."""
    def number(value: float) -> str:
        return "none" if math.isnan(value) else f"{value:.3g}"

    lines = ["largest value of each alone, all others nominal, estimated",
             f"  {'':<38}{'nominal':>10}{'largest':>10}  {'unit':<14}then fails"]
    lines += [f"  {each.name:<38}{number(each.today):>10}{number(each.largest):>10}  "
              f"{each.unit:<14}{each.ends or 'nothing up to this'}"
              for each in found if not each.d]
    lines += ["", "model errors and motion of the water, each alone in place of the declared d, "
              "estimated", f"  {'':<38}{'largest':>10}  {'unit':<8}{'asked':>8}"
              f"{'makes ν₁':>10}{'ν₂':>8}{'joints':>8}  then fails"]
    for each in found:
        if each.d:
            blocks = (max(part) for part in (each.d[:3], each.d[3:6], each.d[6:] or (0.0,)))
            lines.append(
                f"  {each.name:<38}{number(each.largest):>10}  {each.unit:<8}{each.asked:>8.3g}"
                + "".join(f"{x:>{w}.2g}" for x, w in zip(blocks, (10, 8, 8), strict=True))
                + f"  {each.ends or 'nothing up to this'}")
    lines += ["", "settings with the largest"]
    lines += [f"  {each.name}\n    {each.settings}" for each in found if each.settings]
    return "\n".join(lines)
