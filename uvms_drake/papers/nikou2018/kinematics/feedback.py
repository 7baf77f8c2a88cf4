"""Ancillary feedback of the kinematic model χ̇ = J(𝔮)ζ + w, as in the paper's simulation."""

import numpy as np
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem, OutputPort

from uvms_drake.common.finite import is_finite
from uvms_drake.common.wiring import added, output_of
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.papers.nikou2018.kinematics.laws import velocity_law


class KinematicFeedback(LeafSystem):
    """Ancillary law from nominal trajectory and measured configuration to the velocity command ζ.

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

    It has no state. A measured configuration that is not finite is replaced by the nominal one, so
    that the command is the plan's own, without feedback.

    Args:
        model: The controller's model of the robot.
        law: The law and its σ; k is not read.
    """

    def __init__(self, model: UvmsModel, law: AncillaryLaw):
        super().__init__()
        law.check()
        self._velocity = velocity_law(law).velocity
        self._model, self._law = model, law
        self._configuration_port = self.DeclareVectorInputPort("configuration", model.size)
        self._nominal_port = self.DeclareVectorInputPort("nominal_state", 2 * model.size)
        output_of(self, "zeta", model.size, self._zeta, {self.all_input_ports_ticket()})
        output_of(self, "lost", 1, lambda c: [not is_finite(self._configuration_port.Eval(c))], {
            self.input_port_ticket(self._configuration_port.get_index())})

    def _zeta(self, context: Context) -> np.ndarray:
        measured, nominal = self._configuration_port.Eval(context), self._nominal_port.Eval(context)
        if not is_finite(measured):
            measured = nominal[: self._model.size]
        return self._velocity(self._law, self._model, measured, nominal)

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, model: UvmsModel, law: AncillaryLaw, *,
                     nominal: LeafSystem, configuration: OutputPort | None = None,
                     name: str = "ancillary") -> "KinematicFeedback":
        """Adds the feedback and connects it to a system with a `NominalMpc`'s output ports.

        Args:
            builder: Builder of the Diagram.
            model: The controller's model.
            law: The law and its σ.
            nominal: Gives nominal_state.
            configuration: Gives 𝔮; left to the caller if None.
            name: Name of the system.
        """
        return added(builder, name, KinematicFeedback(model, law), configuration=configuration,
                     nominal_state=nominal.GetOutputPort("nominal_state"))
