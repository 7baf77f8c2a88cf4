"""Bounds, tube and draws of a contact with a wall that is sensed."""
