"""The nominal trajectory: plans, their points, terminal ingredients and committed horizon."""
