"""A loop in plain Python: measure, step, send. Replace the three functions by those of your robot.

Here they are a simulator of one's own: a Runge-Kutta step of the model, with a wall that is a
spring. The controller does not know the wall; it gets the force of a wrist sensor.
"""

import argparse

import numpy as np

import uvms_drake as uv

WALL, STIFFNESS = 0.0, 700.0  # m, N/m; the controller knows neither


def main() -> None:
    """Swims to the wall and presses."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=10.0, help="simulated time [s]")
    duration, rng = parser.parse_args().duration, np.random.default_rng(0)
    scenario = uv.load_scenario("girona500_contact")
    controller = uv.Controller(scenario, period=0.01)
    model, state = controller.model, np.append(scenario.start.config, np.zeros(10))

    def touch(state: np.ndarray) -> np.ndarray:
        """Returns the force on the wall (6,) [N, N m]."""
        depth = model.task_pose(state[:10])[0] - WALL
        return np.append(STIFFNESS * max(depth, 0.0), np.zeros(5))

    def rate(state: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Returns the rate of (𝔮, ζ) under τ [N, N m]."""
        config, zeta = np.split(state, 2)
        u = np.linalg.solve(model.mass_matrix(model.kinematics(config)), tau)
        drift = model.drift(config, zeta, touch(state))
        return np.append(uv.configuration_rate(config, zeta), drift + u)

    controller.reset(state)  # Seconds: the first plan.
    for tick in range(round(duration / controller.period)):
        measured = touch(state) + 0.02 * rng.standard_normal(6)
        command = controller.step(tick * controller.period, state, measured)
        for alarm in command.alarms:
            print(f"t = {command.time:.2f} s, {command.mode}: {alarm}")
        for _ in range(2):
            half, h = state + 0.0025 * rate(state, command.tau), 0.005
            state = state + h * rate(half, command.tau)
    print(f"force at the end: {touch(state)[0]:.2f} N, desired {scenario.task.force[0]:.2f} N")


if __name__ == "__main__":
    main()
