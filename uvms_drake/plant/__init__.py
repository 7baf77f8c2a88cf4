"""The simulated robot: what the water, the surface and the disturbance do to a plant."""
