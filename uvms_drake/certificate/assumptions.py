"""Assumptions of a certificate: statements that it does not compute, each with its guarantor.

One statement a line, generated from the scenario. Those about actuation, sensing and surface are
the scope of the verdict. Assumptions that a scenario can give up are conditions.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from uvms_drake.actuation.ideal import IdealWrench
from uvms_drake.actuation.thrusters import Thrusters
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.description.thruster_file import AXES
from uvms_drake.model.propulsion.allocation import weaker_wrench
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.signals.command_path import CommandPath
from uvms_drake.model.signals.sensor_actuator import Actuator
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.disturbance import Disturbance
from uvms_drake.plant.model_error import Unknowns
from uvms_drake.plant.waves import largest_speed
from uvms_drake.station.contact.measurement_path import SENSOR_MAKER, measurement_path
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.contact import SensedContact
from uvms_drake.station.scenario.parts import command_path_of, uncovered
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.conditions import Condition, assumption

GUARANTEE = "control/theory.md#closed-loop-guarantee"
"""Theorem that the conditions are for."""
MOTORS = "motors"
"""Subject of the torques that the motors of the joints do not give."""
SCOPE = ("actuation", MOTORS, "sensing", "surface", "unknowns", "logs", "excitation")
"""Subjects whose first assumption is part of the verdict."""
OPERATOR, CERTIFIER = "operator", "the person who certifies"
"""Guarantors of declared data, and of estimates."""
Statement = tuple[str, str, str]
"""Subject, statement and guarantor of an assumption."""
MAKER = "robot's maker"
INTEGRATOR = "integrator of the controller"


@dataclass(frozen=True)
class Assumption:
    """A statement that a certificate rests on and does not compute."""

    about: str
    """Its subject: one of `SCOPE`, or another."""
    statement: str
    guaranteed_by: str
    """Person or maker that has to guarantee it."""


def assumptions_of(scenario: Scenario, model: ContactModel) -> tuple[Assumption, ...]:
    """Returns the assumptions of a scenario's certificate, those of `SCOPE` first."""
    wall, actuation = scenario.contact.declared_wall(), scenario.actuation
    path = command_path_of(actuation, model)
    return tuple(Assumption(*each) for each in (
        *_actuation(scenario, path, model),
        *_motors(scenario, model),
        *_sensing([] if wall is None else [*_force_sensor(scenario)], path, [
            type(part).__name__ for part in scenario.sensing
            if part.assumption() is not None and part.reading(0.0, 0.0) is None]),
        *_surface(scenario, wall), ("surface", "the tip alone touches anything", OPERATOR),
        *_disturbance(scenario.disturbance, scenario.unknowns, model.size),
        *_identified(scenario),
        ("robot", "geometry, joints and their ranges are those of the files of "
         f"{scenario.model}, and so are inertia, added mass, drag and buoyancy", MAKER),
        ("robot", "it is at rest at the declared start, no plan before it", OPERATOR),
        ("computer", f"each plan is there at its knot, every {scenario.mpc.time_step:g} s, and the "
         "law's arithmetic takes no time and does not round", INTEGRATOR),
        ("search", "no supremum that is marked 'estimated' is larger than its search found, times "
         f"{scenario.certificate.safety_factor:g}; the terminal set holds between its samples",
         CERTIFIER)))


def scope_of(assumptions: Sequence[Assumption]) -> dict[str, str]:
    """Returns the first statement about each of `SCOPE`, as far as there is one."""
    first = {item.about: item.statement for item in reversed(assumptions)}
    return {about: first[about] for about in SCOPE if about in first}


def undriven_axes(model: UvmsModel) -> tuple[str, ...]:
    """Returns the axes of the vehicle that the robot's own thrusters leave undriven."""
    return () if model.thrusters is None else tuple(model.thrusters.undriven)


def _thrusters(actuation: Sequence[Actuator]) -> bool:
    """Returns whether the robot's own thrusters are among the parts."""
    return any(type(part) is Thrusters for part in actuation)


