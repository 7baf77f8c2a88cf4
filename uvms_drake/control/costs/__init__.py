"""Terms of the nominal MPC's cost, one kind a file."""

from uvms_drake.common.kinds import offer
from uvms_drake.control.costs.costs import CostTerm, LevelVehicle

__all__ = ["CostTerm", "LevelVehicle"]

offer(CostTerm, LevelVehicle)
