"""Tube and gains of a real loop from pilot runs; the certificate in probability is of other runs.

Each row of the tube has the largest deviation M of K pilot runs, from the end of the hover on, and
the largest radius L that its limits leave. Its radius is

    r = max(m M, min(3 M, s L)),    m = 2,  s = 0.3,                                             (1)

so that a row far from its limits has more. It begins with r = 0.3 L, all of them × 0.7 until
there is a first plan, and runs again with (1) until M ≤ (1/m + 0.15) r or, after `ROUNDS` rounds,
M ≤ r. If (1) leaves no plan, m is bisected; below 1.5 there is none.

The gains are of one scale β: with T the mean delay from a command to the wrench of the vehicle, or
from a reading of a joint to its torque,

    σ = 1.5 β/T,    k = 2σ,    λ = 0.6σ of the observer.                                         (2)

A pilot run with 1.5 times the delays of clock and thrusters is made for each of `SCALES`; taken is
that with the smallest 1.5 M/L of its largest row, of those of at most 1/1.5 of the first that
fails. Nothing of this is a guarantee: the runs of a certificate are drawn from another seed.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from uvms_drake.actuation import SampledCommand, Thrusters
from uvms_drake.campaign.campaign import Campaign, make_campaign
from uvms_drake.campaign.drawn_contact import check_forces, force_to_admit
from uvms_drake.campaign.draws import first_feasible
from uvms_drake.campaign.failures import failures_of
from uvms_drake.campaign.harness import runs
from uvms_drake.campaign.pool import Pool, local_pool
from uvms_drake.campaign.run import run_one
from uvms_drake.certificate.attempts import task_of
from uvms_drake.certificate.in_probability import FAILURES
from uvms_drake.common.cache import cache_dir
from uvms_drake.common.errors import InvalidParameter, RunFailed, require
from uvms_drake.common.progress import Progress, part_of, silent
from uvms_drake.control.laws.tip_first import BlockGains, TipFirst
from uvms_drake.control.limits import TubeRadii
from uvms_drake.control.limits.inputs import input_names
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.uvms_model import read_uvms
from uvms_drake.report.tube_use import check_log, radii_of
from uvms_drake.sensing.navigation import Navigation
from uvms_drake.setup.first_scenario import strength_of
from uvms_drake.setup.holding import coordinate, unit_of
from uvms_drake.station.contact.bounds import (
    largest_force,
    largest_margin,
    largest_reading_error,
    pressing_force,
    sensed_contact,
)
from uvms_drake.station.contact.tube_in_contact import force_bounds
from uvms_drake.station.problem import check_inputs, limits_of, make_ocp
from uvms_drake.station.scenario.parts import command_path_of
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.station.step_size import with_step
from uvms_drake.tube.terminal_set import largest_radius

MULTIPLE, LEAST_MULTIPLE, FILLED, SHARE = 2.0, 1.5, 3.0, 0.3
"""m of (1), the smallest that is accepted, and the other two numbers of (1)."""
LESS, SMALLEST = 0.7, 0.01
"""Factor on radii that leave no plan, and the smallest share of L that is tried."""
HALVINGS = 4
"""Number of bisections of m."""
ROUNDS, BEYOND = 3, 0.15
"""Largest number of rounds of pilot runs, and the use over 1/m that is accepted."""
SCALES = (0.1, 0.16, 0.22, 0.32, 0.45)
"""Scales β of the gains that are tried."""
SLOWER = 1.5
"""Factor on the delays in these runs, and from the scale that fails to one that is taken."""
SETTLED = 5.0
"""Time constants of the slowest observer that the hover takes."""
RATES = ("nu1", "nu2", "qdot")
BLOCKS = {"e": ("position", "orientation", "joints"), "z": RATES}
"""Radii of a tube that are norms of several blocks."""
ROWS = ("position", "depth", "orientation", "joints", *RATES, "tip_speed", "depth_speed", "roll",
        "pitch", "between_knots")
OF_RADII = ("tube", "limit")
"""Kinds of failure that larger radii avoid."""


class PilotsFailed(RunFailed):
    """Pilot runs failed for another reason than a radius; `lines` has one for each."""

    def __init__(self, number: int, lines: Sequence[str]):
        super().__init__(f"{len(lines)} of {number} pilot runs fail for another reason than a "
                         f"radius: {'; '.join(lines)}")
        self.lines = tuple(lines)


@dataclass(frozen=True)
class Row:
    """A row of the tube."""

    largest: float
    """Largest deviation M of the pilot runs."""
    radius: float
    """Its radius r."""
    available: float
    """Largest radius L that the limits leave; inf if no limit depends on it."""


@dataclass(frozen=True)
class Calibration:
    """A scenario with tube and gains from pilot runs."""

    scenario: Scenario
    """The scenario with all of them."""
    rows: dict[str, Row]
    """The rows of its tube by name, those of inputs as `u_surge`."""
    runs: int
    """Number of pilot runs K of a round."""
    multiple: float
    """m of (1)."""
    rounds: int
    """Number of rounds."""
    scale: float | None
    """Scale β of the gains; None if they are the scenario's own."""
    redrawn: float
    """Share of the drawn starts of the pilot runs that had no first plan."""
    longer: float = 0.0
    """Time by which the hover is longer, and the duration with it [s]."""

    def __str__(self) -> str:
        """Returns the table of the rows, and the numbers that are derived."""
        lines = [f"{'row':<14}{'pilot largest':>14}{'radius':>12}{'of the limit':>14}"]
        lines += [f"{name:<14}{row.largest:>14.3g}{row.radius:>12.3g}"
                  f"{row.radius / row.available:>14.0%}" for name, row in self.rows.items()]
        gains = "" if self.scale is None else f"; gains of the scale {self.scale:g}"
        return "\n".join([*lines, "", f"{self.runs} pilot runs, {self.rounds} rounds, radii of "
                          f"at least {self.multiple:.3g} times the largest{gains}; of the starts "
                          f"{self.redrawn:.0%} had no first plan and were drawn again"])


