"""The ancillary feedback of the kinematic model χ̇ = J(𝔮)ζ + w, as in the paper's simulation.

With 𝔢_y = y − ȳ of the extended task y = (χ, q), 𝔢 its χ part, and Euler angles compared modulo 2π:

* `resolved`, ζ = J_x(𝔮)⁻¹ [J_x(𝔮̄) ζ̄ − σ 𝔢_y], which leaves exactly 𝔢̇_y = −σ 𝔢_y + (w, 0);
* `transpose`, ζ = ζ̄ − σ J(𝔮̄)ᵀ 𝔢, the paper's, which leaves 𝔢̇ = (J(𝔮) − J(𝔮̄))ζ − σJ(𝔮̄)J(𝔮̄)ᵀ𝔢 + w
  and does not act on the arm's self-motion.
"""

from functools import partial

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort

from uvms_drake.common.errors import require
from uvms_drake.control.ancillary import AncillaryConfig, Resolved, is_lost, task_error
from uvms_drake.model.uvms_model import UvmsModel


def resolved_velocity(model: UvmsModel, config: np.ndarray, nominal_state: np.ndarray,
                      sigma: float) -> np.ndarray:
    """Returns ζ (6+n,) of the law `resolved`.

    Args:
        model: Supplies J_x.
        config: 𝔮 measured (6+n,).
        nominal_state: (𝔮̄, ζ̄) (2(6+n),).
        sigma: σ [1/s].
    """
    nominal_config, nominal_zeta = np.split(nominal_state, 2)
    error = task_error(model.task_pose(config), model.task_pose(nominal_config))
    velocity = model.task_jacobian(nominal_config) @ nominal_zeta
    return np.linalg.solve(model.task_jacobian(config), velocity - sigma * error)


def transpose_velocity(model: UvmsModel, config: np.ndarray, nominal_state: np.ndarray,
                       sigma: float, joints: bool = False) -> np.ndarray:
    """Returns ζ (6+n,) of the law `transpose`; arguments as above, `joints` as in `Transpose`."""
    nominal_config, nominal_zeta = np.split(nominal_state, 2)
    rows = slice(None) if joints else slice(0, 6)
    error = task_error(model.task_pose(config), model.task_pose(nominal_config))[rows]
    return nominal_zeta - sigma * model.task_jacobian(nominal_config)[rows].T @ error


class KinematicFeedback(LeafSystem):
    """Turns the nominal trajectory and the measured configuration into the velocity command ζ.

    .. pydrake_system::

        name: KinematicFeedback
        input_ports:
        - configuration
        - nominal_state
        output_ports:
        - zeta
        - lost

    - `configuration`: 𝔮 measured (6+n), in the paper's order.
    - `nominal_state`: (𝔮̄, ζ̄) (2(6+n)).
    - `zeta`: ζ (6+n) [m/s (3), rad/s (3+n)].
    - `lost` (1): 1 while the measured configuration is not finite, else 0.

    It has no state. In place of a measured configuration that is not finite the law takes the
    nominal one, so that the command is the plan's own, without feedback.

    Args:
        model: The controller's model of the robot.
        config: The law and its σ; k has no meaning here.
    """

    def __init__(self, model: UvmsModel, config: AncillaryConfig):
        super().__init__()
        require(bool(0.0 < config.sigma < np.inf), "sigma", config.sigma, "positive")
        self._law = (
            partial(resolved_velocity, model, sigma=config.sigma) if isinstance(config, Resolved)
            else partial(transpose_velocity, model, sigma=config.sigma, joints=config.joints))
        self._config_port = self.DeclareVectorInputPort("configuration", model.size)
        self._nominal_port = self.DeclareVectorInputPort("nominal_state", 2 * model.size)
        self.DeclareVectorOutputPort("zeta", model.size, self._calc_zeta)
        self.DeclareVectorOutputPort(
            "lost", 1, self._calc_lost, {self.input_port_ticket(self._config_port.get_index())})

    def _calc_zeta(self, context, output):
        config, nominal = self._config_port.Eval(context), self._nominal_port.Eval(context)
        output.SetFromVector(
            self._law(nominal[: len(config)] if is_lost(config) else config, nominal))

    def _calc_lost(self, context, output):
        output.SetFromVector([float(is_lost(self._config_port.Eval(context)))])

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, model: UvmsModel, config: AncillaryConfig, *,
                     nominal: LeafSystem, configuration: OutputPort | None = None,
                     name: str = "ancillary") -> "KinematicFeedback":
        """Adds the feedback and connects it to a system with a `NominalMpc`'s output ports.

        Args:
            builder: Where to add it.
            model: The controller's model.
            config: The law and its σ.
            nominal: Gives nominal_state.
            configuration: Gives 𝔮; left to the caller if None.
            name: Name of the system.
        """
        feedback = KinematicFeedback(model, config)
        builder.AddNamedSystem(name, feedback)
        builder.Connect(
            nominal.GetOutputPort("nominal_state"), feedback.GetInputPort("nominal_state"))
        if configuration is not None:
            builder.Connect(configuration, feedback.GetInputPort("configuration"))
        return feedback
