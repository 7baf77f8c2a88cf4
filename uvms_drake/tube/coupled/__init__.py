"""The closed loop at a point as one linear periodic system, and its error budget."""