def calibrate(scenario: Scenario, runs: int = 20, gains: bool = False, pool: Pool | None = None,
              progress: Progress = silent) -> Calibration:
    """Returns a scenario of a real loop with a tube, and gains if asked for, from pilot runs.

    Args:
        scenario: The scenario; its declared tube is not read.
        runs: Number K of pilot runs of a round; they are kept, so that another call goes on.
        gains: Whether gains are sought, too.
        pool: Workers; those of this machine by default.
        progress: Progress callback.

    Raises:
        InvalidParameter: A number that cannot be derived is missing, or thrusters are too weak.
        RunFailed: There is no tube within the limits, or `PilotsFailed`.
    """
    require(runs >= 1, "--runs", runs, "at least 1")
    model = check_real(scenario)
    pilots = _Pilots(scenario, runs, pool or local_pool())
    available, scale = available_radii(scenario, model), None
    started = derived(scenario, model, first_radii(scenario, model, available))
    if gains:
        scale, started = best_gains(replace(scenario, tube=started.tube), model, available, pilots,
                                    part_of(progress, 0.0, 0.2))
    tube, rows, multiple = started.tube, dict[str, Row](), MULTIPLE
    for turn in range(1, ROUNDS + 1):
        now = derived(started, model, tube)
        largest, redrawn = pilots.largest(now, part_of(
            progress, 0.2 + 0.8 * (turn - 1) / ROUNDS, 0.2 + 0.8 * turn / ROUNDS))
        rows = {name: Row(M, radii_by_row(tube)[name], available.get(name, np.inf))
                for name, M in largest.items()}
        if turn > 1 and all(
                row.largest <= (1.0 / multiple + BEYOND) * row.radius for row in rows.values()):
            return Calibration(now, rows, runs, multiple, turn, scale, redrawn,
                               now.duration - scenario.duration)
        tube, multiple = fitting(now, model, rows, grow=turn > 1)
    # In the last round no run has left the tube, and it is as large as (1) has it.
    if all(row.largest <= row.radius for row in rows.values()):
        radii = radii_by_row(tube)
        rows = {name: replace(row, radius=radii[name]) for name, row in rows.items()}
        return Calibration(derived(started, model, tube), rows, runs, multiple, turn, scale,
                           redrawn, now.duration - scenario.duration)
    worst = max(rows, key=lambda name: rows[name].largest / rows[name].radius)
    raise RunFailed(f"no tube after {ROUNDS} rounds: {worst} deviates by "
                    f"{rows[worst].largest:.3g}, {rows[worst].largest / rows[worst].radius:.0%} of "
                    "its radius, and more with each round; smaller gains or slower approaches "
                    "(draws.speed) would help")