def unnamed_axes(actuation: Sequence[Actuator], model: UvmsModel) -> tuple[str, ...]:
    """Returns the undriven axes that no `IdealWrench` names; none if thrusters are simulated."""
    if _thrusters(actuation):
        return ()
    named = {axis for part in actuation if isinstance(part, IdealWrench) for axis in part.undriven}
    return tuple(axis for axis in undriven_axes(model) if axis not in named)


def _timing(path: CommandPath) -> str:
    """Returns clock, delay, dead time and lag of the commands in words."""
    words = []
    if path.period > 0.0:
        words.append(f"under a zero-order hold of {path.period:.3g} s, {path.delay:.3g} s late")
    if path.has_thrusters:
        sampled = f" sampled every {path.thruster_period:.3g} s," if path.thruster_period else ""
        waits = f" after a dead time of {path.dead_time:g} s" if path.dead_time else ""
        words.append(f"the wrench{sampled} with a lag of {path.lag:g} s{waits}")
    return ", ".join(words) or "at once, in continuous time"


def _actuation(scenario: Scenario, path: CommandPath, model: ContactModel) -> Iterator[Statement]:
    """Yields the wrench and the torques."""
    robot, actuation, limits = scenario.model, scenario.actuation, scenario.limits
    undriven, lacking = undriven_axes(model), _lacking(scenario, model)
    timing = _timing(path)
    ideal = "an ideal wrench on six axes and a torque on every joint"
    if _thrusters(actuation):
        yield "actuation", f"the thrusters of {robot} as its files have them", MAKER
    elif undriven or lacking:
        drive = f"drive no {', '.join(undriven)}" if undriven else ""
        yield ("actuation", f"{ideal}, {timing}; NOT {robot} as it is, whose thrusters "
               + " and ".join(filter(None, (drive, lacking)))
               + ("" if unnamed_axes(actuation, model) else ", asked for by !IdealWrench"),
               f"{OPERATOR}, by other thrusters")
    else:
        yield "actuation", f"{ideal}, {timing}", MAKER
    limited = [name for name in ("tau", "thrusters") if getattr(limits, name) is not None]
    yield ("actuation", "every force M(𝔮)u of a command within limits.u"
           + (f" and limits.{', limits.'.join(limited)}" if limited else "")
           + " is there, without dead band, ripple or thermal limit", MAKER)


def _asked(scenario: Scenario, model: ContactModel) -> np.ndarray:
    """Returns the largest forces (6+n,) that the limits leave to a command [N, N m].

    Of a command at a corner of `limits.u`, |M(𝔮)|u in the posture of the start, and of `limits.tau`
    if it is less.
    """
    M = model.mass_matrix(model.kinematics(np.asarray(scenario.start.config, dtype=float)))
    most = np.inf if scenario.limits.tau is None else scenario.limits.tau
    return np.minimum(np.abs(M) @ np.asarray(scenario.limits.u, dtype=float), most)


def _lacking(scenario: Scenario, model: ContactModel) -> str:
    """Returns the axis along which thrusters give least of the limits' wrench; empty for none."""
    if model.thrusters is None:
        return ""
    thrusters, asked = ThrusterModel.of(model.thrusters), _asked(scenario, model)
    given = {i: weaker_wrench(thrusters, i) for i in thrusters.driven}
    worst = min(given, key=lambda i: given[i] / asked[i])
    unit = "N" if worst < 3 else "N m"
    return (f"give {given[worst]:.3g} {unit} of the {asked[worst]:.3g} {unit} that the limits may "
            f"ask for in {AXES[worst]}" if given[worst] < asked[worst] else "")


def _motors(scenario: Scenario, model: ContactModel) -> Iterator[Statement]:
    """Yields the torques that the limits leave to a command and that the motors do not give."""
    asked = _asked(scenario, model)
    said = "limits.u" + ("" if scenario.limits.tau is None else " and limits.tau")
    over = [f"{asked[6 + j]:.3g} {'N' if model.slides[j] else 'N m'} of joint {j + 1}, whose motor "
            f"gives {effort:.3g}" for j, effort in enumerate(model.joint_effort)
            if asked[6 + j] > effort]
    if over:
        yield (MOTORS, f"in the posture of the start {said} may ask for up to {'; '.join(over)}: "
               "assumed not to be asked for; a run in which a motor cuts one has no guarantee",
               f"{OPERATOR}, or limits.tau of the scenario")


