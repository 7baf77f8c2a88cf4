"""Euler angles and spatial algebra: attitude, rotations, Fossen's 6-vectors."""
