"""Nominal trajectories: plans, their points, terminal ingredients and committed horizon."""