def _sensing(force: list[Statement], path: CommandPath, of_state: Sequence[str]
             ) -> Iterator[Statement]:
    """Yields the measured state, and the statements about the measured force.

    A certificate for the worst case has no sensor of the state: its conditions fail with one.
    """
    state = "exact pose, velocity and joint angles" if not of_state else (
        f"pose, velocity and joint angles of !{', !'.join(of_state)}, which no proof covers")
    yield ("sensing", f"{state}, "
           + ("at the ticks of the clock" if path.period > 0.0 else "in continuous time")
           + ("; a force sensor within its declared errors, mounted as declared and of exactly "
              "first order" if force else ""),
           "maker of navigation and encoders" + (f", {SENSOR_MAKER}" if force else ""))
    yield from force


def _force_sensor(scenario: Scenario) -> Iterator[Statement]:
    """Yields the assumptions about the force sensor, and about all between it and the law."""
    yield ("sensing", "noise, bias, drift, lag and range of the force sensor, and mass and "
           "inertia of the tool beyond it, are as declared until "
           f"t = {scenario.duration:g} s", SENSOR_MAKER)
    yield ("sensing", "between two readings of the force the feedback adds nothing to the "
           "variation of the tip's acceleration along n that forces, disturbance and plan make "
           "(tube/contact/theory.md#unevenness-of-the-tips-motion)", CERTIFIER)
    for element in measurement_path(scenario):
        covered = element.theorem or "no theorem covers it"
        yield ("sensing", f"{element.system}, before the law: {element.statement} ({covered})",
               element.guaranteed_by)


def _surface(scenario: Scenario, wall: SensedContact | None) -> Iterator[Statement]:
    """Yields the declared surface, or the class of walls and the rates of other forces."""
    if wall is None:
        yield ("surface", f"the declared !{type(scenario.surface).__name__}, exactly: its place, "
               "normal and stiffness, without friction that it does not declare", OPERATOR)
        return
    yield ("surface", f"every wall, {wall.clearance:g} m or more off the tip at the start, "
           "that stands still and is elastic (no hysteresis, creep or adhesion), "
           f"with its normal within {np.rad2deg(wall.angle):.3g}° of the direction, "
           f"{wall.stiffness:g} N/m at most with the tool, friction {wall.friction:g}, "
           f"dissipation {wall.dissipation:g} s/m", OPERATOR)
    yield ("surface", "friction and a normal that turns change the force by "
           f"{wall.force_rate:g} N/s at most, and by {wall.force_ripple:g} N at any rate",
           OPERATOR)
    if (slow := wall.hold) is not None:
        yield ("surface", "in a hold they change it by "
               f"{slow.force_rate:g} N/s and {slow.force_ripple:g} N at most", OPERATOR)


def _disturbance(bound: Disturbance, unknowns: Unknowns, size: int) -> Iterator[Statement]:
    """Yields the bound of d, and the declared unknowns that are a part of it."""
    ball = f"in norm at most {bound.d_bound:.4g}"
    if np.size(bound.weights):
        ball = "in the ellipsoid of semi-axes " + ", ".join(
            f"{each:.3g}" for each in bound.axes(size))
    yield ("disturbance", f"all that acts on the robot and is not modelled is a "
           f"d {ball} m/s², rad/s²", OPERATOR)
    error, current = unknowns.error, unknowns.current
    if np.any(current):
        yield ("disturbance", "of that, a steady uniform current of at most "
               f"{np.hypot(*current[:2]):.3g} m/s horizontally, {abs(current[2]):.3g} m/s up or "
               "down", OPERATOR)
    if unknowns.waves:
        yield "disturbance", "of that, a regular wave as declared, from anywhere", OPERATOR
    if error.size > 0.0:
        yield ("disturbance", "of that, mass, water and joint friction of the robot that are off "
               "by the sizes of model_error", MAKER)
    if np.any(current) or error.size > 0.0:
        yield ("unknowns", "current, mass, water and joint friction are constant, and no error "
               "between both ends of its declared size acts more than at the ends", OPERATOR)
    if unknowns.present:
        yield ("disturbance", f"all else keeps to {1.0 - error.share:.3g} of the bound", OPERATOR)


