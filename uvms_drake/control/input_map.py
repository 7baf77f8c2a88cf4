"""From the paper's input to forces: τ = M(𝔮) 𝔲.

𝔲 of (eq:dynamics) is a generalised acceleration: f carries M⁻¹ inside, 𝔲 stands beside it. What
goes to thrusters and joints is τ = M(𝔮) 𝔲, with the full inertia including added mass.
"""

from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort

from uvms_drake.model.uvms_model import UvmsModel


class InputMap(LeafSystem):
    """Multiplies the acceleration command with the controller's mass matrix.

    .. pydrake_system::

        name: InputMap
        input_ports:
        - state
        - u
        output_ports:
        - tau

    - `state`: (𝔮, ζ) measured (2(6+n)), in the paper's order.
    - `u`: 𝔲 (6+n) [m/s² (3), rad/s² (3+n)].
    - `tau`: τ (6+n): wrench on the vehicle in body axes and joint torques [N (3), N m (3+n)].

    It has no state.

    Args:
        model: The controller's model of the robot.
    """

    def __init__(self, model: UvmsModel):
        super().__init__()
        self._model = model
        self._state_port = self.DeclareVectorInputPort("state", 2 * model.size)
        self._u_port = self.DeclareVectorInputPort("u", model.size)
        self.DeclareVectorOutputPort("tau", model.size, self._calc_tau)

    def _calc_tau(self, context, output):
        config = self._state_port.Eval(context)[: self._model.size]
        M = self._model.mass_matrix(self._model.kinematics(config))
        output.SetFromVector(M @ self._u_port.Eval(context))

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, model: UvmsModel, *, state: OutputPort,
                     u: OutputPort, name: str = "input_map") -> "InputMap":
        """Adds the map and connects its inputs."""
        system = InputMap(model)
        builder.AddNamedSystem(name, system)
        builder.Connect(state, system.GetInputPort("state"))
        builder.Connect(u, system.GetInputPort("u"))
        return system
