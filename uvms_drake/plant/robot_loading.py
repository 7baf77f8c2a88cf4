"""The robot of a scenario, refused unless controller and plant can both be it."""

from uvms_drake.common.errors import InvalidFile, InvalidParameter
from uvms_drake.model.robot import Robot
from uvms_drake.model.robot_check import robot_complaints
from uvms_drake.plant.model_check import model_complaints


def complaints_about(robot: Robot) -> list[InvalidParameter]:
    """Returns the complaints about a robot whose files can be read; empty if it is sound."""
    return robot_complaints(robot) or model_complaints(robot.uvms)


def sound_robot(model: Robot | str) -> Robot:
    """Returns a robot, given itself, the name of a shipped one, or its folder.

    Raises:
        InvalidParameter: Its files cannot be used, or a certificate of it would be worth nothing.
    """
    robot = model if isinstance(model, Robot) else Robot.load(model)
    if complaints := complaints_about(robot):
        raise InvalidFile([str(complaint) for complaint in complaints])
    return robot
