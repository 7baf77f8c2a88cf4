"""Wiring of a system in a Diagram, for every system's `AddToBuilder`."""

from typing import TypeVar

from pydrake.systems.framework import DiagramBuilder, OutputPort, System

S = TypeVar("S", bound=System)


def added(builder: DiagramBuilder, name: str, system: S, **sources: OutputPort | None) -> S:
    """Adds a system to a builder, connects its inputs, and returns it.

    Args:
        builder: Builder to add to.
        name: Name of the system in it.
        system: The system.
        **sources: Output ports by the names of its inputs; None leaves one unconnected.
    """
    builder.AddNamedSystem(name, system)
    for port, source in sources.items():
        if source is not None:
            builder.Connect(source, system.GetInputPort(port))
    return system
