"""A scenario with an unknown wall for a robot, ideal or behind its own thrusters.

Its numbers are those of a first scenario, but for the class of the wall. With F the desired force,
ν the error of a reading by the sensor's own bound, a₋ that of `SurfaceClass.share` and E the depth
that tube and estimate may take, the largest force is

    F_max = 1.1 ((F + 2ν)/a₋ + 2κ₊E),                                                            (1)

and the limits of the inputs are those of `first_scenario.pressed_inputs`. Behind thrusters, a touch
at the speed of an approach is to raise the force by 0.3 F in the mean delay of the wrench; gains
and tube are those with which `calibrate` begins.
"""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from uvms_drake.model.robot import Robot
from uvms_drake.model.surface.surface_class import wall_axes
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.setup import first_scenario as first
from uvms_drake.setup.calibrate import check_real, first_guess, up
from uvms_drake.setup.calibrated_file import calibrated_text
from uvms_drake.setup.settle import overlaid, with_settings
from uvms_drake.station.contact import bounds
from uvms_drake.station.contact.tube_in_contact import force_bounds
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.parts import command_path_of
from uvms_drake.station.scenario.scenario import Scenario, scenario_of

TEMPLATES = [Path(__file__).with_name(f"{name}.template") for name in ("unknown_wall", "real_loop")]
"""Texts of the sections in place of those of a first scenario; both if it is behind thrusters."""
LIMITS: tuple[dict[str, Any], dict[str, Any]] = (
    {"nu1": 0.15, "nu2": 0.12, "qdot": 0.3, "horizon": 26, "time_step": 0.12, "gain": 40.0},
    {"nu1": 0.2, "nu2": 0.2, "qdot": 1.0, "horizon": 20, "time_step": 0.16})
"""Numbers in place of those of a first scenario, ideal and behind thrusters; the joints' speed is
no more than the robot's own."""
FIELDS: tuple[dict[str, Any], dict[str, Any]] = (
    {"room": 0.003, "rate": 500.0, "sensor_lag": 0.004, "period": 0.002, "delay": 0.022,
     "tool_angle": 0.25, "lag": 0.0},
    {"room": 0.008, "rate": 200.0, "sensor_lag": 0.005, "period": 0.005, "delay": 0.03,
     "tool_angle": 0.5, "lag": 2.0})
"""E of (1) [m], sensor [Hz, s], angle of the tool [rad], lag across the direction [s]."""
MORE = 1.1
"""Factor of (1), and on the bound of a reading's error."""
STIFFNESS, OFF, MOST_OFF = 1000.0, 0.002, 0.2
"""κ₊ [N/m]; behind thrusters, with an estimate of the tip off by `OFF` [m], as much less as makes
that no more than this share of the force."""
TOUCH, SCALE = 0.3, 0.16
"""Share of the force that a touch adds, and the scale β of the gains behind thrusters."""
RANGE, TILT = 0.4, np.deg2rad(3.0)
"""Tolerance of the joints about the posture behind thrusters, and tilt of the true wall [rad]."""
ROUNDS = 4
"""Number of times that (1) is evaluated: the error of a reading depends on F_max."""


def press(robot: Robot, found: first.FirstScenario, model: str, path: Path, *, unknown: bool,
          real: bool) -> tuple[first.FirstScenario, Callable[[first.FirstScenario], str]]:
    """Returns the numbers of a scenario with a wall, and the function to the text of its file.

    Args:
        robot: The robot.
        found: Its first scenario, with a wall that is known.
        model: As `model` has it: a name or a path from the file's folder.
        path: The file.
        unknown: Whether the wall is unknown.
        real: Whether it is, and the press behind the robot's thrusters, a clock and a navigation.

    Raises:
        RunFailed: A thruster or a motor is too weak; says by how much.
        InvalidParameter: There is no first plan behind thrusters.
    """
    if not (unknown or real):
        return found, lambda found: first.format_first_scenario(found, model, robot.name)
    world, force = UvmsModel(robot.uvms), float(np.linalg.norm(found.force))
    into, q = found.force / force, np.clip(
        [found.posture - RANGE, found.posture + RANGE], world.q_lower, world.q_upper)
    axes, kappa = wall_axes(into), min(STIFFNESS, MOST_OFF * force / OFF) if real else STIFFNESS
    found = replace(found, q_limits=q if real else found.q_limits, **LIMITS[real] | {
        "qdot": float(min(LIMITS[real]["qdot"], *world.joint_speed))})
    # Numbers that are not known yet have one with which the scenario gives their bounds.
    fields = defaultdict(lambda: 0.1, **FIELDS[real], **{
        "robot": robot.name, "model": model, "force": force, "least_force": 0.5 * force,
        "gain": found.gain, "stiffness": kappa, "true": 0.7 * kappa, "scale": SCALE,
        "direction": first.exact(into), "point": first.row(0.02 * into),
        "normal": first.exact(np.sin(TILT) * axes[1] - np.cos(TILT) * into),
        "current": first.row(0.1 * axes[2]), "joints": first.row([0.15] * world.num_joints),
        "undriven": ", ".join(found.undriven)})

    def text_of(found: first.FirstScenario) -> str:
        text = first.format_first_scenario(found, model, robot.name)
        for template in TEMPLATES[: 1 + real]:
            text = overlaid(text, template.read_text(encoding="utf-8").format_map(fields))
        return first.aligned(with_settings(
            text, {"limits.static_force": "null"}, "that of the contact"))

    def scenario() -> Scenario:
        return scenario_of(text_of(found), path)

    for _ in range(ROUNDS):
        contact, forces = bounds.sensed_contact(scenario()), force_bounds(scenario())
        assert forces is not None
        off = bounds.largest_reading_error(scenario(), forces, 0.0)
        error = up(MORE * off + real * kappa * OFF)
        most = up(MORE * ((force + 2.0 * error) / contact.walls.share
                          + 2.0 * kappa * fields["room"]))
        fields |= {"error": error, "most": most, "ripple": up(most / 22.0), "clearance": up(
            MORE * bounds.fastest_advance(contact) * forces.reading.tare),
            "line": up(max(0.1 * force, off, real * kappa * OFF))}
    found = replace(found, u=first.pressed_inputs(
        robot.uvms, found, contact.walls, bounds.largest_normal_force(contact)))
    if not real:
        return found, text_of
    delay, _ = command_path_of(scenario().actuation, load_model(scenario())).mean_delays
    fields["pace"] = up(TOUCH * force / (kappa * delay))
    guess = first_guess(scenario(), check_real(scenario()), SCALE)
    return found, lambda found: calibrated_text(text_of(found), guess)
