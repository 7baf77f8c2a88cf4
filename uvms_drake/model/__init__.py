"""What plant and controller both know: the robot, its coordinates and the surface's law."""
