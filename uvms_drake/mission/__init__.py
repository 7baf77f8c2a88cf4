"""Inspection missions as lists of steps: references by time and contact state; no controller."""
