"""The simulated robot in water, contact and disturbance; it does not know the controller."""
