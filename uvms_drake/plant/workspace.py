"""A Context of a plant to compute in, for each Context of the system that computes.

Several Contexts of one system may then be evaluated at a time, as Drake allows: they share no data.
"""

from typing import NamedTuple

from pydrake.common.value import AbstractValue
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import MultibodyForces
from pydrake.systems.framework import CacheEntry, Context, LeafSystem, ValueProducer


class Workspace(NamedTuple):
    """Scratch data of a calculation."""

    context: Context
    """Context of the plant, with the parameters of the default Context."""
    forces: MultibodyForces
    """Forces of the plant."""


def declare_workspace(system: LeafSystem, plant: MultibodyPlant) -> CacheEntry:
    """Returns a cache entry of a system with a `Workspace` that is never out of date.

    Args:
        system: System that computes.
        plant: A finalized plant.
    """
    return system.DeclareCacheEntry(
        description="workspace",
        value_producer=ValueProducer(
            allocate=lambda: AbstractValue.Make(
                Workspace(plant.CreateDefaultContext(), MultibodyForces(plant))),
            calc=ValueProducer.NoopCalc),
        prerequisites_of_calc={system.nothing_ticket()})
