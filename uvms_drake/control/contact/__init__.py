"""Contact with an unknown wall: safe region, stiffness, normal, target, desired force."""
