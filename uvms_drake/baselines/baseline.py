"""A baseline controller: approach, laws and a limit in one Diagram."""

from collections.abc import Callable

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import Adder, PassThrough

from uvms_drake.baselines.admittance import Admittance
from uvms_drake.baselines.approach import Approach
from uvms_drake.baselines.compensation import Compensation, Gravity
from uvms_drake.baselines.force_feedforward import ForceFeedforward
from uvms_drake.baselines.gains import RobotGains
from uvms_drake.baselines.impedance import Impedance
from uvms_drake.baselines.law import Law, LawSystem
from uvms_drake.baselines.measured import Measurement, PressTask
from uvms_drake.baselines.prescribed_performance import PrescribedPerformance
from uvms_drake.baselines.sliding_mode import Coupled, DecoupledArm, DecoupledVehicle
from uvms_drake.baselines.vehicle_hold import VehicleHold
from uvms_drake.common.errors import require
from uvms_drake.common.wiring import added, output_of
from uvms_drake.model.uvms_model import UvmsModel

Parts = dict[str, Law]


def _shared(gains: RobotGains) -> Parts:
    return {"hold": VehicleHold(gains.hold), "compensation": Compensation(),
            "feedforward": ForceFeedforward()}


BASELINES: dict[str, Callable[[RobotGains], Parts]] = {
    "impedance": lambda gains: {
        "law": Impedance(gains.impedance), **_shared(gains)},
    "admittance": lambda gains: {
        "law": Admittance(gains.admittance, len(gains.largest) - 6), **_shared(gains)},
    "sliding_decoupled": lambda gains: {
        "law": DecoupledArm(gains.decoupled), "hold": DecoupledVehicle(gains.decoupled),
        "compensation": Compensation(), "feedforward": ForceFeedforward()},
    "sliding_coupled": lambda gains: {
        "law": Coupled(gains.coupled), "compensation": Compensation()},
    "prescribed_performance": lambda gains: {
        "law": PrescribedPerformance(gains.performance, len(gains.largest)),
        "feedforward": ForceFeedforward(joints=True)},
    "prescribed_performance_gravity": lambda gains: {
        "law": PrescribedPerformance(gains.performance, len(gains.largest)), "gravity": Gravity(),
        "feedforward": ForceFeedforward(joints=True)},
}
"""Laws whose sum is the command of a baseline, by the baseline's name."""


def make_baseline(model: UvmsModel, task: PressTask, laws: Parts, gains: RobotGains) -> Diagram:
    """Returns the controller of a press by given laws, as a Diagram named "baseline".

    ::

        force_measured, state, desired_force, place ─▶ approach ─reference┐
        state, force_measured ─────────────────────────▶ measurement ◀────┘
                                     measured ┌───────────────┘
                                              ├─▶ law          ─┐
                                              ├─▶ hold         ─┼─(+)─▶ limit ─▶ tau
                                              └─▶ compensation ─┘

    .. pydrake_system::

        name: baseline
        input_ports:
        - state
        - force_measured
        - desired_force (optional)
        - place (optional)
        output_ports:
        - tau
        - input_limited
        - reference
        - memory

    - `state`: (𝔮, ζ) (2(6+n)) measured; `force_measured`: 𝔉_s (6) [N, N m].
    - `desired_force`, `place`: see `Approach`.
    - `tau`: τ (6+n) [N, N m]; `input_limited` (1): 1 while the limit cuts it.
    - `reference` (9): see `Reference`.
    - `memory` (m): states of the law named "law".

    Args:
        model: The controller's model; its contact is not used.
        task: The task.
        laws: Laws by name, whose sum is the command; one is "law".
        gains: Parameters of approach and limit.
    """
    require("law" in laws, "laws", sorted(laws), "laws by name, one of them 'law'")
    # Measurement and reference, then the laws and the limit of their sum.
    builder = DiagramBuilder()
    state = builder.AddNamedSystem("state", PassThrough(2 * model.size))
    force = builder.AddNamedSystem("force_measured", PassThrough(6))
    approach = Approach.AddToBuilder(
        builder, model, task, gains.approach, state=state.get_output_port(),
        force_measured=force.get_output_port())
    measurement = Measurement.AddToBuilder(
        builder, model, task, state=state.get_output_port(),
        force_measured=force.get_output_port(), reference=approach.get_output_port())
    total = builder.AddNamedSystem("sum", Adder(len(laws), model.size))
    systems = {name: LawSystem.AddToBuilder(
        builder, model, law, measured=measurement.get_output_port(), name=name)
        for name, law in laws.items()}
    for i, system in enumerate(systems.values()):
        builder.Connect(system.GetOutputPort("tau"), total.get_input_port(i))
    limit = TorqueLimit.AddToBuilder(builder, gains.largest, tau=total.get_output_port())
    for system in systems.values():
        builder.Connect(limit.GetOutputPort("limited"), system.GetInputPort("limited"))

    builder.ExportInput(state.get_input_port(), "state")
    builder.ExportInput(force.get_input_port(), "force_measured")
    for name in ("desired_force", "place"):
        builder.ExportInput(approach.GetInputPort(name), name)
    builder.ExportOutput(limit.GetOutputPort("tau"), "tau")
    builder.ExportOutput(limit.GetOutputPort("limited"), "input_limited")
    builder.ExportOutput(approach.get_output_port(), "reference")
    builder.ExportOutput(systems["law"].GetOutputPort("memory"), "memory")
    diagram = builder.Build()
    diagram.set_name("baseline")
    return diagram


class TorqueLimit(LeafSystem):
    """Clips τ at the actuators' limits, and tells the integrals of it.

    .. pydrake_system::

        name: TorqueLimit
        input_ports:
        - tau
        output_ports:
        - tau
        - limited

    - `tau` (6+n) [N, N m]: before and after; `limited` (1): 1 while they differ.

    It has no state.

    Args:
        largest: Largest |τᵢ| (6+n,) [N, N m]; zero on an axis that nothing drives.
    """

    def __init__(self, largest: np.ndarray):
        super().__init__()
        require(bool(np.all(largest >= 0.0)), "largest", largest, "positive, or 0 if not driven")
        most = np.where(largest > 0.0, largest, np.inf)
        port = self.DeclareVectorInputPort("tau", len(largest))
        output_of(self, "tau", len(largest),
                  lambda context: np.clip(port.Eval(context), -largest, largest), {port.ticket()})
        output_of(self, "limited", 1,
                  lambda context: [float(np.any(np.abs(port.Eval(context)) > most))],
                  {port.ticket()})

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, largest: np.ndarray, *, tau: OutputPort,
                     name: str = "limit") -> "TorqueLimit":
        """Adds the limit and connects it; the arguments are its constructor's and its input."""
        return added(builder, name, TorqueLimit(largest), tau=tau)