def check_real(scenario: Scenario) -> ContactModel:
    """Returns the controller's model, or raises for a scenario that is no real loop.

    Raises:
        InvalidParameter: It, or a number that cannot be derived, is missing; or thrusters are too
            weak for the press.
    """
    contact = scenario.contact.declared_wall()
    require(contact is not None, "contact", type(scenario.contact).__name__,
            "a !SensedContact: a known wall has no real loop")
    for key, kind in (("actuation", SampledCommand), ("actuation", Thrusters),
                      ("sensing", Navigation)):
        parts = getattr(scenario, key)
        require(any(isinstance(part, kind) for part in parts), key,
                [type(part).__name__ for part in parts], f"with a !{kind.__name__}")
    check_log(scenario)
    require(isinstance(scenario.ancillary, TipFirst), "ancillary",
            type(scenario.ancillary).__name__, "a !TipFirst, whose vehicle has gains of its own")
    for key in ("speed", *(() if scenario.mission.steps else ("force",))):
        require(getattr(scenario.draws, key) is not None, f"draws.{key}", None,
                "declared: nothing that is measured determines it")
    check_forces(scenario)
    wall = sensed_contact(scenario)
    require(wall.friction == 0.0 or wall.tangential_lag > 0.0, "contact.tangential_lag",
            wall.tangential_lag, "positive: a sampled law that cancels friction makes the tip "
            "heavier; no formula has it, so that it is to be declared")
    forces = force_bounds(scenario)
    assert forces is not None
    off = largest_reading_error(scenario, forces, 0.0)
    require(wall.force_error >= off, "contact.force_error", wall.force_error,
            f"at least {off:.3g} N, the error of a reading of the declared sensor")
    model = check_inputs(scenario)
    check_strength(scenario, model)
    return model


def check_strength(scenario: Scenario, model: ContactModel) -> None:
    """Raises `InvalidParameter` if thrusters or motors cannot hold the strongest press.

    At rest at the task's posture, in the declared current from any of four headings.
    """
    key, wanted = strongest(scenario)
    y_des = np.concatenate([np.asarray(scenario.task.pose), np.asarray(scenario.task.posture)])
    config = model.configuration(y_des)
    at, rest = model.kinematics(config), np.zeros(model.size)
    still = model.inverse_dynamics(at, rest, rest)
    flow = float(np.hypot(*scenario.current[:2]))
    drag = [np.abs(model.inverse_dynamics(at, flow * np.eye(model.size)[i] * sign, rest) - still)
            for i in (0, 1) for sign in (1.0, -1.0)]
    pressing = model.task_jacobian(config)[:3].T @ (wanted * sensed_contact(scenario).direction)
    needed = np.abs(still + pressing) + np.max(drag, axis=0)
    short = needed - strength_of(read_uvms(scenario.model)).force
    i = int(np.argmax(short))
    require(short[i] < 0.0, key, wanted,
            f"less: along {coordinate(i)} a press in the current takes {needed[i]:.3g} "
            f"{unit_of(i)} at rest, {short[i]:.3g} {unit_of(i)} more than there is")


def strongest(scenario: Scenario) -> tuple[str, float]:
    """Returns key and size of the largest desired force of a drawn run, or its own [N]."""
    return max(force_to_admit(scenario), ("task.force", pressing_force(scenario)),
               key=lambda item: item[1])


def radii_by_row(tube: TubeRadii) -> dict[str, float]:
    """Returns the declared radii of a tube by the names of rows."""
    return {key: float(getattr(tube, key)) for key in (*ROWS, *BLOCKS)
            if getattr(tube, key) is not None} | radii_of(tube)


def tube_of(radii: dict[str, float]) -> TubeRadii:
    """Returns the tube with radii by row."""
    parts = {key: np.array([radius for name, radius in radii.items()
                            if name.startswith(f"{key}_")]) for key in ("u", "tau")}
    alone: dict[str, Any] = {key: radius for key, radius in radii.items()
                             if not key.startswith(("u_", "tau_"))}
    return TubeRadii(**alone, u=parts["u"], tau=parts["tau"] if len(parts["tau"]) else None)


