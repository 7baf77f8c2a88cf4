"""Coordinates, frames and spatial algebra: 𝔮 and ζ, Euler angles, Σ_E, Fossen's 6-vectors."""
