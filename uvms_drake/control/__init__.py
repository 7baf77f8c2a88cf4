"""Tube-based NMPC: planner, ancillary laws, limits, monitor; no plant and no scenario."""
