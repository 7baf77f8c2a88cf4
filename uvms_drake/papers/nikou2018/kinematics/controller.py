"""Controller of the kinematics: nominal MPC and velocity feedback as one Diagram."""

from typing import Any

from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import PassThrough

from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.mpc.nominal_mpc import NominalMpc
from uvms_drake.control.ocp.solver import Solver
from uvms_drake.control.ocp.solvers import make_solver
from uvms_drake.papers.nikou2018.kinematics.feedback import KinematicFeedback
from uvms_drake.papers.nikou2018.kinematics.ocp import KinematicOcp


def make_kinematic_tube_mpc(ocp: KinematicOcp, law: AncillaryLaw,
                            solver: Solver[Any] | None = None) -> Diagram:
    """Returns the tube-based NMPC of the kinematic model, as a Diagram named "tube_mpc".

    ::

                          ┌─────────────┐ nominal_state
        configuration ─┬─▶│ nominal_mpc │──────┐
                       │  └─────────────┘ ┌────▼──────┐
                       └─────────────────▶│ ancillary │──▶ u
                                          └───────────┘

    .. pydrake_system::

        name: tube_mpc
        input_ports:
        - configuration
        - fault (optional)
        output_ports:
        - u
        - state_lost
        - nominal_state
        - nominal_input
        - plan
        - report
        - solve_seconds

    - `configuration`: 𝔮 measured (6+n), in the paper's order.
    - `u`: the velocity command ζ (6+n) [m/s (3), rad/s (3+n)].
    - `state_lost`: 1 while the measured 𝔮 is not finite and ζ is the plan's own, else 0 (1).
    - The others: see `NominalMpc`.

    Args:
        ocp: The problem that the nominal MPC solves; its model is the controller's.
        law: The feedback law and its σ.
        solver: Solver of the problem; that of its `MpcConfig` if None.
    """
    builder = DiagramBuilder()
    configuration = builder.AddNamedSystem("configuration", PassThrough(ocp.model.size))
    measured = configuration.get_output_port()
    mpc = NominalMpc.AddToBuilder(builder, solver or make_solver(ocp), state=measured)
    feedback = KinematicFeedback.AddToBuilder(
        builder, ocp.model, law, nominal=mpc, configuration=measured)

    builder.ExportInput(configuration.get_input_port(), "configuration")
    builder.ExportInput(mpc.GetInputPort("fault"), "fault")
    builder.ExportOutput(feedback.GetOutputPort("zeta"), "u")
    builder.ExportOutput(feedback.GetOutputPort("lost"), "state_lost")
    for name in ("nominal_state", "nominal_input", "plan", "report", "solve_seconds"):
        builder.ExportOutput(mpc.GetOutputPort(name), name)
    diagram = builder.Build()
    diagram.set_name("tube_mpc")
    return diagram
