"""The robot as it is simulated, in the equations of the controller's model."""

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.surface.law import Surface
from uvms_drake.plant.model_error import ModelError, simulated_uvms


def model_with_error(model: str, surface: Surface, error: ModelError | None) -> ContactModel:
    """Returns the model of a robot whose parameters are multiplied, if at all."""
    return ContactModel(simulated_uvms(model, error), surface)