def available_radii(scenario: Scenario, model: ContactModel) -> dict[str, float]:
    """Returns the largest radius L of each row that the limits leave: half of the smallest.

    Depth and position are limited by the safe region of the largest force, the speeds of the tip by
    that of an approach, whose limit is derived from theirs.
    """
    contact, limits = sensed_contact(scenario), limits_of(scenario, model)
    none = dict.fromkeys((*ROWS, *BLOCKS), 0.0) | {
        f"{key}_{name}": 0.0
        for key in ("u", *(("tau",) if scenario.limits.tau is not None else ()))
        for name in input_names(model.num_joints)}
    out = dict[str, float]()
    for name in none:
        unit = tube_of(none | {name: 1.0})
        out[name] = min((half / radius for limit in limits.values()
                         for _, radius, half in limit.margins(unit) if 0.0 < radius < np.inf),
                        default=np.inf)
    key, wanted = strongest(scenario)
    depth = largest_margin(scenario, wanted)
    require(depth > 0.0, key, wanted,
            "less: contact.force and contact.force_error leave no room for a tube")
    tilt, speed = contact.walls.tilt, scenario.draws.speed
    assert speed is not None
    return out | {
        "depth": depth,
        "position": min(out["position"], depth / (2.0 * np.sqrt(2.0) * tilt) if tilt else depth),
        "between_knots": depth, "tip_speed": speed, "depth_speed": speed}


def with_totals(radii: dict[str, float]) -> dict[str, float]:
    """Returns radii with those of several blocks, the norms of theirs."""
    return radii | {total: float(np.linalg.norm([radii[key] for key in blocks]))
                    for total, blocks in BLOCKS.items()}


def derived(scenario: Scenario, model: ContactModel, tube: TubeRadii) -> Scenario:
    """Returns a scenario with a tube, and the numbers that follow from it and the declared ones.

    The hover until the observers have settled, by which the run takes longer if it is longer, the
    limits of the tip's speed about those of a plan, and the terminal set.

    Raises:
        InvalidParameter: There is no plan within the tightened limits.
    """
    contact, law, mpc = sensed_contact(scenario), scenario.ancillary, scenario.mpc
    assert isinstance(law, TipFirst) and scenario.draws.speed is not None
    assert tube.depth_speed is not None and tube.tip_speed is not None
    rates = [rate for rate in (law.vehicle.observer, law.tip.observer) if rate > 0.0]
    hover = mpc.time_step * float(np.ceil(
        (SETTLED / min(rates) if rates else mpc.hover) / mpc.time_step))
    across = max([scenario.draws.speed, *(
        float(np.max(step.fastest)) for step in scenario.mission.steps)])
    scenario = replace(
        scenario, duration=scenario.duration + max(0.0, hover - mpc.hover),
        mpc=replace(mpc, hover=hover), tube=tube,
        contact=replace(contact, speed=up(scenario.draws.speed + tube.depth_speed),
                        speed_across=up(across + tube.tip_speed)))
    return with_plan(scenario, model)


def with_plan(scenario: Scenario, model: ContactModel) -> Scenario:
    """Returns a scenario with the largest terminal set within its tightened limits.

    Raises:
        InvalidParameter: There is none, no first plan, or no room for the largest force.
    """
    (key, wanted), most = strongest(scenario), largest_force(scenario)
    require(wanted < most, key, wanted, f"below {most:.3g} N, which depth and position "
            "of the tube leave of contact.force")
    ocp = make_ocp(scenario, model)
    radius, check = largest_radius(ocp, scenario.certificate.terminal_samples)
    require(radius > 0.0, f"limits ({check.limiting})", radius, "roomier: no terminal set is left")
    scenario = replace(scenario, mpc=replace(scenario.mpc, terminal_radius=down(radius)))
    require(first_feasible(scenario, make_ocp(scenario, model)) is not None, "start",
            scenario.start.config, "one with a first plan within the limits less the tube")
    return scenario


