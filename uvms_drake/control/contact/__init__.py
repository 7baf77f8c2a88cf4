"""Pressing on a wall that nobody measured: how far is safe, how fast, how deep; no wall's law."""
