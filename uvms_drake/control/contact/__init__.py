"""Contact with an unknown wall: safe region, stiffness, target and desired force; no surface law."""
