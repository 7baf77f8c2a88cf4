"""The robot as it is simulated, in the equations of the controller's model."""

from pydrake.multibody.plant import MultibodyPlant

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.surface.law import Surface
from uvms_drake.plant.model_error import ModelError, add_simulated_uvms


def model_with_error(model: str, surface: Surface, error: ModelError | None) -> ContactModel:
    """Returns the model of a robot whose parameters are multiplied, if at all."""
    plant = MultibodyPlant(time_step=0.1)
    uvms = add_simulated_uvms(plant, model, error)
    plant.Finalize()
    return ContactModel(uvms, surface)
