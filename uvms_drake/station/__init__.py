"""The closed loop: a scenario, its Diagram, its simulation."""
