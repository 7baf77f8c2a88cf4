"""A scenario made of objects: robot, surface, force, law and disturbance, without a file."""

from collections.abc import Sequence
from dataclasses import replace
from numbers import Real

import numpy as np

from uvms_drake.common.alarm import LOGGER
from uvms_drake.common.errors import require, vector, within
from uvms_drake.common.program import FOLDER
from uvms_drake.common.schema import check_values
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.model.description.robot_files import model_dir, shipped_robots
from uvms_drake.model.robot import Robot
from uvms_drake.model.signals.sensor_actuator import Sensor
from uvms_drake.model.surface.law import Surface, check_surface
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.plant.disturbance import Disturbance, SinusoidalDisturbance
from uvms_drake.plant.model_check import sound_robot
from uvms_drake.setup.first_scenario import Choices, first_scenario
from uvms_drake.setup.unknown_wall import press
from uvms_drake.station.problem import check_inputs, load_model
from uvms_drake.station.scenario.contact import Contact
from uvms_drake.station.scenario.scenario import Scenario, scenario_of
from uvms_drake.station.step_size import with_step


def make_scenario(
    robot: Robot | str,
    surface: Surface | None = None,
    *,
    force: float | Sequence[float] | np.ndarray,
    place: Sequence[float] | np.ndarray | None = None,
    posture: Sequence[float] | np.ndarray | None = None,
    law: AncillaryLaw | None = None,
    disturbance: Disturbance | float | None = None,
    contact: Contact | None = None,
    sensing: Sequence[Sensor] = (),
    distance: float = 0.2,
    unknown_wall: bool = False,
    real_loop: bool = False,
    name: str = "press",
) -> Scenario:
    """Returns a scenario in which a robot swims to a surface and presses on it.

    Arguments that are left out follow from the robot, and so do limits and weights of the MPC, as
    in a file of `uvms-drake scenario --new`. All of it can be set in the scenario afterwards,
    `scenario.limits.nu1 = 0.2`, `scenario.sensing = [...]`; every function takes it.

    Args:
        robot: A `Robot`, the name of a shipped one, or a robot's folder.
        surface: The surface, also of a class of one's own; None: a wall of 1000 N/m at the origin
            that faces the tool.
        force: Force on the surface along its inward normal [N]; or the vector (3,) in Σ_I [N], for
            a surface that is not flat.
        place: Point of the surface to press on (3,) in Σ_I [m]; None: its `anchor`.
        posture: Joint angles q_des (n,) [rad], of a joint that slides [m]; None: level, far forward
            and far from singular.
        law: Feedback law and its gains; None: `Resolved`, by which the disturbance changes the
            force by a fifth.
        disturbance: A `Disturbance`, or the bound of the 2-norm of a sinusoidal one [m/s²,
            rad/s²]; None: a current of 0.2 m/s on the hull and friction of the joints.
        contact: Kind of contact, also of a class of one's own; None: the surface is known. With a
            `SensedContact` the force is along its direction, and a part of `sensing` measures it.
        sensing: Parts between the robot's state and the controller, from the robot on.
        distance: Distance of the tip from the surface at the start [m].
        unknown_wall: Whether the wall is unknown, with a sensor that is assumed, as by `scenario
            --new --unknown-wall`; parts that are given are in the place of those.
        real_loop: Whether it is behind the robot's thrusters, too, as by `--real-loop`.
        name: Name of the scenario, of its files.

    Raises:
        InvalidParameter: An argument has no meaning, or does not go with the robot.
        RunFailed: The robot is too weak; the message has advice.
    """
    robot = sound_robot(robot)
    size = 6 + len(robot.uvms.joints)
    require(0.0 < distance < np.inf, "distance", distance, "positive")
    if isinstance(disturbance, float | int):
        disturbance = SinusoidalDisturbance(bound=float(disturbance))
    for key, value, base in (("surface", surface, Surface), ("law", law, AncillaryLaw),
                             ("disturbance", disturbance, Disturbance),
                             ("contact", contact, Contact)):
        require(value is None or isinstance(value, base), key, value,
                f"of the type {base.__name__}")
    if surface is not None:
        with within("surface"):
            surface = check_surface(surface)
    into, magnitude = _direction(force, surface)
    with within("disturbance"):
        axes = None if disturbance is None else disturbance.axes(size)
    anchor = np.zeros(3) if surface is None else surface.anchor
    at = anchor if place is None else place
    found = first_scenario(robot.uvms, magnitude, distance, Choices(
        into, vector("place", at, 3),
        None if posture is None else vector("posture", posture, size - 6), axes))

    if found.short:
        LOGGER.warning("limits.u of %s is that of an ideal wrench: thrusters.yaml and motors leave "
                       "less along %s against this disturbance", robot.name, ", ".join(found.short))

    # The file that the command writes, with the objects in the place of its numbers.
    shipped = robot.name in shipped_robots() and robot.folder == model_dir(robot.name)
    model = robot.name if shipped else str(robot.folder.resolve())
    path = FOLDER / "scenarios" / "made.yaml"
    found, text_of = press(robot, found, model, path, unknown=unknown_wall, real=real_loop)
    scenario = scenario_of(text_of(found), path)
    scenario.name, scenario.simulator.max_step_size = name, 0.0
    if surface is not None:
        scenario.surface = surface
    scenario.task = replace(
        scenario.task, force=np.concatenate([found.force, np.zeros(3)]), posture=found.posture,
        pose=np.concatenate([vector("place", at, 3), found.pose]))
    scenario.start = replace(scenario.start, q=found.posture)
    scenario.ancillary = law or scenario.ancillary
    scenario.disturbance = disturbance or scenario.disturbance
    scenario.contact, scenario.sensing = contact or scenario.contact, (
        list(sensing) or scenario.sensing)
    if not scenario.contact.takes_static_force(scenario.surface):
        scenario.limits.static_force = None
    check_values(scenario)
    return with_step(scenario, check_inputs(scenario, load_model(scenario, robot)))


def _direction(force: float | Sequence[float] | np.ndarray, surface: Surface | None
               ) -> tuple[np.ndarray | None, float]:
    """Returns the direction into the surface (3,), None if free, and the size of the force [N]."""
    normal = UnilateralPlane().normal if surface is None else surface.normal
    if isinstance(force, Real):
        size = float(force)
        require(0.0 < size < np.inf, "force", force, "positive")
        require(normal is not None, "force", force,
                f"a vector (3,) in Σ_I: a {type(surface).__name__} has no `normal`")
        return None if surface is None else -np.asarray(normal), size
    wanted = vector("force", force, 3)
    size = float(np.linalg.norm(wanted))
    require(size > 0.0, "force", force, "a vector that is not zero")
    return wanted / size, size
