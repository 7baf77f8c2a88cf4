"""Adds a system to a Diagram, for every system's `AddToBuilder`."""

from typing import TypeVar

from pydrake.systems.framework import DiagramBuilder, OutputPort, System

S = TypeVar("S", bound=System)


def added(builder: DiagramBuilder, name: str, system: S, **sources: OutputPort | None) -> S:
    """Returns a system after it was added by its name and its inputs were connected.

    Args:
        builder: Where to add it.
        name: Its name there.
        system: The system.
        **sources: Output ports by the names of its inputs; what is None is left to the caller.
    """
    builder.AddNamedSystem(name, system)
    for port, source in sources.items():
        if source is not None:
            builder.Connect(source, system.GetInputPort(port))
    return system
