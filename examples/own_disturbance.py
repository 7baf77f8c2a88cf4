"""A LeafSystem of one's own in the closed loop: waves that fade with depth push the vehicle.

`make_uvms_plant(disturbance=None)` leaves an input port for what is added to the acceleration. The
waves here push along x and z with the orbital motion of the water, exp(−kz) weaker with depth z,
and so at most by their amplitude: the bound d̃ that the tube is declared for holds by construction.
"""

import argparse

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from uvms_drake.control.tube_mpc import make_tube_mpc
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state
from uvms_drake.station.motions import make_ocp
from uvms_drake.station.problem import start_state
from uvms_drake.station.scenario import load_scenario

GRAVITY = 9.81  # m/s²
SURFACE = -3.0  # z of the water's surface [m]: the task is 3 m deep
PERIOD = 4.0  # s
AMPLITUDE = 0.1  # m/s², of the vehicle's acceleration at the surface


class Waves(LeafSystem):
    """Acceleration of a vehicle in deep-water waves that travel north.

    .. pydrake_system::

        name: Waves
        input_ports:
        - state
        output_ports:
        - disturbance

    - `state` (2(6+n)): (𝔮, ζ) in the paper's order.
    - `disturbance` (6+n): d in the paper's order [m/s², rad/s²]; the vehicle's part in body axes.

    It has no state. With ω² = gk, d = A exp(−k depth) (cos(kx − ωt), 0, sin(kx − ωt)) in World.
    """

    def __init__(self, size: int):
        super().__init__()
        self._omega = 2.0 * np.pi / PERIOD
        self._k = self._omega**2 / GRAVITY
        self._state_port = self.DeclareVectorInputPort("state", 2 * size)
        self.DeclareVectorOutputPort("disturbance", size, self._calc_disturbance)

    def _calc_disturbance(self, context, output):
        x, _, z, _, pitch, yaw = self._state_port.Eval(context)[:6]
        phase = self._k * x - self._omega * context.get_time()
        size = AMPLITUDE * np.exp(-self._k * max(z - SURFACE, 0.0))
        north, down = size * np.cos(phase), size * np.sin(phase)
        along = np.cos(yaw) * north  # Roll is small: it is left out of the way to body axes.
        d = np.zeros(output.size())
        d[:3] = (np.cos(pitch) * along - np.sin(pitch) * down, -np.sin(yaw) * north,
                 np.sin(pitch) * along + np.cos(pitch) * down)
        output.SetFromVector(d)


def main() -> None:
    """Presses on the wall below the waves."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=12.0, help="simulated time [s]")
    arguments = parser.parse_args()
    scenario = load_scenario("girona500_contact")

    builder, ocp = DiagramBuilder(), make_ocp(scenario)
    uvms = builder.AddNamedSystem("uvms", make_uvms_plant(
        model=scenario.model, surface=scenario.surface, disturbance=None))
    controller = builder.AddNamedSystem("tube_mpc", make_tube_mpc(ocp, scenario.ancillary))
    waves = builder.AddNamedSystem("waves", Waves(ocp.model.size))
    builder.Connect(uvms.GetOutputPort("state"), controller.GetInputPort("state"))
    builder.Connect(controller.GetOutputPort("tau"), uvms.GetInputPort("tau"))
    builder.Connect(uvms.GetOutputPort("state"), waves.GetInputPort("state"))
    builder.Connect(waves.GetOutputPort("disturbance"), uvms.GetInputPort("disturbance"))
    diagram = builder.Build()

    simulator = Simulator(diagram)
    simulator.get_mutable_integrator().set_maximum_step_size(0.01)
    context = uvms.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    set_state(uvms, context, start_state(scenario, ocp))
    largest = 0.0
    print(f"{'t [s]':>6}{'force [N]':>11}{'surge [m/s²]':>14}{'heave [m/s²]':>14}")
    for time in np.arange(0.0, arguments.duration + 1e-9, 1.0):
        simulator.AdvanceTo(time)
        force = uvms.GetOutputPort("force").Eval(context)[0]
        d = uvms.GetOutputPort("disturbance").Eval(context)
        largest = max(largest, np.linalg.norm(d))
        print(f"{time:6.1f}{force:11.3f}{d[0]:14.4f}{d[2]:14.4f}")
    print(f"largest disturbance: {largest:.4f}, bound {AMPLITUDE:.4f}")


if __name__ == "__main__":
    main()
