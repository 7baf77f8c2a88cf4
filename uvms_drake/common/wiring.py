"""Wiring of a system in a Diagram, declaration of the functions of its Context, and its release."""

import re
from collections.abc import Callable, Iterable, Mapping
from inspect import signature
from typing import Any, Self

from pydrake.common.value import AbstractValue
from pydrake.systems import framework


class WiredSystem(framework.LeafSystem):
    """LeafSystem that a builder gets with its inputs connected by their names."""

    @classmethod
    def AddToBuilder(cls, builder: framework.DiagramBuilder, *args: Any, name: str = "",
                     **named: Any) -> Self:
        """Makes a system, adds it to a builder, connects its inputs, and returns it.

        Args:
            builder: Builder to add to.
            *args: Arguments of the constructor.
            name: Name of the system in the builder; by default its class's, as `tube_monitor`.
            **named: Further arguments of the constructor; and output ports by the names of the
                inputs, None to leave one unconnected.
        """
        sources = {key: named.pop(key) for key, value in list(named.items())
                   if isinstance(value, framework.OutputPort)}
        settings = signature(cls.__init__).parameters
        system = cls(*args, **{key: value for key, value in named.items()
                               if key in settings or value is not None})
        builder.AddNamedSystem(
            name or re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower(), system)
        for port, source in sources.items():
            builder.Connect(source, system.GetInputPort(port))
        return system


def outputs(system: framework.System) -> dict[str, framework.OutputPort]:
    """Returns the output ports of vectors of a system by their names."""
    ports = [system.get_output_port(i) for i in range(system.num_output_ports())]
    return {port.get_name(): port for port in ports
            if port.get_data_type() == framework.PortDataType.kVectorValued}


def wire(builder: framework.DiagramBuilder, system: framework.System,
         signals: Mapping[str, framework.OutputPort]) -> None:
    """Connects every input port of a system that has a signal of its name, and none as yet."""
    for i in range(system.num_input_ports()):
        port = system.get_input_port(i)
        if port.get_name() in signals and not builder.IsConnectedOrExported(port):
            builder.Connect(signals[port.get_name()], port)


def cached(system: framework.LeafSystem, description: str, calc: Callable[[framework.Context], Any],
           prerequisites: Iterable[framework.DependencyTicket]) -> framework.CacheEntry:
    """Declares a cache entry, a function of the Context, and returns it."""
    return system.DeclareCacheEntry(
        description=description, prerequisites_of_calc=set(prerequisites),
        value_producer=framework.ValueProducer(
            allocate=lambda: AbstractValue.Make(()),
            calc=lambda context, value: value.set_value(calc(context))))


def output_of(system: framework.LeafSystem, name: str, size: int,
              calc: Callable[[framework.Context], Any],
              prerequisites: Iterable[framework.DependencyTicket]) -> None:
    """Declares an output port of a vector (size,), a function of the Context."""
    system.DeclareVectorOutputPort(
        name, size, lambda context, output: output.SetFromVector(calc(context)),
        set(prerequisites))


def release(system: framework.System) -> None:
    """Clears the attributes of a system that is no longer used, and of its subsystems.

    Drake's Python bindings never free a LeafSystem that is written in Python, because its callbacks
    refer to it; so at least its attributes are freed: models, workspaces, solvers, and references
    of the bindings to other systems and to the Simulator.
    """
    if isinstance(system, framework.Diagram):
        for part in system.GetSystems():
            release(part)
    vars(system).clear()
