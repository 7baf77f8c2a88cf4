"""The robot, its coordinates and the surface, as plant and controller both know them; no errors."""
