"""The ancillary feedback: keeps the real state in a tube about the nominal one.

Errors are 𝔢_y = y − ȳ of the extended task y = (χ, q), 𝔢 of its χ part, and 𝔷 = ζ − ζ̄; Euler
angles are compared modulo 2π. Two laws:

* `resolved` (resolved acceleration on the extended task). With J_x = [J; 0 I],

      ζ_ref = J_x(𝔮)⁻¹ [J_x(𝔮̄) ζ̄ − σ 𝔢_y],   𝔯 = ζ − ζ_ref,   u = ζ̇_ref − f(𝔮, ζ) − k 𝔯,

  which leaves exactly 𝔢̇_y = −σ 𝔢_y + J_x(𝔮) 𝔯 and 𝔯̇ = −k 𝔯 + d: a cascade without f in it, so a
  stiff surface costs nothing, and ‖𝔢_y‖ ≤ J̄ d̃/(kσ), ‖𝔯‖ ≤ d̃/k for every k, σ > 0.

* `transpose`, the law of Nikou, Verginis and Dimarogonas (2018) as its proof needs it,

      u = ū − k 𝔷 − k σ J(𝔮̄)ᵀ 𝔢.

  The printed (eq:kappa_law) multiplies a (6+n)×6 matrix with a (6+n)-vector; the proof uses
  u − ū = −k 𝔯 with 𝔯 = 𝔷 + σJ(𝔮̄)ᵀ𝔢, which is this. It does not act on the arm's self-motion.
"""

from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort

from uvms_drake.errors import require
from uvms_drake.model.euler import wrap_angle
from uvms_drake.model.uvms_model import UvmsModel


@dataclass
class Resolved:
    """Gains of the law `resolved`."""

    k: float = 20.0
    """[1/s]."""
    sigma: float = 5.0
    """σ [1/s]."""


@dataclass
class Transpose:
    """Gains of the law `transpose`."""

    k: float = 20.0
    """[1/s]."""
    sigma: float = 1.0
    """σ [1/s]."""


AncillaryConfig = Resolved | Transpose


def resolved_input(model: UvmsModel, state: np.ndarray, nominal_state: np.ndarray,
                   nominal_acceleration: np.ndarray, k: float, sigma: float) -> np.ndarray:
    """Returns u (6+n,) of the law `resolved`.

    Args:
        model: The prediction model; it supplies J_x, J̇_x and f.
        state: (𝔮, ζ) measured (2(6+n),).
        nominal_state: (𝔮̄, ζ̄) (2(6+n),).
        nominal_acceleration: ζ̄̇ (6+n,).
        k: Velocity gain [1/s].
        sigma: σ, task gain [1/s].
    """
    config, zeta = np.split(state, 2)
    nominal_config, nominal_zeta = np.split(nominal_state, 2)
    (y, y_nominal), (J, J_nominal), (J_dot, J_dot_nominal) = model.task_motion(
        np.stack([config, nominal_config]), np.stack([zeta, nominal_zeta]))
    velocity = J_nominal @ nominal_zeta
    acceleration = J_dot_nominal @ nominal_zeta + J_nominal @ nominal_acceleration
    error = task_error(y, y_nominal)
    zeta_ref = np.linalg.solve(J, velocity - sigma * error)
    error_rate = J @ zeta - velocity
    zeta_ref_dot = np.linalg.solve(J, acceleration - sigma * error_rate - J_dot @ zeta_ref)
    return zeta_ref_dot - model.drift(config, zeta) - k * (zeta - zeta_ref)


def transpose_input(model: UvmsModel, state: np.ndarray, nominal_state: np.ndarray,
                    nominal_input: np.ndarray, k: float, sigma: float) -> np.ndarray:
    """Returns u (6+n,) of the law `transpose`; `nominal_input` is ū (6+n,), the rest as above."""
    config, zeta = np.split(state, 2)
    nominal_config, nominal_zeta = np.split(nominal_state, 2)
    nominal = model.kinematics(nominal_config)
    error = task_error(model.kinematics(config).chi, nominal.chi)
    return nominal_input - k * (zeta - nominal_zeta) - k * sigma * nominal.J_chi.T @ error


def task_error(y: np.ndarray, y_nominal: np.ndarray) -> np.ndarray:
    """Returns y − ȳ (..., 6 or 6+n) with the differences of Euler angles in [−π, π)."""
    error = y - y_nominal
    error[..., 3:6] = wrap_angle(error[..., 3:6])
    return error


class AncillaryFeedback(LeafSystem):
    """Turns nominal trajectory and measured state into the acceleration command u.

    .. pydrake_system::

        name: AncillaryFeedback
        input_ports:
        - state
        - nominal_state
        - nominal_acceleration
        - nominal_input
        output_ports:
        - u

    - `state`: (𝔮, ζ) measured (2(6+n)), in the paper's order.
    - `nominal_state`: (𝔮̄, ζ̄) (2(6+n)).
    - `nominal_acceleration`: ζ̄̇ (6+n); read by `resolved` only.
    - `nominal_input`: ū (6+n); read by `transpose` only.
    - `u`: generalised acceleration command (6+n) [m/s² (3), rad/s² (3+n)].

    It has no state.

    Args:
        model: The controller's model of the robot and of the surface.
        config: The law and its gains.
    """

    def __init__(self, model: UvmsModel, config: AncillaryConfig):
        super().__init__()
        for key in ("k", "sigma"):
            value = getattr(config, key)
            require(bool(0.0 < value < np.inf), key, value, "positive")
        self._model = model
        self._config = config
        self._state_port = self.DeclareVectorInputPort("state", 2 * model.size)
        self._nominal_state_port = self.DeclareVectorInputPort("nominal_state", 2 * model.size)
        self._acceleration_port = self.DeclareVectorInputPort("nominal_acceleration", model.size)
        self._input_port = self.DeclareVectorInputPort("nominal_input", model.size)
        self.DeclareVectorOutputPort("u", model.size, self._calc_u)

    def _calc_u(self, context, output):
        state = self._state_port.Eval(context)
        nominal_state = self._nominal_state_port.Eval(context)
        gains = self._config.k, self._config.sigma
        if isinstance(self._config, Resolved):
            acceleration = self._acceleration_port.Eval(context)
            u = resolved_input(self._model, state, nominal_state, acceleration, *gains)
        else:
            u = transpose_input(
                self._model, state, nominal_state, self._input_port.Eval(context), *gains)
        output.SetFromVector(u)

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, model: UvmsModel, config: AncillaryConfig, *,
                     nominal: LeafSystem, state: OutputPort | None = None,
                     name: str = "ancillary") -> "AncillaryFeedback":
        """Adds the feedback and connects it to a system with a `NominalMpc`'s output ports.

        Args:
            builder: Where to add it.
            model: The controller's model.
            config: The law and its gains.
            nominal: Gives nominal_state, nominal_acceleration and nominal_input.
            state: Gives (𝔮, ζ); left to the caller if None.
            name: Name of the system.
        """
        feedback = AncillaryFeedback(model, config)
        builder.AddNamedSystem(name, feedback)
        for port in ("nominal_state", "nominal_acceleration", "nominal_input"):
            builder.Connect(nominal.GetOutputPort(port), feedback.GetInputPort(port))
        if state is not None:
            builder.Connect(state, feedback.GetInputPort("state"))
        return feedback
