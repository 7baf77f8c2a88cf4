"""Thrusters: curves, wrench, and allocation."""
