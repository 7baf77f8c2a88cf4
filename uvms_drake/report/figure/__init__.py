"""Figures of the force, the contact estimate and the error budget."""
