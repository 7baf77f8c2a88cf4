"""A `FirstScenario` as the text of a scenario's file, with where its numbers are from."""

from collections.abc import Iterable

import numpy as np

from uvms_drake.studies.first_scenario import CURRENT, FRICTION, FirstScenario

LAG_MARGIN = 0.5
"""Gain times lag of a loop that is far from its edge of stability, which is at 2 for k = σ."""
TEXT = """\
# {robot} presses {force:g} N on a wall of known stiffness; made by `uvms-drake scenario --new`.
#
# Ideal here: the wrench on the vehicle is the commanded one, at once, on all six axes;
# states are exact and the feedback is continuous.{lag}
# All else is as in the scenario `base`; SI units, radians, axes NED and FRD.

base: girona500_ideal
description: {robot} presses {force:g} N on a wall.
model: {model}

actuation:
  - !IdealWrench {{undriven: [{undriven}]}}  # axes that the robot's own thrusters do not drive

start:  # at rest; the tip 0.2 m off the wall, level
  eta: {eta}  # m, rad
  q: {posture}  # rad; m of a joint that slides

surface: !UnilateralPlane
  normal: {normal}  # unit vector into the water
  stiffness: 1000.0  # N/m
  dissipation: 2.5  # s/m
  transition: 0.002  # m

# Semi-axes are bound times weight: {covered}a current of {current:.2g} m/s on the hull, and
# friction of {friction:.2g} N m at each joint, or a fifth of a weak motor's effort.
disturbance: !SinusoidalDisturbance
  bound: {bound}
  weights: {weights}  # m/s2 (3), rad/s2

task:
  force: {wrench}  # N, N m; exerted on the wall
  pose: {pose}  # m, rad; the vehicle is level with these
  frame: {frame}  # rad, of the task: zero for a wall that stands upright
  # The tool level and far forward, the arm far from singular: σ_min(J_sq) is {dexterity:.2g}.
  posture: {posture}  # rad
  force_tolerance: {tolerance}  # N

limits:
  nu1: 0.2  # m/s
  nu2: 0.2  # rad/s
  qdot: 0.3  # rad/s
  roll: 0.25  # rad
  pitch: 0.25  # rad
  tip_pitch: {tip_pitch}  # rad
  static_force: {static}  # N, three times the task's, or 3 N more
  q_lower: {q_lower}  # rad; no wider than the task needs
  q_upper: {q_upper}
  # The force that holds the task, and of the remaining force, over the inertia with the water,
  # 60 % of those of thrusters ({thrust}) and 80 % of those of motors;
  # no more than is of use. Where the available force is unknown, the need of the task.
  u: {u}  # m/s2 (3), rad/s2
  # The forces themselves, to have them checked, too; tube.tau then has to be there for a run
  # without a certificate.
  # tau: {tau}

tube:
  u: {tube_u}  # declared, for runs without a certificate

mpc:
  weight_y: {weight_y}
  weight_zeta: {weight_zeta}
  weight_u: {weight_u}  # about 1 / u²

ancillary: !Resolved  # the deviation by the disturbance is a fifth of the force
  k: {gain}  # 1/s
  sigma: {gain}  # 1/s

simulator:
  max_step_size: {step:g}  # s; 0.2 / sigma, 0.02 at most
"""


def format_first_scenario(found: FirstScenario, model: str, robot: str) -> str:
    """Returns the text of a scenario's file.

    Args:
        found: Its numbers.
        model: As `model` has it: a name or a path from the file's folder.
        robot: Name of the robot.
    """
    n, force = len(found.posture), float(np.linalg.norm(found.force))
    bound = float(found.disturbance[0])
    weights = found.disturbance / bound
    known = np.isfinite(found.strength.force)
    thrust = "thrusters.yaml" if np.any(known[:6]) else "unknown without thrusters.yaml"
    tau = np.where(known, found.strength.force, np.ceil(4.0 * np.abs(found.tau_eq) + 20.0))
    text = TEXT.format(
        robot=robot, model=model, undriven=", ".join(found.undriven), force=force,
        lag=_lag(found), eta=_row(found.eta),
        posture=_row(found.posture), normal=_exact(-found.force / force),
        covered="" if found.covered == 1.0 else f"{found.covered:.0%} of ",
        current=CURRENT, friction=FRICTION, bound=_number(bound), weights=_row(weights, 2),
        wrench=_exact([*found.force, 0.0, 0.0, 0.0]), pose=_row([0.0, 0.0, 0.0, *found.pose]),
        frame=_exact(found.frame), dexterity=found.dexterity, tolerance=_number(0.1 * force),
        tip_pitch=_number(max(0.4, 0.3 + abs(float(found.pose[1])))),
        static=_number(max(3.0 * force, force + 3.0)),
        q_lower=_row(-_floored(-found.q_limits[0]), 10),
        q_upper=_row(_floored(found.q_limits[1]), 10),
        thrust=thrust,
        u=_row(found.u, 2), tau=_row(tau, 3), tube_u=_row(2.0 * found.disturbance, 2),
        weight_y=_row([20.0] * 3 + [10.0] * 3 + [2.0] * n),
        weight_zeta=_row([5.0] * 6 + [10.0] * n),
        weight_u=_row(np.clip(1.5 / found.u**2, 0.005, 30.0), 2), gain=_number(found.gain),
        step=min(0.02, 0.2 / found.gain))
    return "".join(f"{_aligned(line)}\n" for line in text.splitlines())


def _aligned(line: str) -> str:
    value, mark, comment = line.partition("  # ")
    return f"{value:<32}{mark}{comment}" if value.strip() and mark else line


def _lag(found: FirstScenario) -> str:
    if found.lag == 0.0:
        return ""
    most = LAG_MARGIN / found.lag
    return (f"\n# Thrusters with a delay of {found.lag:g} s allow gains of about {most:.2g} 1/s:\n"
            "# with them, see the law of `girona500_real_loop`.")


def _number(value: float) -> str:
    return f"{float(f'{value:.3g}'):.10g}"


def _floored(values: np.ndarray) -> np.ndarray:
    """Returns numbers with four decimals that are no larger, but for rounding."""
    out: np.ndarray = np.floor(1e4 * values + 1e-6) / 1e4
    return out


def _row(values: Iterable[float], digits: int = 4) -> str:
    rounded = (0.0 if abs(value) < 1e-9 else float(f"{value:.{digits}g}") for value in values)
    return "[" + ", ".join(f"{value:.10g}" for value in rounded) + "]"


def _exact(values: Iterable[float]) -> str:
    return "[" + ", ".join(f"{value + 0.0:.17g}" for value in values) + "]"
