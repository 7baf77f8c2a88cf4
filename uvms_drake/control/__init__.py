"""The tube-based NMPC: planner, ancillary laws, limits, monitor; it knows no plant, no scenario."""
