"""Figures of the force, the contact estimate, the error budget and the kinematic motion."""
