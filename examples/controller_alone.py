"""The controller against a simulator of one's own: state in, τ out, no plant in the Diagram.

Here the other simulator is a fixed-step Runge-Kutta method on the prediction model; it could as
well be a socket to another program. The command is under a zero-order hold of 20 ms.
"""

import argparse

import numpy as np
from pydrake.systems.analysis import Simulator

import uvms_drake as uv

PERIOD = 0.02  # s


def main() -> None:
    """Swims to the wall and presses."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=6.0, help="simulated time [s]")
    arguments = parser.parse_args()
    scenario = uv.load_scenario("girona500_ideal")
    ocp = uv.make_ocp(scenario)
    model, state = ocp.model, uv.start_state(scenario, ocp)

    def rate(state: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Returns the rate of (𝔮, ζ) under τ [N, N m]."""
        config, zeta = np.split(state, 2)
        M = model.mass_matrix(model.kinematics(config))
        zeta_dot = model.drift(config, zeta) + np.linalg.solve(M, tau)
        return np.concatenate([uv.configuration_rate(config, zeta), zeta_dot])

    controller = uv.make_tube_mpc(ocp, scenario.ancillary)
    simulator = Simulator(controller)
    context = simulator.get_mutable_context()
    measured = controller.GetInputPort("state")
    measured.FixValue(context, state)
    simulator.Initialize()  # Makes the first plan.
    for sample in range(round(arguments.duration / PERIOD)):
        tau = controller.GetOutputPort("tau").Eval(context)
        half = state + 0.5 * PERIOD * rate(state, tau)
        state = state + PERIOD * rate(half, tau)
        measured.FixValue(context, state)
        simulator.AdvanceTo((sample + 1) * PERIOD)
    chi = model.task_pose(state[: model.size])[:6]
    force = model.surface.force(chi, np.zeros(6))[0]
    print(f"force at the end: {force:.2f} N, desired {scenario.task.force[0]:.2f} N")


if __name__ == "__main__":
    main()
