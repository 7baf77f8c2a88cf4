"""The tube-based NMPC: nominal MPC, ancillary feedback, limits and tube."""
