"""Terms of the nominal MPC's cost, one kind a file."""

from uvms_drake.control.costs.level_vehicle import LevelVehicle

AnyTerm = LevelVehicle
"""The terms that a scenario's file may add to the task's cost."""
