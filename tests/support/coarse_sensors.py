"""Force sensors whose readings repeat themselves, with errors within the declared bounds."""

from dataclasses import dataclass, replace

import numpy as np
from pydrake.systems.framework import LeafSystem

import uvms_drake as uv
from uvms_drake.sensing.faults import ForceFault
from uvms_drake.sensing.force_sensor import ForceSensor
from uvms_drake.sensing.wrist_sensor import cut_noise

NEWTONS = (0.01, 0.2, 0.5)
"""Resolutions of a sensor with the shipped bound of 1.56 N on noise, tare and resolution [N]."""
SHARES = tuple(newtons / 1.5625 for newtons in NEWTONS)
"""The same over the bound."""


def coarse(sensor: ForceSensor, share: float) -> ForceSensor:
    """Returns a tared sensor with the same bound, of which its resolution is a share."""
    noise, m = np.asarray(sensor.noise, dtype=float), sensor.noise_multiple
    bound = 2.0 * m * noise + np.asarray(sensor.resolution, dtype=float)
    return replace(sensor, resolution=share * bound, noise=0.5 * (1.0 - share) * bound / m)


def with_coarse_sensor(scenario: uv.Scenario, share: float) -> uv.Scenario:
    """Returns the scenario with that sensor."""
    sensor, = scenario.sensing
    return replace(scenario, sensing=[coarse(sensor, share)])


@dataclass
class QuietForceSensor(ForceSensor):
    """A sensor whose copy has a share of the declared noise, for each component."""

    loudness: np.ndarray = 1.0

    def imperfection(self, seed):
        """Returns the errors of the copy of a seed."""
        off = super().imperfection(seed)
        noise = np.asarray(self.noise, dtype=float)
        return off._replace(noise=lambda k: cut_noise(
            np.asarray(self.loudness) * noise, self.noise_multiple, seed, k))


@dataclass
class RepeatedComponents(ForceFault):
    """The reading keeps components as long as they are no further off than the noise may be.

    Of a copy without noise in these components its errors are within those of the sensor.
    """

    components: tuple[int, ...] = (1,)
    allowed: np.ndarray = 0.75
    """Largest noise (6,) [N, N m]."""
    period: float = 0.01
    """Sampling period of the sensor [s]."""

    def assumption(self):
        """Returns None: it is part of the noise."""
        return None

    def faulty(self, true, frozen):
        """Is not used: the system below is."""
        raise NotImplementedError

    def add_to(self, builder, model, port, signals, seed):
        """Adds a `Repeater`."""
        repeater = builder.AddNamedSystem("repeater", Repeater(
            list(self.components), np.broadcast_to(self.allowed, 6), self.period))
        builder.Connect(port, repeater.get_input_port())
        signals["repeated"] = repeater.GetOutputPort("repeated")
        return repeater.GetOutputPort("force")


class Repeater(LeafSystem):
    """Keeps components of a vector while they differ by less than allowed; state: those kept."""

    def __init__(self, components, allowed, period):
        super().__init__()
        self._components, self._allowed = components, allowed
        port = self.DeclareVectorInputPort("true", 6)
        self.DeclareDiscreteState(np.full(6, np.nan))
        self.DeclareDiscreteState(1)

        def now(context):
            true, kept = port.Eval(context).copy(), context.get_discrete_state(0).value()
            same = np.zeros(6, dtype=bool)
            same[components] = np.abs(true - kept)[components] <= allowed[components]
            return np.where(same, kept, true), np.any(same)

        def keep(context, state):
            force, same = now(context)
            state.set_value(0, force)
            state.set_value(1, context.get_discrete_state(1).value() + same)

        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.5 * period, keep)
        inputs = {port.ticket(), self.xd_ticket()}
        self.DeclareVectorOutputPort(
            "force", 6, lambda context, output: output.SetFromVector(now(context)[0]), inputs)
        self.DeclareVectorOutputPort(
            "repeated", 1, lambda context, output: output.SetFromVector(
                context.get_discrete_state(1).value()), {self.xd_ticket()})
