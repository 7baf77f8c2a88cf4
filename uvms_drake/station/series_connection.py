"""Series connection of parts between plant and controller."""

from dataclasses import fields

from pydrake.systems.framework import DiagramBuilder, OutputPort

from uvms_drake.common.errors import require, within
from uvms_drake.model.signals.sensor_actuator import Part, Signals
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.station.record import Record

RESERVED = {"plan", "report", "solve_seconds", "tube_alarm",
            *(field.name for field in fields(Record))}
"""Reserved names of signals: a record's own fields and other outputs."""


def add_chain(builder: DiagramBuilder, model: UvmsModel, port: OutputPort, signals: Signals,
              parts: dict[str, Part], seed: int) -> OutputPort:
    """Adds parts in series and returns the output port of the last one.

    The names of their systems begin with their keys.

    Args:
        builder: Builder to add to.
        model: The controller's model.
        port: Output port that feeds the first part.
        signals: Signals that the parts may read and extend.
        parts: The parts by their keys in the scenario.
        seed: Seed of their random numbers.
    """
    for key, part in parts.items():
        size, known, before = port.size(), len(signals), len(builder.GetSystems())
        with within(key):
            port = part.add_to(builder, model, port, signals, seed)
            require(isinstance(port, OutputPort), "add_to", port, "the output port to go on from")
            require(port.size() == size, "size", port.size(), f"{size}, as before it")
            added = list(signals)[known:]
            require(not set(added) & RESERVED, "signals", added,
                    f"called otherwise than {', '.join(sorted(RESERVED))}")
        for system in builder.GetSystems()[before:]:
            system.set_name(f"{key}.{system.get_name()}")
    return port
