"""What an error of the model amounts to: a disturbance, measured along a run and held against d̃.

The plant does ζ̇ = M⁻¹(τ − n) + d, the controller believes M̂⁻¹(τ − n̂), n the generalised force at
rest of ζ. The difference without d is what the error adds to d: that is what the tube is about.
"""

import numpy as np

from uvms_drake.model.contact import make_surface_law
from uvms_drake.model.model_error import ModelError
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.record import Record


def induced_disturbance(record: Record) -> np.ndarray:
    """Returns (M⁻¹(τ − n) − M̂⁻¹(τ − n̂)) (T, 6+n) [m/s², rad/s²] at the logged samples.

    The water is taken to be still.
    """
    error = record.scenario.model_error
    if error.size == 0.0:
        return np.zeros_like(record.u)
    return _acceleration(record, error) - _acceleration(record, None)


def _acceleration(record: Record, error: ModelError | None) -> np.ndarray:
    scenario = record.scenario
    model = UvmsModel.load(scenario.model, make_surface_law(scenario.surface), error)
    kinematics = model.kinematics(record.config)
    bias = model.inverse_dynamics(kinematics, record.zeta, np.zeros_like(record.zeta))
    return np.linalg.solve(model.mass_matrix(kinematics), (record.tau - bias)[..., None])[..., 0]