def first_radii(scenario: Scenario, model: ContactModel, available: dict[str, float]) -> TubeRadii:
    """Returns radii to begin with: 0.3 of the available ones, all of them less until they fit."""
    share = SHARE
    while True:
        tube = tube_of(with_totals(
            {name: share * most for name, most in available.items() if name not in BLOCKS}))
        try:
            derived(scenario, model, tube)
        except InvalidParameter as error:
            share *= LESS
            if share < SMALLEST:
                raise RunFailed(f"no tube fits: with radii of {share:.2g} of the limits, "
                                f"{error}") from None
        else:
            return tube


def first_guess(scenario: Scenario, model: ContactModel, scale: float) -> Calibration:
    """Returns a scenario with the gains of a scale, and the tube that pilot runs begin with."""
    scenario = with_gains(scenario, scale, model)
    tube = first_radii(scenario, model, available_radii(scenario, model))
    found = derived(scenario, model, tube)
    return Calibration(found, {}, 0, 0.0, 0, scale, 0.0, found.duration - scenario.duration)


def fitting(scenario: Scenario, model: ContactModel, rows: dict[str, Row], *, grow: bool
            ) -> tuple[TubeRadii, float]:
    """Returns the tube of (1) with the largest m up to 2 that fits, and m; see the module.

    Args:
        scenario: The scenario of the pilot runs.
        model: The controller's model.
        rows: Their rows.
        grow: Whether no radius gets smaller, and none has more than m M.

    Raises:
        RunFailed: Not even 1.5 fits.
    """
    def fitted(multiple: float) -> TubeRadii:
        tube = tube_of({name: up(max(multiple * row.largest, row.radius if grow else min(
            FILLED * row.largest, SHARE * row.available))) for name, row in rows.items()})
        derived(scenario, model, tube)
        return tube

    try:
        return fitted(MULTIPLE), MULTIPLE
    except InvalidParameter:
        low, high = LEAST_MULTIPLE, MULTIPLE
    try:
        best = fitted(low)
    except InvalidParameter as error:
        name = max(rows, key=lambda name: rows[name].largest / rows[name].available)
        raise RunFailed(
            f"no tube of {LEAST_MULTIPLE} times the largest deviations fits: {name} takes "
            f"{LEAST_MULTIPLE * rows[name].largest / rows[name].available:.0%} of its limit; "
            f"{error}") from None
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        try:
            low, best = middle, fitted(middle)
        except InvalidParameter:
            high = middle
    return best, low


def best_gains(scenario: Scenario, model: ContactModel, available: dict[str, float],
               pilots: "_Pilots", progress: Progress) -> tuple[float, Scenario]:
    """Returns the best scale of the gains, and the scenario with them; see the module.

    Raises:
        RunFailed: No scale is far enough from one that fails.
    """
    tried = {scale: derived(with_gains(scenario, scale, model), model, scenario.tube)
             for scale in SCALES}
    scores, said = dict[float, float](), list[str]()
    results = pilots.results([slowed(each, model) for each in tried.values()], 1, progress)
    for (scale, each), result in zip(tried.items(), results, strict=True):
        radii, bad = radii_by_row(each.tube), other_failures(result)
        scores[scale] = np.inf if bad else max(
            SLOWER * use * radii[name] / available[name] for name, use in result["use"].items())
        said.append(f"{scale:g}: {'; '.join(bad) or f'1.5 M/L = {scores[scale]:.2g}'}")
    # Below the first that works a scale fails for it is too soft.
    works = [scale for scale in SCALES if scores[scale] < SLOWER]
    failing = min((scale for scale in SCALES if scale not in works and scale > min(works)),
                  default=np.inf) if works else np.nan
    good = [scale for scale in works if scale <= failing / SLOWER]
    if not good:
        raise RunFailed(f"no gains, by scale: {', '.join(said)}")
    best = min(good, key=lambda scale: scores[scale])
    return best, tried[best]


def with_gains(scenario: Scenario, scale: float, model: ContactModel) -> Scenario:
    """Returns a scenario with the gains of (2)."""
    vehicle, joints = command_path_of(scenario.actuation, model).mean_delays
    measured = next(part for part in scenario.sensing if isinstance(part, Navigation)).joints
    joints += measured.latency + 0.5 / measured.rate

    def block(delay: float) -> BlockGains:
        sigma = SLOWER * scale / delay
        return BlockGains(*(float(f"{part * sigma:.2g}") for part in (2.0, 1.0, 0.6)))

    law = scenario.ancillary
    assert isinstance(law, TipFirst)
    return replace(scenario, ancillary=replace(law, vehicle=block(vehicle), tip=block(joints)))


