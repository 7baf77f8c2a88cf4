"""Identification of a robot's hydrodynamic parameters from its logs."""
