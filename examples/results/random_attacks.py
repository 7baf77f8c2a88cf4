"""Random attacks on every claim of a certificate: all at once, and all of the declared class.

Each run has a wall of any shape of the class, whose distance, inclination, slope, damping and
friction are drawn, each at its bound in half of the draws; readings whose errors are at their
bounds, constant or as a square wave, of random signs along each axis, after a tare that was off by
as much; an adversary or a square wave with all of the disturbance; every declared unknown at a
bound; and steps of the desired force at random instants. What a run has found is compared with
what is claimed.
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from hold_station import ScriptedSensor, noisy
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from unknowns import BASE, CASES, declared_of, followed

import uvms_drake as uv
from uvms_drake.campaign.drawn_contact import LEAST_CREEP, misplaced, steepest_friction, tips
from uvms_drake.campaign.draws import drawn_unknowns, first_feasible
from uvms_drake.campaign.run import outcome
from uvms_drake.certificate.certificate import Certificate
from uvms_drake.certificate.certify import certified_once
from uvms_drake.common.wiring import release
from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.identification.parameters import AXES
from uvms_drake.mission.steps import Mission
from uvms_drake.plant.adversary import KINDS, ROWS, AdversarialDisturbance
from uvms_drake.plant.model_error import COEFFICIENTS, AxisFactors, Unknowns
from uvms_drake.report.contact_check import summarise_bands
from uvms_drake.sensing.force_sensor import ForceSensor
from uvms_drake.station.contact.bounds import largest_force, pressing_force, sensed_contact
from uvms_drake.station.contact.drawn_surfaces import draw_wall
from uvms_drake.station.problem import load_model, make_ocp
from uvms_drake.station.simulation import make_record
from uvms_drake.station.step_size import friction_rate

BY_AXIS = {"by axis": "vehicle", "by axis of the arm": "arm"}
"""Names of runs with errors by axis, and whose."""
ERRORS = ("added_mass=[1.03]", "linear_drag=[1.3]", "quadratic_drag=[1.3]")
"""Errors by axis in place of those of `girona500_contact_uncertain`."""
RUNS = {"girona500_contact": (12, 14.0), "girona500_contact_uncertain": (6, 14.0),
        "current": (2, 14.0), "mass": (3, 14.0), "added mass": (3, 14.0), "payload": (3, 14.0),
        "girona500_tip_first": (3, 16.0), "bluerov2_contact": (3, 16.0),
        "jacket_inspection": (2, 16.0), "girona500_stiff": (2, 60.0),
        **dict.fromkeys(BY_AXIS, (18, 8.0))}
"""Number of runs and their duration [s]: of a scenario, or of an unknown of `unknowns.CASES`. Those
by axis have one error each, of one coefficient along one axis."""
LIKELY = 0.5
"""Probability of each parameter of the wall to be at its bound."""
NEAR, FURTHER = 1.02, 0.05
"""Least distance of a wall over the clearance, and largest distance beyond that [m]."""
PERIODS = (0.05, 4.0)
"""Range of the periods of square waves and of adversaries [s]."""
APART = (0.5, 6.0)
"""Range of the times between two steps of the desired force [s]."""
SOFTLY = 1.2
"""Least desired force over the largest error of a reading, from which on a touch is one."""
TUBE = {"pose and joints": ("e", "position", "orientation", "joints", "roll", "pitch", "depth"),
        "velocities": ("z", "nu1", "nu2", "qdot", "tip_speed", "depth_speed")}
"""Claims about the tube, and their rows; others are of inputs."""
ACCELERATION, WHOLE = "accelerations by the unknowns", "whole disturbance over its bound"
"""Claims about the disturbance."""
LIMITS = "limits, used"
"""Largest part of a limit that is used."""


class Found(NamedTuple):
    """A run."""

    ratios: dict[str, float]
    """Found over claimed, by claim."""
    bad: tuple[str, ...]
    """What else was not as claimed: bounds of the class that were left, and failed samples."""
    of: str = ""
    """Coefficient that alone is off; empty for all unknowns."""


def errors_of(sensor: ForceSensor, rng: np.random.Generator) -> ScriptedSensor:
    """Returns a force sensor with random admissible errors, at their bounds along its axes."""
    signs, phase = rng.choice([-1.0, 1.0], 3), rng.uniform()
    period = np.exp(rng.uniform(*np.log(PERIODS))) if rng.uniform() < 0.6 else np.inf
    each = float(rng.choice([0.0, 1.0 / 3.0])) * np.arange(3)  # Along the axes apart, or together.

    def script(index: int) -> np.ndarray:
        wave = np.where((index / sensor.rate / period + phase + each) % 1.0 < 0.5, 1.0, -1.0)
        error = -signs if index < sensor.tare_samples else signs * wave
        return np.append(error, noisy(index)[3:])

    return ScriptedSensor(**vars(sensor), drifts=float(rng.choice([-1.0, 1.0])), script=script)


def wall_near(scenario: uv.Scenario, ocp: Ocp, rng: np.random.Generator) -> uv.ShapedSurface:
    """Returns a wall of the class that is near, with friction that the step resolves."""
    contact, (start, goal) = sensed_contact(scenario), tips(scenario, ocp)
    while True:
        wall = draw_wall(contact, start, goal, rng, LIKELY)
        if wall is None:
            continue
        gap = NEAR * contact.clearance + FURTHER * rng.uniform()
        wall = wall.moved(np.eye(3), gap * contact.direction)
        if not misplaced(scenario, ocp, wall, largest_force(scenario)):
            break
    rate = friction_rate(replace(scenario, surface=wall), ocp.model,
                         ocp.model.configuration(ocp.y_des))
    return replace(wall, creep=max(LEAST_CREEP, rate / steepest_friction(scenario, ocp)))


def of_one_axis(declared: Unknowns, body: str, name: str, axis: int, rng: np.random.Generator
                ) -> Unknowns:
    """Returns one coefficient of `vehicle` or `arm` off by its bound along one axis alone."""
    size = (declared.error.by_axis(body, name) - 1.0) * np.eye(6)[axis]
    return Unknowns(replace(declared.error, **{body: AxisFactors(
        **{name: 1.0 + rng.choice([-1.0, 1.0]) * size})}))


def attacked(scenario: uv.Scenario, ocp: Ocp, duration: float, rng: np.random.Generator,
             unknown: Unknowns) -> uv.Record:
    """Returns the record of a run with these unknowns and everything else drawn."""
    model, declared, contact = load_model(scenario), scenario.disturbance, sensed_contact(scenario)
    disturbance = AdversarialDisturbance(
        declared.bound, str(rng.choice(KINDS)), str(rng.choice(list(ROWS))),
        rng.normal(size=model.size), int(rng.integers(model.size)),
        float(np.exp(rng.uniform(*np.log(PERIODS)))), float(rng.uniform(0.0, 2.0 * np.pi)),
        weights=declared.weights)
    sensor, = scenario.sensing
    scenario = uv.with_step(replace(
        scenario, duration=duration, surface=wall_near(scenario, ocp, rng),
        sensing=[errors_of(sensor, rng)], disturbance=disturbance, model_error=unknown.error,
        current=unknown.current, waves=list(unknown.waves)), model)
    station = uv.make_station(scenario, certified=True, model=model)
    simulator = Simulator(station)
    ApplySimulatorConfig(scenario.simulator, simulator)
    context, force = simulator.get_mutable_context(), pressing_force(scenario)
    while (now := context.get_time()) < duration:
        station.GetInputPort("desired_force").FixValue(context, contact.wrench(force))
        simulator.AdvanceTo(min(now + rng.uniform(*APART), duration))
        force = rng.uniform(SOFTLY * contact.force_error, largest_force(scenario))
    record = make_record(scenario, model, uv.read_logs(station, context), 1.0, certified=True)
    release(station)
    return record


def compared(record: uv.Record, certificate: Certificate, of: str = "") -> Found:
    """Returns what a run has found over what is claimed, of unknowns with `of` in their name."""
    found, bands = outcome(record), summarise_bands(record)["force_bands"]
    use, wall = found["use"], found["wall"]
    of_inputs = set(use) - {row for rows in TUBE.values() for row in rows}
    ratios = {f"tube: {name}": max(use.get(row, 0.0) for row in rows)
              for name, rows in {**TUBE, "inputs": of_inputs}.items()}
    ratios |= {
        LIMITS: 1.0 - found["margin"],
        "static force over `contact.force`": wall["static"],
        "force with damping over its bound": wall["peak"],
        "force band in motion": (bands["motion"] or {"worst_ratio": 0.0})["worst_ratio"],
        "force band in a hold": (bands["hold"] or {"worst_ratio": 0.0})["worst_ratio"],
        WHOLE: found["worst_disturbance"]}
    if found["ratio_trajectory"] is not None:
        ratios["tube along the run"] = found["ratio_trajectory"]
    if certificate.unknowns:
        ratios[ACCELERATION] = (
            found["induced"] * record.scenario.disturbance.bound
            / sum(each.takes for each in certificate.unknowns if of in each.name))
    left = uv.summarise(record)["contact"]["out_of_class"]
    return Found(ratios, (*left, *["no plan"] * found["mpc_failures"],
                          *["contact lost"] * wall["losses"],
                          *["never touched"] * (not found["touched"])), of)


def attacks(name: str, runs: int, duration: float, seed: int) -> list[Found]:
    """Returns the runs of a scenario, or of the base of `unknowns` with one of its unknowns."""
    if name in CASES:
        declared = declared_of(name)
        scenario = uv.load_scenario(BASE, [*declared, *followed(declared)[0]])
    elif name in BY_AXIS:
        scenario = uv.load_scenario("girona500_contact_uncertain", [
            "current=[0,0,0]", "model_error.mass=1",
            *(f"model_error.{BY_AXIS[name]}.{each}" for each in ERRORS)])
    else:
        scenario = uv.load_scenario(name)
    certificate = certified_once(scenario)
    if not certificate.certified:
        raise SystemExit(f"{name}: {certificate.failed}")
    scenario = replace(certificate.applied_to(scenario), mission=Mission())
    ocp = first_feasible(scenario, make_ocp(scenario))
    assert ocp is not None  # It is a condition of the certificate.
    # An error of a coefficient that the robot does not have takes nothing of the disturbance.
    having = [each for each in COEFFICIENTS if any(
        each.replace("_", " ") in unknown.name and unknown.takes > 0.0
        for unknown in certificate.unknowns)]
    found = []
    for index in range(min(runs // 6, len(having)) * 6 if name in BY_AXIS else runs):
        rng = np.random.default_rng([seed, index])
        unknown, of = drawn_unknowns(scenario.unknowns, rng, 1.0), ""
        if name in BY_AXIS:
            coefficient = having[index // 6]
            unknown = of_one_axis(scenario.unknowns, BY_AXIS[name], coefficient, index % 6, rng)
            of = coefficient.replace("_", " ")
        found.append(compared(attacked(scenario, ocp, duration, rng, unknown), certificate, of))
        print(f"{name} {index}: {found[-1]}", file=sys.stderr, flush=True)
    return found


def table(found: dict[str, Sequence[Found]]) -> str:
    """Returns a table of the largest ratios, a row for each claim and a column for each name."""
    claims = list(dict.fromkeys(
        claim for runs in found.values() for run in runs for claim in run.ratios))
    rows = [["found over claimed", *(f"`{name}`" for name in found)], ["---"] * (1 + len(found)),
            ["runs", *(f"{len(runs)}" for runs in found.values())]]
    rows += [[claim, *(_largest(runs, claim) for runs in found.values())] for claim in claims]
    rows.append(["runs that left the class, lost the contact, ...", *(
        ", ".join(sorted({each for run in runs for each in run.bad})) or "none"
        for runs in found.values())])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def axis_table(body: str, runs: Sequence[Found]) -> str:
    """Returns a table of the runs by axis: acceleration by the error, and largest other ratio.

    The part of the limits that is used, and the whole disturbance, are left out of the latter.
    """
    cells = [f"{run.ratios[ACCELERATION]:.3f}, " + "{:.2f}".format(max(
        ratio for claim, ratio in run.ratios.items() if claim not in (ACCELERATION, LIMITS, WHOLE)))
        + "".join(f", {each}" for each in run.bad) for run in runs]
    names = list(dict.fromkeys(run.of for run in runs))
    rows = [[f"{body}, axis", *names], ["---"] * (1 + len(names)),
            *([axis, *cells[i::6]] for i, axis in enumerate(AXES))]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _largest(runs: Sequence[Found], claim: str) -> str:
    values = [run.ratios[claim] for run in runs if claim in run.ratios]
    return f"{max(values):.2f}" if values else "–"
