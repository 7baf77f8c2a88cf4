"""A robot that is to stay where it is, with a law and its observer but without an MPC."""

from dataclasses import dataclass

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    ConstantVectorSource,
    Demultiplexer,
    FirstOrderLowPassFilter,
    Multiplexer,
)

from uvms_drake.control.feedback.ancillary import AncillaryFeedback
from uvms_drake.control.feedback.disturbance_observer import add_observer
from uvms_drake.model.signals.sensor_actuator import VEHICLE_WRENCH, Part
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state

CONFIG = np.array([-1.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 1.0, 0.4, 0.2])
"""Away from any wall."""


@dataclass
class Lag(Part):
    """Thrusters with a lag, at first in equilibrium; joints without one."""

    time: float = 0.15

    def add_to(self, builder, model, port, signals, seed):
        n = model.num_joints
        parts, lag, both = (builder.AddNamedSystem(name, system) for name, system in (
            ("parts", Demultiplexer([6, n])), ("lag", FirstOrderLowPassFilter(self.time, 6)),
            ("both", Multiplexer([6, n]))))
        builder.Connect(port, parts.get_input_port())
        builder.Connect(parts.get_output_port(0), lag.get_input_port())
        builder.Connect(lag.get_output_port(), both.get_input_port(0))
        builder.Connect(parts.get_output_port(1), both.get_input_port(1))
        signals[VEHICLE_WRENCH] = lag.get_output_port()
        return both.get_output_port()


class Hovering:
    """A simulation of it, and its readings."""

    def __init__(self, model, law, *, bound=0.0, disturbance=None, limits=None, sensing=(),
                 actuation=(), faults=(), step=0.02):
        builder, self.signals = DiagramBuilder(), {}
        plant = builder.AddNamedSystem("uvms", make_uvms_plant(
            "girona500_arm5e", surface=None,
            disturbance=disturbance or ConstantDisturbance(bound=bound)))
        feedback = builder.AddNamedSystem("feedback", AncillaryFeedback(model, law, limits))
        self.nominal = np.concatenate([CONFIG, np.zeros(10)])
        for name, value in (("nominal_state", self.nominal), ("nominal_acceleration", np.zeros(10)),
                            ("nominal_input", np.zeros(10))):
            source = builder.AddSystem(ConstantVectorSource(value))
            builder.Connect(source.get_output_port(), feedback.GetInputPort(name))
        self.signals["state"] = measured = plant.GetOutputPort("state")
        self.signals["force"] = builder.AddSystem(
            ConstantVectorSource(np.zeros(6))).get_output_port()
        for part in sensing:
            measured = part.add_to(builder, model, measured, self.signals, 0)
        builder.Connect(measured, feedback.GetInputPort("state"))
        observer = add_observer(builder, model, law, feedback, state=measured)
        applied = exerted = feedback.GetOutputPort("tau")
        for part in actuation:
            applied = exerted = part.add_to(builder, model, applied, self.signals, 0)
        for part in faults:
            exerted = part.add_to(builder, model, exerted, self.signals, 0)
        builder.Connect(exerted, plant.GetInputPort("tau"))
        listeners = [feedback, observer] if observer else [feedback]
        if observer and actuation:
            builder.Connect(applied, observer.GetInputPort("applied"))
        if VEHICLE_WRENCH in self.signals:
            for listener in listeners:
                builder.Connect(self.signals[VEHICLE_WRENCH], listener.GetInputPort(VEHICLE_WRENCH))
        self.diagram = builder.Build()
        self._systems = {"uvms": plant, "feedback": feedback, "observer": observer}
        self._step = step
        self.simulator = self.simulate()
        self.context = self.simulator.get_mutable_context()
        set_state(plant, plant.GetMyMutableContextFromRoot(self.context), self.nominal)
        if self.diagram.HasSubsystemNamed("lag"):
            lag = self.diagram.GetSubsystemByName("lag")
            holds = model.inverse_dynamics(model.kinematics(CONFIG), np.zeros(10), np.zeros(10))
            lag.set_initial_output_value(
                lag.GetMyMutableContextFromRoot(self.context), holds[:6])
        self.simulator.Initialize()

    def simulate(self, *context):
        """Returns a simulator, of another context if there is one."""
        simulator = Simulator(self.diagram, *context)
        ApplySimulatorConfig(SimulatorConfig(
            integration_scheme="runge_kutta3", max_step_size=self._step, use_error_control=False,
            start_time=simulator.get_context().get_time()), simulator)
        return simulator

    def read(self, system, port, context=None):
        system = self._systems[system]
        return system.GetOutputPort(port).Eval(
            system.GetMyContextFromRoot(context or self.context)).copy()

    def every(self, period, end, read):
        """Returns the values of `read` at the ends of periods up to `end` [s]."""
        out = []
        for i in range(1, round(end / period) + 1):
            self.simulator.AdvanceTo(i * period)
            out.append(read())
        return np.array(out)