def _identified(scenario: Scenario) -> Iterator[Statement]:
    """Yields the logs that the robot was identified from, and their excitation."""
    if (found := scenario.identified) is not None:
        for sentence in found.log_sentences():
            yield "logs", sentence, OPERATOR
        yield "excitation", found.excitation(scenario.limits), OPERATOR


def assumed_conditions(scenario: Scenario, model: ContactModel | None = None) -> list[Condition]:
    """Returns the assumptions of the proofs that a scenario can give up; 0 where one is kept.

    Those that it cannot give up are `assumptions_of`.
    """
    # Parts of the loop first, which no setting mends; axes without a thruster, options of the MPC.
    wall, actuation = scenario.contact.declared_wall(), scenario.actuation
    mpc, model = scenario.mpc, model or load_model(scenario)
    unnamed, undriven = unnamed_axes(actuation, model), ", ".join(undriven_axes(model))
    assumed: list[tuple[str, str, float]] = [
        *_uncounted(scenario.unknowns, actuation),
        ("surface_error", "which the controller does not know", scenario.surface_error.size),
        ("faults", "which the proofs do not cover", len(uncovered(scenario.faults))),
        ("mpc.initial_state", "plans start at the measured state", mpc.initial_state != "nominal"),
        ("mpc.terminal_weight", "P without a terminal controller", mpc.terminal_weight is not None),
        ("mpc.terminal_set", "none", not mpc.terminal_set),
        *([] if wall is None else [("contact.tangential_lag", "delayed feedback of the friction",
                                    wall.tangential_lag)])]
    return [
        *(assumption(f"{key}[{i}]", f"{type(part).__name__}: {part.assumption()}", topic=key,
                     theorem=GUARANTEE)
          for key, parts in (("sensing", scenario.sensing), ("actuation", actuation))
          for i, part in enumerate(parts) if part.assumption() is not None
          and (wall is None or part.reading(0.0, 0.0) is None)),
        assumption("axes that the robot's thrusters do not drive", "unnamed by an !IdealWrench"
                   + (f": {', '.join(unnamed)}" if unnamed else ""), len(unnamed),
                   advice=f"--set 'actuation=[!IdealWrench {{undriven: [{undriven}]}}]', for a "
                   "robot with other thrusters" if unnamed else "", theorem=GUARANTEE),
        *(assumption(key, reason, broken, theorem=GUARANTEE) for key, reason, broken in assumed),
        *(assumption(f"mpc.terms[{i}]", f"{type(term).__name__}, which the terminal set leaves out",
                     topic="mpc.terms", theorem=GUARANTEE) for i, term in enumerate(mpc.terms))]


def _uncounted(unknowns: Unknowns, actuation: Sequence[Actuator]) -> list[tuple[str, str, float]]:
    """Returns key, reason and size of the unknowns that `declared_unknowns` leaves out.

    It counts them for a robot whose command acts at once.
    """
    counted = all(isinstance(part, IdealWrench) for part in actuation)
    sizes = {"current": float(np.linalg.norm(unknowns.current)),
             "waves": largest_speed(unknowns.waves), "model_error": unknowns.error.size}
    several = len(unknowns.waves) + np.any(unknowns.current) > 1 and sizes["waves"]
    return [*((key, "counted only where the command acts at once", 0.0 if counted else size)
              for key, size in sizes.items()),
            *([("waves", "each wave and a current have a phase and a heading of their own",
                sizes["waves"])] if several else [])]
