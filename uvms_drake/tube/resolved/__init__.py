"""Tube of the law `resolved` in velocities, attitude and inputs, and its remainder terms."""
