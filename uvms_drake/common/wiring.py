"""Wiring of a system in a Diagram, declaration of the functions of its Context, and its release."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import (
    CacheEntry,
    Context,
    DependencyTicket,
    Diagram,
    DiagramBuilder,
    LeafSystem,
    OutputPort,
    PortDataType,
    System,
    ValueProducer,
)

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


def outputs(system: System) -> dict[str, OutputPort]:
    """Returns the output ports of vectors of a system by their names."""
    ports = [system.get_output_port(i) for i in range(system.num_output_ports())]
    return {port.get_name(): port for port in ports
            if port.get_data_type() == PortDataType.kVectorValued}


def wire(builder: DiagramBuilder, system: System, signals: Mapping[str, OutputPort]) -> None:
    """Connects every input port of a system that has a signal of its name, and none as yet."""
    for i in range(system.num_input_ports()):
        port = system.get_input_port(i)
        if port.get_name() in signals and not builder.IsConnectedOrExported(port):
            builder.Connect(signals[port.get_name()], port)


def cached(system: LeafSystem, description: str, calc: Callable[[Context], Any],
           prerequisites: Iterable[DependencyTicket]) -> CacheEntry:
    """Declares a cache entry, a function of the Context, and returns it."""
    return system.DeclareCacheEntry(
        description=description, prerequisites_of_calc=set(prerequisites),
        value_producer=ValueProducer(
            allocate=lambda: AbstractValue.Make(()),
            calc=lambda context, value: value.set_value(calc(context))))


def output_of(system: LeafSystem, name: str, size: int, calc: Callable[[Context], Any],
              prerequisites: Iterable[DependencyTicket]) -> None:
    """Declares an output port of a vector (size,), a function of the Context."""
    system.DeclareVectorOutputPort(
        name, size, lambda context, output: output.SetFromVector(calc(context)),
        set(prerequisites))


def release(system: System) -> None:
    """Clears the attributes of a system that is no longer used, and of its subsystems.

    Drake's Python bindings never free a LeafSystem that is written in Python, because its callbacks
    refer to it; so at least its attributes are freed: models, workspaces, solvers, and references
    of the bindings to other systems and to the Simulator.
    """
    if isinstance(system, Diagram):
        for part in system.GetSystems():
            release(part)
    vars(system).clear()
