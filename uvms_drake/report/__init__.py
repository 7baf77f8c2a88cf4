"""Summary, figures, report and replay of a run's record; it starts no run."""