def slowed(scenario: Scenario, model: ContactModel) -> Scenario:
    """Returns a scenario with `SLOWER` times the delays of its clock and thrusters."""
    def slower_part(part: Any) -> Any:
        if isinstance(part, SampledCommand):
            return replace(part, delay=SLOWER * part.delay)
        if isinstance(part, Thrusters):
            known = part.known(model)
            steps = np.ceil(SLOWER * known.dead_time / part.period - 1e-9)
            return replace(part, lag=SLOWER * float(np.mean(known.lag)),
                           dead_time=float(steps * part.period))
        return part

    return replace(scenario, actuation=[slower_part(part) for part in scenario.actuation])


class _Pilots:
    """Pilot runs, each of the same draws in every round; they are kept in the cache's folder.

    Their seed follows from the task alone, so that it does not depend on tube, gains or outcome.
    """

    def __init__(self, scenario: Scenario, number: int, pool: Pool):
        self._number, self._pool = number, pool
        self._seed = int(hashlib.sha256(
            f"pilot runs: {task_of(scenario)}".encode()).hexdigest()[:8], 16)

    def results(self, scenarios: Sequence[Scenario], number: int, progress: Progress
                ) -> list[dict[str, Any]]:
        """Returns the results of the first runs of each scenario, one after the other.

        They are without a supervisor: radii are its thresholds.
        """
        campaigns = [make_campaign(with_step(replace(scenario, supervisor=None)), self._seed, None)
                     for scenario in scenarios]
        name = hashlib.sha256("".join(each.identity for each in campaigns).encode()).hexdigest()
        cells = [(i, index) for i in range(len(campaigns)) for index in range(number)]
        return runs(cells, partial(_run_of, campaigns), cache_dir() / "pilot-runs" / name[:32],
                    self._pool, progress=progress)

    def largest(self, scenario: Scenario, progress: Progress) -> tuple[dict[str, float], float]:
        """Returns the largest deviation of each row, and the share of redrawn starts.

        Raises:
            PilotsFailed: A run failed for another reason than a radius.
        """
        results = self.results([scenario], self._number, progress)
        failed = [f"run {result['index']} {', and '.join(bad)}"
                  for result in results if (bad := other_failures(result))]
        if failed:
            raise PilotsFailed(self._number, failed)
        return {name: radius * max(result["use"][name] for result in results)
                for name, radius in radii_by_row(scenario.tube).items()}, (
            1.0 - self._number / sum(result["starts"] for result in results))


def _run_of(campaigns: Sequence[Campaign], cell: tuple[int, int]) -> dict[str, Any]:
    """Returns the result of a run of one of several campaigns."""
    return run_one(campaigns[cell[0]], cell[1])


def other_failures(result: dict[str, Any]) -> list[str]:
    """Returns the failures of a run that no radius explains, with their sizes."""
    wall = result.get("wall", {})
    sizes = {"exception": result["error"], "no plan": f"{result.get('mpc_failures')} samples",
             "force": f"{max(wall.get('static', 0.0), wall.get('peak', 0.0)):.3g} of it",
             "contact": f"{max(result.get('losses', 0), wall.get('losses', 0))} times",
             "force line": f"{result.get('off_line') or 0.0:.3g} of it"}
    return [f"{FAILURES[kind]}{f' ({sizes[kind]})' if kind in sizes else ''}"
            for kind in failures_of(result) if kind not in OF_RADII]


def up(value: float) -> float:
    """Returns a value of three digits that is not smaller."""
    return _rounded(value, np.ceil)


def down(value: float) -> float:
    """Returns a value of three digits that is not larger."""
    return _rounded(value, np.floor)


def _rounded(value: float, way: np.ufunc) -> float:
    if value <= 0.0:
        return value
    size = 10.0 ** (np.floor(np.log10(value)) - 2.0)
    return float(f"{float(way(round(value / size, 9))) * size:.6g}")
