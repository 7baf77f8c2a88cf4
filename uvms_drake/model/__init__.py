"""Models of the robot, its coordinates and the surface, shared by plant and controller."""
