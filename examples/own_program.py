"""The MPC's own `MathematicalProgram`: a cost and a constraint are added with Drake's calls.

`uv.OcpProgram.at(ocp, start)` is the whole nonlinear problem, with variables `y[k]`, `zeta[k]`
and `zeta_dot[k]` of every stage k. It is solved with SNOPT, once by hand and then at every sample
of the closed loop, which takes SNOPT a second each; the structured solver, which cannot know what
is added, takes milliseconds.
"""

import argparse

import numpy as np
from pydrake.solvers import SnoptSolver
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from pydrake.systems.framework import DiagramBuilder

import uvms_drake as uv

ELBOW = 7  # index of the second joint in ζ
FASTEST = 0.05  # rad/s


def add_slow_elbow(program: uv.OcpProgram) -> None:
    """Adds a largest speed of the second joint, and a cost of its acceleration."""
    for zeta in program.zeta[1:]:  # The first one is given.
        program.AddLinearConstraint(zeta[ELBOW], -FASTEST, FASTEST)
    elbow = program.zeta_dot[:, ELBOW]
    program.AddQuadraticCost(0.1 * np.eye(len(elbow)), np.zeros(len(elbow)), elbow)


def main() -> None:
    """Solves one program, then presses on the wall with it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--duration", type=float, default=6.0, help="simulated time [s]")
    arguments = parser.parse_args()
    scenario = uv.with_step(uv.load_scenario("girona500_ideal", ["mpc.horizon=6"]))
    ocp = uv.make_ocp(scenario)

    # One program, by hand.
    program = uv.OcpProgram.at(ocp, uv.start_state(scenario, ocp))
    without = program.plan(SnoptSolver().Solve(program))
    add_slow_elbow(program)
    plan = program.plan(SnoptSolver().Solve(program))
    print(f"{program.num_vars()} variables, {len(program.GetAllConstraints())} constraints")
    for name, each in (("without", without), ("with", plan)):
        print(f"{name} the constraint: the second joint is planned to turn at up to "
              f"{np.max(np.abs(each.zeta[:, ELBOW])):.3f} rad/s")

    # The closed loop, which makes such a program at every sample.
    solver = uv.make_solver(ocp, "snopt", extend=add_slow_elbow)
    builder = DiagramBuilder()
    uvms = builder.AddSystem(uv.make_plant(scenario))
    controller = builder.AddSystem(uv.make_tube_mpc(ocp, scenario.ancillary, solver=solver))
    builder.Connect(uvms.GetOutputPort("state"), controller.GetInputPort("state"))
    builder.Connect(controller.GetOutputPort("tau"), uvms.GetInputPort("tau"))
    simulator = Simulator(builder.Build())
    ApplySimulatorConfig(scenario.simulator, simulator)
    root, fastest = simulator.get_context(), 0.0
    for time in np.arange(0.0, arguments.duration + 1e-9, ocp.time_step):
        simulator.AdvanceTo(time)
        nominal = controller.GetOutputPort("nominal_state").Eval(
            controller.GetMyContextFromRoot(root))
        fastest = max(fastest, abs(nominal[ocp.model.size + ELBOW]))
    force = uvms.GetOutputPort("force").Eval(uvms.GetMyContextFromRoot(root))
    print(f"in the loop it turns at up to {fastest:.3f} rad/s")
    print(f"force at the end: {force[0]:.2f} N, desired {scenario.task.force[0]:.2f} N")


if __name__ == "__main__":
    main()
