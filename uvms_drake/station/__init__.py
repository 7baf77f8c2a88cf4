"""The closed loop: a scenario, its Diagram, its simulation, its record; it knows no certificate."""
