"""The robot of a scenario, refused unless controller and plant can both be it."""

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.robot_check import robot_complaints
from uvms_drake.model.uvms import Uvms, model_dir
from uvms_drake.model.uvms_model import read_uvms
from uvms_drake.plant.model_check import model_complaints


def complaints_about(uvms: Uvms, model: str) -> list[InvalidParameter]:
    """Returns what is wrong with a robot, given the name of a shipped one or its folder.

    Args:
        uvms: The robot, alone in a finalized plant that is continuous.
        model: What it was read from.
    """
    return robot_complaints(uvms, model_dir(model)) or model_complaints(uvms)


def sound_robot(model: str) -> Uvms:
    """Returns a robot in a plant of its own.

    Raises:
        InvalidParameter: Its files cannot be used, or a certificate of it would be worth nothing.
    """
    uvms = read_uvms(model)
    for complaint in complaints_about(uvms, model):
        raise complaint
    return uvms
